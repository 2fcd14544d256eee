"""Pictures against the reference in f64."""

from __future__ import annotations

import numpy as np
import pytest
from reference import Rules, render
from scenes import PACKAGE, cameras, cloud

import specula_gs as sg

# Pixels nearer to a cut than this, relative to it, may fall to either side in 32-bit floats.
AT_A_CUT = 1e-3
TOLERANCE = 1e-5
# Of sums of a few 32-bit floats, relative to the largest.
ROUNDING = 1e-6
SIZE = (40, 30)


def compare(gaussians, viewmats, Ks, rules=Rules(**PACKAGE), background=None, sh_degree=None, tolerance=TOLERANCE, **options):
    """Largest difference of each image; asserts that nearly all pixels could be compared."""
    width, height = SIZE
    pictures, alphas, meta = sg.rasterization(
        **gaussians, viewmats=viewmats, Ks=Ks, width=width, height=height, sh_degree=sh_degree,
        backgrounds=None if background is None else np.tile(background, (len(viewmats), 1)), packed=False,
        render_mode="RGB+D", near_plane=rules.near, far_plane=rules.far,
        rasterize_mode="antialiased" if rules.antialiased else "classic", **options,
    )
    assert pictures.shape == (len(viewmats), height, width, 4) and pictures.dtype == np.float32
    assert alphas.shape == (len(viewmats), height, width, 1)
    for index, (viewmat, K) in enumerate(zip(viewmats, Ks)):
        expected = render(
            **gaussians, viewmat=viewmat, K=K, width=width, height=height, sh_degree=sh_degree, background=background,
            rules=rules,
        )
        clear = expected.margin > AT_A_CUT
        assert clear.mean() > 0.7, "too few pixels are away from cuts"
        assert expected.alpha.max() > 0.3, "the scene is empty"
        depth_unit = max(1.0, np.abs(expected.depth).max())
        for name, found, wanted, unit in (
            ("colours", pictures[index, ..., :3], expected.rgb, 1.0),
            ("alphas", alphas[index, ..., 0], expected.alpha, 1.0),
            ("depths", pictures[index, ..., 3], expected.depth, depth_unit),
        ):
            error = np.abs(found - wanted)[clear].max() / unit
            assert error <= tolerance, f"{name} of camera {index} differ by {error:.1e}"
        seen = (meta["radii"][index] > 0).all(-1)
        assert np.abs(meta["means2d"][index] - expected.means2d)[seen].max() <= 1e-3, "pixels"
    return pictures, alphas


@pytest.mark.parametrize("seed", range(4))
def test_colours_alphas_and_depths(seed):
    rng = np.random.default_rng(seed)
    compare(cloud(rng, 60), *cameras(rng, 2, *SIZE))


@pytest.mark.parametrize("degree", range(4))
def test_harmonics(degree):
    rng = np.random.default_rng(10 + degree)
    compare(cloud(rng, 60, degree), *cameras(rng, 2, *SIZE), sh_degree=degree)


def test_fewer_harmonics_than_there_are():
    rng = np.random.default_rng(20)
    compare(cloud(rng, 40, 3), *cameras(rng, 1, *SIZE), sh_degree=1)


@pytest.mark.parametrize("seed", range(2))
def test_antialiased(seed):
    rng = np.random.default_rng(30 + seed)
    scene = cloud(rng, 60, scales=(0.005, 0.2))
    compare(scene, *cameras(rng, 2, *SIZE), rules=Rules(antialiased=True, **PACKAGE))


def test_background():
    rng = np.random.default_rng(40)
    compare(cloud(rng, 30), *cameras(rng, 2, *SIZE), background=np.array([0.25, 0.5, 1.0]))


def test_planes():
    rng = np.random.default_rng(50)
    scene, (viewmats, Ks) = cloud(rng, 80), cameras(rng, 2, *SIZE)
    rules = Rules(near=float(np.float32(3.5)), far=float(np.float32(4.5)), **PACKAGE)
    inside, _ = compare(scene, viewmats, Ks, rules=rules)
    everything, _ = compare(scene, viewmats, Ks)
    assert np.abs(inside - everything).max() > 0.01, "planes cut something off"


def test_gaussians_around_the_camera():
    rng = np.random.default_rng(60)
    scene, (viewmats, Ks) = cloud(rng, 80, spread=3.0, scales=(0.02, 0.1)), cameras(rng, 2, *SIZE)
    compare(scene, viewmats, Ks, rules=Rules(near=0.2, **PACKAGE))


def test_gsplat_s_own_constants_where_no_splat_is_opaque_and_no_mean_far_outside():
    rng = np.random.default_rng(70)
    scene = cloud(rng, 60, spread=0.3, opacity=(0.05, 0.9))
    compare(scene, *cameras(rng, 2, *SIZE, off_centre=False), rules=Rules())


