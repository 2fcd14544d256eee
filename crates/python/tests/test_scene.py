"""Trainings, scenes, cameras and lights."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

import specula_gs as sg


@pytest.fixture(scope="module")
def plain(dataset, tmp_path_factory):
    """Folder of a short training of plain Gaussians."""
    folder = tmp_path_factory.mktemp("plain")
    heard = []
    sg.train(
        dataset, folder, profile="3dgs", iterations=40, random_points=500, downscale=8, hold_out=True,
        executor="cpu", callback=lambda *progress: heard.append(progress), callback_every=10,
    )
    assert [iteration for iteration, _, _ in heard] == [10, 20, 30, 40] and heard[-1][2] > 0
    return folder


@pytest.fixture(scope="module")
def shaded(dataset, tmp_path_factory):
    """Folder of a short training of relightable Gaussians."""
    folder = tmp_path_factory.mktemp("shaded")
    sg.train(dataset, folder, iterations=20, random_points=500, downscale=8, executor="cpu")
    return folder


def test_views_and_cameras(dataset):
    views = sg.load_views(dataset, downscale=8)
    camera = views[0].camera
    assert views[0].rgba.shape == (camera.height, camera.width, 4) and views[0].rgba.dtype == np.uint8
    R, t = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-5) and np.allclose(-R.T @ t, camera.position, atol=1e-4)
    again = sg.Camera(camera.viewmat, camera.K, camera.width, camera.height, near=camera.near)
    assert np.allclose(again.viewmat, camera.viewmat, atol=1e-5) and np.array_equal(again.K, camera.K)
    half = camera.resized(camera.width // 2, camera.height // 2)
    assert np.allclose(half.K[0, 0] * 2, camera.K[0, 0], rtol=0.1)
    with pytest.raises(sg.InvalidInput):
        sg.Camera(2 * np.eye(4), camera.K, 8, 8)
    with pytest.raises(sg.InvalidInput):
        sg.Camera.look_at([0, 0, 0], [0, 0, 1], [0, 0, 1], 1.0, 8, 8)
    with pytest.raises(sg.InvalidInput):
        sg.load_views(dataset, "all")


def test_linear_pictures_are_not_clipped(tmp_path):
    """A PNG of 16 bits that says that it is linear."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    numbers = np.linspace(0, 65535, 8 * 8 * 3).astype(">u2").reshape(8, 24)
    rows = b"".join(b"\0" + row.tobytes() for row in numbers)
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 8, 8, 16, 2, 0, 0, 0)) + chunk(b"gAMA", struct.pack(">I", 100000))
    png = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    (tmp_path / "a.png").write_bytes(png)
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
    frames = [{"file_path": "a", "transform_matrix": pose}]
    (tmp_path / "transforms_train.json").write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))
    (view,) = sg.load_views(tmp_path)
    assert view.unclipped is not None and view.unclipped.shape == (8, 8, 3)
    linear = numbers.reshape(8, 8, 3) / 65535
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(view.unclipped, encoded, atol=1e-3)
    np.testing.assert_allclose(view.rgba[..., :3] / 255, encoded, atol=3e-3)


def test_no_view_is_both_trained_on_and_held_out(dataset):
    train, test = ({tuple(view.camera.position) for view in sg.load_views(dataset, split, downscale=8)} for split in ("train", "test"))
    assert len(train) == 56 and len(test) == 12 and not train & test


def test_a_scene_renders_as_its_gaussians_rasterise(plain):
    scene = sg.Scene.load(plain)
    assert not scene.is_shaded and not scene.has_materials and len(scene) > 0
    camera = scene.cameras("test")[0]
    layers = scene.render(camera, ["rgb", "alpha", "depth"], executor="cpu")
    assert layers["rgb"].shape == (camera.height, camera.width, 3)
    gaussians = scene.gaussians()
    assert len(gaussians["means"]) == len(scene)
    pictures, alphas, _ = sg.rasterization(
        **gaussians, viewmats=camera.viewmat[None], Ks=camera.K[None], width=camera.width, height=camera.height,
        near_plane=camera.near, backgrounds=[scene.background], render_mode="RGB+ED",
    )
    assert np.abs(pictures[0, ..., :3] - layers["rgb"]).max() < 1e-4
    assert np.abs(alphas[0, ..., 0] - layers["alpha"]).max() < 1e-4
    covered = layers["alpha"] > 0.01
    assert np.allclose(pictures[0, ..., 3][covered], layers["depth"][covered], rtol=1e-3)


def test_renderers_keep_their_scene(shaded):
    scene = sg.Scene.load(shaded)
    assert scene.is_shaded and "Scene(" in repr(scene)
    camera = scene.cameras()[0]
    renderer = scene.renderer(["rgb", "normal", "roughness"], executor="cpu")
    assert renderer.layers == ["rgb", "normal", "roughness"]
    before = renderer.render(camera)
    assert before["normal"].shape[-1] == 3 and before["roughness"].ndim == 2
    scene.relight(sg.Light.from_latlong(np.full((8, 16, 3), 4.0)))
    relit = scene.render(camera, executor="cpu")["rgb"]
    assert np.array_equal(renderer.render(camera)["rgb"], before["rgb"])
    assert relit.mean() != before["rgb"].mean()
    scene.relight(sg.Light.dark())
    black = scene.render(camera, background=[0.0, 0.0, 0.0], executor="cpu")["rgb"]
    assert black.mean() < relit.mean()
    with pytest.raises(sg.InvalidInput, match="shiny"):
        scene.render(camera, ["shiny"])
    with pytest.raises(sg.SpeculaError):
        scene.render(camera, executor="tpu")


