"""Lights, shading functions and measures against formulas in numpy."""

from __future__ import annotations

import numpy as np
import pytest

import specula_gs as sg


def directions(count, seed=0):
    rows = np.random.default_rng(seed).normal(size=(count, 3))
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def sky(directions):
    """Smooth radiance."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack([1 + 0.5 * x, 1 + 0.5 * y * z, 1.5 + z], -1)


def sky_map(height=64):
    """The same as a lat-long map, whose upper edge is +z and whose centre is +x."""
    u = (np.arange(2 * height) + 0.5) / (2 * height)
    v = (np.arange(height) + 0.5) / height
    turn, polar = np.meshgrid((u - 0.5) * 2 * np.pi, v * np.pi)
    rows = np.stack([np.sin(polar) * np.cos(turn), -np.sin(polar) * np.sin(turn), np.cos(polar)], -1)
    return sky(rows)


def test_maps_go_to_cubes_and_back():
    cube = sg.latlong_to_cube(sky_map(), 32)
    assert cube.shape == (6, 32, 32, 3)
    assert np.allclose(cube[4, 15:17, 15:17].mean((0, 1)), sky(np.array([0.0, 0.0, 1.0])), atol=0.02)
    assert np.allclose(sg.cube_to_latlong(cube, 64), sky_map(), atol=0.02)


def test_a_mirror_reflects_the_sky_and_irradiance_is_the_cosine_integral():
    light = sg.prefilter(sky_map(), resolution=64)
    rows = directions(50)
    assert np.abs(sg.radiance(light, rows, 0.0) - sky(rows)).max() < 0.03
    # ∫ cos θ (n·ω)⁺ dω / π of a linear radiance is 2/3 of its slope.
    expected = np.stack([1 + rows[:, 0] / 3, 1 + 0 * rows[:, 0], 1.5 + rows[:, 2] * 2 / 3], -1)
    assert np.abs(sg.irradiance(light, rows) - expected)[:, [0, 2]].max() < 0.03
    levels = light.levels
    assert levels[0][1].shape == (6, 64, 64, 3) and levels[-1][0] == 1.0
    assert all(one[0] < other[0] for one, other in zip(levels, levels[1:]))


def test_ggx_is_a_density_and_split_sum_an_integral():
    theta = (np.arange(20_000) + 0.5) / 20_000 * np.pi / 2
    for roughness in (0.3, 0.6, 1.0):
        density = sg.ggx(np.cos(theta), roughness).astype(np.float64)
        total = (density * np.cos(theta) * np.sin(theta)).sum() * 2 * np.pi * (np.pi / 2 / 20_000)
        assert abs(total - 1) < 1e-3, roughness
    table = sg.split_sum(np.linspace(0.05, 1, 5)[:, None], np.linspace(0, 1, 4))
    assert table.shape == (5, 4, 2) and (table >= 0).all() and (table.sum(-1) <= 1.001).all()
    # A mirror reflects F0 + (1 − F0)(1 − n·v)⁵.
    assert np.allclose(sg.split_sum(0.5, 0.0), [1 - 0.5**5, 0.5**5], atol=1e-3)


def srgb(linear):
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def test_shading_is_the_sum_of_its_terms():
    light = sg.prefilter(0.5 * sky_map() / 3, resolution=32)
    normals, views = directions(40, 1), directions(40, 2)
    views = np.where((normals * views).sum(-1, keepdims=True) < 0, -views, views)
    rng = np.random.default_rng(3)
    diffuse, tint, roughness = rng.uniform(0, 0.3, (40, 3)), rng.uniform(0, 1, (40, 3)), rng.uniform(0, 1, 40)
    cosine = (normals * views).sum(-1, keepdims=True)
    reflected = 2 * cosine * normals - views
    specular = sg.radiance(light, reflected, roughness)
    found = sg.shade(light, normals, views, diffuse, tint, roughness)
    assert np.abs(found - srgb(diffuse + tint * specular)).max() < 1e-4
    table = sg.split_sum(np.clip(cosine[:, 0], 1e-4, 1), roughness)
    found = sg.shade(light, normals, views, diffuse, tint, roughness, form="official")
    ambient = sg.irradiance(light, normals)
    expected = diffuse + ambient * (1 - tint) + specular * (tint * table[:, :1] + table[:, 1:])
    assert np.abs(found - expected).max() < 1e-4
    metal = sg.shade_physical(light, normals, views, tint, 1.0, roughness)
    assert np.abs(metal - srgb(specular * (tint * table[:, :1] + table[:, 1:]))).max() < 1e-4


def test_measures():
    rng = np.random.default_rng(4)
    a = rng.uniform(size=(24, 32, 3))
    b = np.clip(a + rng.normal(0, 0.1, a.shape), 0, 1)
    mse = lambda one, other: np.mean((one - other) ** 2)
    assert abs(sg.psnr(a, b, quantized=False) + 10 * np.log10(mse(a, b))) < 1e-4
    quantized = [np.floor(x * 255 + 0.5) / 255 for x in (a, b)]
    assert abs(sg.psnr(a, b) + 10 * np.log10(mse(*quantized))) < 1e-3
    assert sg.psnr(a, a) == np.inf and abs(sg.ssim(a, a) - 1) < 1e-6 and 0 < sg.ssim(a, b) < 1
    assert sg.flip(a, a) == 0 and 0.01 < sg.flip(a, b) < sg.flip(np.zeros_like(a), np.ones_like(a)) <= 1
    up = np.zeros((2, 2, 3))
    up[..., 2] = 1
    tilted = up.copy()
    tilted[0, 0] = [1, 0, 1]
    assert abs(sg.normal_mae(up, tilted) - 45 / 4) < 1e-5
    assert sg.normal_mae(up, tilted, mask=[[0, 1], [1, 1]]) < 1e-5


@pytest.mark.parametrize(
    "call",
    [
        lambda: sg.prefilter(np.ones((6, 20, 20, 3))),
        lambda: sg.prefilter(np.ones((8, 16))),
        lambda: sg.prefilter(-np.ones((8, 16, 3))),
        lambda: sg.prefilter(np.ones((6, 32, 32, 3)), scheme="mine"),
        lambda: sg.latlong_to_cube(np.ones((8, 16, 3)), 0),
        lambda: sg.latlong_to_cube(np.ones((8, 16, 3)), 16, up="x"),
        lambda: sg.ggx(1.5, 0.5),
        lambda: sg.split_sum([0.5, 0.2], [0.1, 0.2, 0.3]),
        lambda: sg.psnr(np.ones((4, 4, 3)), np.ones((4, 5, 3))),
        lambda: sg.ssim(np.ones((0, 0, 3)), np.ones((0, 0, 3))),
        lambda: sg.flip(np.ones((4, 4, 3)), np.ones((5, 4, 3))),
        lambda: sg.normal_mae(np.zeros((2, 2, 3)), np.ones((2, 2, 3))),
        lambda: sg.Light.dark().with_sun(0, 100),
        lambda: sg.Light.dark().with_sun(0, 10, color="red"),
        lambda: sg.Light.from_latlong(np.full((4, 8, 3), np.nan)),
        lambda: sg.radiance(sg.prefilter(np.ones((6, 16, 16, 3))), [0, 0, 0], 0.5),
    ],
)
def test_misuse_is_named(call):
    with pytest.raises(sg.InvalidInput):
        call()


def test_files_that_are_not_there():
    for call in (sg.Light.load, sg.Scene.load, sg.load_views):
        with pytest.raises(sg.FileError, match="nowhere"):
            call("nowhere")