@pytest.mark.parametrize("seed", range(180))
def test_random_scenes(seed):
    """Any degree, number and size of Gaussians, filter, plane and background."""
    rng = np.random.default_rng(1000 + seed)
    degree = [None, 0, 1, 2, 3][seed % 5]
    antialiased = bool(rng.integers(2))
    rules = Rules(near=float(np.float32(rng.choice([0.01, 0.2, 3.0]))), antialiased=antialiased, **PACKAGE)
    scene = cloud(rng, int(rng.integers(25, 60)), degree, spread=rng.uniform(0.4, 1.2), scales=(0.02, rng.uniform(0.1, 0.4)))
    background = rng.uniform(size=3) if rng.integers(2) else None
    compare(scene, *cameras(rng, 1, *SIZE), rules=rules, background=background, sh_degree=degree)


def test_small_splats_are_clipped():
    rng = np.random.default_rng(75)
    scene, (viewmats, Ks) = cloud(rng, 60), cameras(rng, 2, *SIZE)
    arguments = dict(viewmats=viewmats, Ks=Ks, width=SIZE[0], height=SIZE[1], packed=False)
    everything, _, meta = sg.rasterization(**scene, **arguments)
    limit = float(np.median(meta["radii"].max(-1)))
    clipped, _, kept = sg.rasterization(**scene, **arguments, radius_clip=limit)
    is_small = (meta["radii"] <= limit).all(-1)
    assert is_small.any() and (kept["radii"][is_small] == 0).all()
    assert np.array_equal(kept["radii"][~is_small], meta["radii"][~is_small])
    for index in range(2):
        rest = {name: array[~is_small[index]] for name, array in scene.items()}
        alone, _, _ = sg.rasterization(**rest, **dict(arguments, viewmats=viewmats[index, None], Ks=Ks[index, None]))
        assert np.array_equal(clipped[index], alone[0]) and not np.array_equal(everything[index], alone[0])


def test_render_modes_are_channels_of_each_other():
    rng = np.random.default_rng(80)
    scene, (viewmats, Ks) = cloud(rng, 30), cameras(rng, 2, *SIZE)
    arguments = dict(**scene, viewmats=viewmats, Ks=Ks, width=SIZE[0], height=SIZE[1])
    rgb, alphas, _ = sg.rasterization(**arguments)
    depth, _, _ = sg.rasterization(**arguments, render_mode="D")
    expected, _, _ = sg.rasterization(**arguments, render_mode="ED", backgrounds=np.ones((2, 1)))
    both, _, _ = sg.rasterization(**arguments, render_mode="RGB+D")
    other, _, _ = sg.rasterization(**arguments, render_mode="RGB+ED")
    assert rgb.shape[-1] == 3 and depth.shape[-1] == expected.shape[-1] == 1
    assert np.allclose(both, np.concatenate([rgb, depth], -1), atol=1e-6)
    assert np.allclose(other, np.concatenate([rgb, expected], -1), atol=1e-6)
    assert np.allclose(expected, depth / np.maximum(alphas, 1e-10), atol=1e-5)


def test_colours_of_each_camera():
    rng = np.random.default_rng(90)
    scene, (viewmats, Ks) = cloud(rng, 30), cameras(rng, 2, *SIZE)
    colors = rng.uniform(size=(2, 30, 3))
    arguments = dict(**{**scene, "colors": colors}, width=SIZE[0], height=SIZE[1])
    both, alphas, meta = sg.rasterization(**arguments, viewmats=viewmats, Ks=Ks, packed=False)
    for index in range(2):
        one = {**arguments, "colors": colors[index]}
        picture, alpha, _ = sg.rasterization(**one, viewmats=viewmats[index, None], Ks=Ks[index, None])
        assert np.array_equal(both[index], picture[0]) and np.array_equal(alphas[index], alpha[0])
    assert meta["radii"].shape == (2, 30, 2)


def test_packed_meta_has_the_splats_that_are_drawn():
    rng = np.random.default_rng(100)
    scene, (viewmats, Ks) = cloud(rng, 40, spread=3.0), cameras(rng, 2, *SIZE)
    arguments = dict(**scene, viewmats=viewmats, Ks=Ks, width=SIZE[0], height=SIZE[1])
    _, _, full = sg.rasterization(**arguments, packed=False)
    _, _, packed = sg.rasterization(**arguments)
    cameras_of, gaussians_of = packed["camera_ids"], packed["gaussian_ids"]
    assert 0 < len(gaussians_of) < 80
    for key in ("means2d", "radii", "depths"):
        assert np.array_equal(packed[key], full[key][cameras_of, gaussians_of])
    assert (full["radii"] > 0).all(-1).sum() == len(gaussians_of) and full["gaussian_ids"] is None
    assert (packed["width"], packed["height"], packed["n_cameras"]) == (*SIZE, 2)
    with pytest.raises(KeyError, match="isect_ids"):
        packed["isect_ids"]