def test_suns_need_materials(shaded, plain):
    sun = sg.Light.dark().with_sun(30, 45, strength=5, color="ffddaa").with_lamp([0, 0, 3], 2.0, radius=0.1)
    assert sun.lamp_count == 2 and sun.latlong is None and sun.turned(20).lamp_count == 2
    scene = sg.Scene.load(shaded)
    if scene.has_materials:
        scene.relight(sun)
        scene.shade_as("physical")
        lit = scene.render(scene.cameras()[0], executor="cpu")["rgb"]
        assert np.isfinite(lit).all()
    with pytest.raises(sg.InvalidInput, match="materials"):
        sg.Scene.load(plain).relight(sun)


def test_the_light_of_pictures_is_fitted(shaded, plain, dataset):
    views = sg.load_views(dataset, "test", downscale=8)
    scene = sg.Scene.load(shaded)
    assert scene.has_materials
    light = scene.fit_light(views[:2], iterations=12, executor="cpu")
    assert light.latlong.shape[2] == 3 and np.isfinite(light.latlong).all() and light.latlong.std() > 0
    scene.relight(light)
    with pytest.raises(sg.InvalidInput, match="materials"):
        sg.Scene.load(plain).fit_light(views)
    with pytest.raises(sg.SpeculaError):
        scene.fit_light([])


@pytest.mark.parametrize("ending", ["ply", "splat", "spz", "glb"])
def test_exports(plain, tmp_path, ending):
    scene = sg.Scene.load(plain)
    path = tmp_path / f"scene.{ending}"
    scene.export(path, sh_degree=1)
    assert path.stat().st_size > 1000
    if ending in ("ply", "glb"):
        assert len(sg.Scene.load(path)) == len(scene)
    with pytest.raises(sg.InvalidInput, match="ending"):
        scene.export(tmp_path / "scene.usd")
    with pytest.raises(sg.InvalidInput, match="model itself"):
        scene.export(next(plain.glob("point_cloud/*/point_cloud.ply")))


def test_saving(shaded, tmp_path):
    scene = sg.Scene.load(shaded)
    scene.save(tmp_path / "copy", iteration=7)
    copy = sg.Scene.load(tmp_path / "copy")
    camera = scene.cameras()[0]
    before, after = (one.render(camera, executor="cpu")["rgb"] for one in (scene, copy))
    assert len(copy) == len(scene) and np.abs(before - after).max() < 1e-3


def test_trainings_are_refused_by_name(dataset, plain, tmp_path):
    with pytest.raises(sg.InvalidInput, match="resume=True"):
        sg.train(dataset, plain, profile="3dgs", iterations=10, downscale=8)
    with pytest.raises(sg.InvalidInput, match="profile"):
        sg.train(dataset, tmp_path / "a", profile="fancy", iterations=10, downscale=8)
    with pytest.raises(sg.InvalidInput, match="other settings"):
        sg.train(dataset, plain, profile="3dgs", iterations=60, downscale=8, hold_out=True, random_points=500, resume=True, seed=1)
    with pytest.raises(sg.FileError):
        sg.train(tmp_path / "nothing", tmp_path / "b", iterations=10)
    other = tmp_path / "other"
    other.mkdir()
    (other / "transforms.json").write_text("{}")
    with pytest.raises(sg.InvalidInput, match="another data set"):
        sg.train(dataset, other, iterations=10)


def test_an_exception_of_the_callback_ends_the_training_with_a_checkpoint(dataset, tmp_path):
    class Enough(Exception):
        pass

    def stop(iteration, psnr, gaussians):
        if iteration >= 20:
            raise Enough

    options = dict(profile="3dgs", iterations=60, random_points=300, downscale=8, executor="cpu", callback_every=5)
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    with pytest.raises(Enough):
        sg.train(dataset, stopped, **options, callback=stop)
    assert (stopped / "checkpoint.safetensors").is_file()
    heard = []
    resumed = sg.train(dataset, stopped, **options, resume=True, callback=lambda *progress: heard.append(progress[0]))
    assert 20 <= heard[0] <= 30 and heard[-1] == 60
    straight = sg.train(dataset, whole, **options)
    one, other = resumed.gaussians(), straight.gaussians()
    assert all(np.array_equal(one[name], other[name]) for name in ("means", "colors", "opacities"))


@pytest.mark.skipif(os.name != "posix", reason="signals of Unix")
def test_ctrl_c_ends_a_training_with_a_checkpoint(dataset, tmp_path):
    threading.Timer(3.0, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        sg.train(dataset, tmp_path / "long", profile="3dgs", iterations=1_000_000, downscale=4, executor="cpu")
    assert time.monotonic() - start < 30
    assert (tmp_path / "long" / "checkpoint.safetensors").is_file()


@pytest.mark.parametrize("example", sorted(Path(__file__).parent.parent.joinpath("examples").glob("*.py")), ids=lambda path: path.stem)
def test_examples(example, tmp_path):
    """Each runs for seconds with `--quick`; one whose library is not installed says so."""
    done = subprocess.run(
        [sys.executable, str(example), "--quick"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    if "needs" in done.stderr and "pip install" in done.stderr:
        pytest.skip(done.stderr.strip().splitlines()[-1])
    assert done.returncode == 0, done.stderr