def test_no_gaussian_shows_the_background():
    rng = np.random.default_rng(110)
    viewmats, Ks = cameras(rng, 1, *SIZE)
    nothing = {name: array[:0] for name, array in cloud(rng, 1).items()}
    picture, alphas, _ = sg.rasterization(
        **nothing, viewmats=viewmats, Ks=Ks, width=SIZE[0], height=SIZE[1], backgrounds=np.full((1, 3), 0.5)
    )
    assert (picture == 0.5).all() and not alphas.any()


@pytest.mark.parametrize("channels", [1, 2, 5, 6])
@pytest.mark.parametrize("render_mode", ["RGB", "RGB+ED", "D"])
@pytest.mark.parametrize("is_each", [False, True])
def test_features_of_any_number_of_channels_are_colours_three_at_a_time(channels, render_mode, is_each):
    rng = np.random.default_rng(channels)
    scene, (viewmats, Ks) = cloud(rng, 20), cameras(rng, 2, *SIZE)
    count = len(scene["means"])
    features = rng.uniform(size=(2, count, channels) if is_each else (count, channels)).astype(np.float32)
    backgrounds = rng.uniform(size=(2, channels)).astype(np.float32)
    has_colors, has_depths = "RGB" in render_mode, "D" in render_mode
    options = dict(viewmats=viewmats, Ks=Ks, width=SIZE[0], height=SIZE[1])

    def drawn(colors, backgrounds, mode):
        behind = dict(backgrounds=backgrounds) if has_colors else {}
        return sg.rasterization_vjp(**{**scene, "colors": colors}, **options, **behind, render_mode=mode)

    pictures, alphas, _, vjp = drawn(features, backgrounds, render_mode)
    assert pictures.shape == (2, SIZE[1], SIZE[0], channels * has_colors + has_depths)
    grad = rng.normal(size=pictures.shape).astype(np.float32)
    grad_alphas = rng.normal(size=alphas.shape).astype(np.float32)
    found = vjp(grad, grad_alphas)
    assert found.colors.shape == features.shape
    if not has_colors:
        assert not found.colors.any()
        return
    assert found.backgrounds.shape == backgrounds.shape
    means = np.zeros_like(found.means)
    for first in range(0, channels, 3):
        taken = slice(first, min(first + 3, channels))
        missing = 3 - (taken.stop - taken.start)
        pad = lambda array: np.concatenate([array[..., taken], np.zeros((*array.shape[:-1], missing), np.float32)], axis=-1)
        mode = render_mode if first == 0 else "RGB"
        part, same_alphas, _, part_vjp = drawn(pad(features), pad(backgrounds), mode)
        width = taken.stop - taken.start
        assert np.array_equal(part[..., :width], pictures[..., taken]) and np.array_equal(alphas, same_alphas)
        part_grad = pad(grad[..., :channels])
        if "D" in mode:
            assert np.array_equal(part[..., -1], pictures[..., -1])
            part_grad = np.concatenate([part_grad, grad[..., -1:]], axis=-1)
        one = part_vjp(part_grad, grad_alphas if first == 0 else None)
        means += one.means
        assert np.array_equal(one.colors[..., :width], found.colors[..., taken])
        assert np.array_equal(one.backgrounds[:, :width], found.backgrounds[:, taken])
    # The order of a few sums differs.
    assert np.allclose(means, found.means, rtol=0, atol=ROUNDING * np.abs(means).max())


@pytest.mark.parametrize("packed", [False, True])
def test_batches_are_rasterised_by_themselves(packed):
    rng = np.random.default_rng(40)
    scenes = [[(cloud(rng, 20), cameras(rng, 2, *SIZE)) for _ in range(3)] for _ in range(2)]
    arrays = {name: np.array([[one[name] for one, _ in row] for row in scenes]) for name in scenes[0][0][0]}
    viewmats, Ks = (np.array([[seen[k] for _, seen in row] for row in scenes]) for k in range(2))
    options = dict(width=SIZE[0], height=SIZE[1], packed=packed)
    pictures, alphas, meta = sg.rasterization(**arrays, viewmats=viewmats, Ks=Ks, **options)
    assert pictures.shape == (2, 3, 2, SIZE[1], SIZE[0], 3) and alphas.shape == (2, 3, 2, SIZE[1], SIZE[0], 1)
    assert meta["n_batches"] == 6 and meta["n_cameras"] == 2
    for row in range(2):
        for column in range(3):
            one, seen = scenes[row][column]
            alone, coverage, own = sg.rasterization(**one, viewmats=seen[0], Ks=seen[1], **options)
            assert np.array_equal(pictures[row, column], alone) and np.array_equal(alphas[row, column], coverage)
            if packed:
                taken = meta["batch_ids"] == 3 * row + column
                assert np.array_equal(meta["gaussian_ids"][taken], own["gaussian_ids"])
                assert np.array_equal(meta["means2d"][taken], own["means2d"])
            else:
                assert np.array_equal(meta["means2d"][row, column], own["means2d"])
    short = dict(arrays, scales=arrays["scales"][:1])
    with pytest.raises(sg.InvalidInput, match="scales"):
        sg.rasterization(**short, viewmats=viewmats, Ks=Ks, **options)
