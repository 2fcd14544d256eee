"""Gradients against central differences of the reference in f64."""

from __future__ import annotations

import numpy as np
import pytest
from reference import Rules, render
from scenes import PACKAGE, cameras, cloud

import specula_gs as sg

SIZE = (24, 18)
# Pixels nearer to a cut than this have no weight in the loss: the cut has no gradient.
AT_A_CUT = 3e-3
STEP = 1e-6
TOLERANCE = 1e-3


class Problem:
    """A loss that is a weighted sum of the numbers of a picture."""

    def __init__(self, seed, sh_degree=None, antialiased=False, background=True, count=10, **options):
        rng = np.random.default_rng(seed)
        self.gaussians = cloud(rng, count, sh_degree, **options)
        viewmats, Ks = cameras(rng, 1, *SIZE)
        self.viewmat, self.K = viewmats[0], Ks[0]
        self.sh_degree = sh_degree
        self.rules = Rules(antialiased=antialiased, **PACKAGE)
        self.background = np.array([0.25, 0.75, 0.5]) if background else None
        picture = self.picture()
        clear = picture.margin > AT_A_CUT
        assert clear.mean() > 0.5, "pixels are left"
        self.weights = rng.normal(size=(*picture.alpha.shape, 5)) * clear[..., None]

    def picture(self, viewmat=None, background=None, means2d_shift=None, **changed):
        return render(
            **{**self.gaussians, **changed}, viewmat=self.viewmat if viewmat is None else viewmat, K=self.K,
            width=SIZE[0], height=SIZE[1], sh_degree=self.sh_degree,
            background=self.background if background is None else background, rules=self.rules,
            means2d_shift=means2d_shift,
        )

    def loss(self, **changed):
        picture = self.picture(**changed)
        numbers = np.concatenate([picture.rgb, picture.depth[..., None], picture.alpha[..., None]], -1)
        return float((numbers * self.weights).sum())

    def vjp(self):
        width, height = SIZE
        _, _, _, vjp = sg.rasterization_vjp(
            **self.gaussians, viewmats=self.viewmat[None], Ks=self.K[None], width=width, height=height,
            sh_degree=self.sh_degree, backgrounds=None if self.background is None else self.background[None],
            render_mode="RGB+D", rasterize_mode="antialiased" if self.rules.antialiased else "classic",
        )
        return vjp(self.weights[None, ..., :4], self.weights[None, ..., 4:])

    def differences(self, name, start, step=STEP):
        """Central differences with respect to each number of an argument."""
        out = np.zeros(start.shape)
        for index in np.ndindex(start.shape):
            moved = []
            for sign in (1.0, -1.0):
                changed = start.copy()
                changed[index] += sign * step
                moved.append(self.loss(**{name: changed}))
            out[index] = (moved[0] - moved[1]) / (2.0 * step)
        return out


def agree(name, found, expected, tolerance=TOLERANCE):
    error = np.linalg.norm(found - expected) / np.linalg.norm(expected)
    assert error <= tolerance, f"gradients of {name} differ by {error:.1e}, relative"


CASES = {
    "colours": dict(seed=1),
    "without background": dict(seed=2, background=False),
    "antialiased": dict(seed=3, antialiased=True, scales=(0.01, 0.2)),
    "harmonics": dict(seed=4, sh_degree=2),
    "degree 3": dict(seed=5, sh_degree=3, count=6),
    "opaque": dict(seed=6, opacity=(0.9, 0.98), count=20),
}


@pytest.mark.parametrize("case", CASES)
def test_arguments(case):
    problem = Problem(**CASES[case])
    found = problem.vjp()
    for name, start in problem.gaussians.items():
        agree(name, getattr(found, name), problem.differences(name, start))
    shift = np.zeros((len(problem.gaussians["means"]), 2))
    agree("means2d", found.means2d[0], problem.differences("means2d_shift", shift, step=1e-5))
    if problem.background is not None:
        agree("backgrounds", found.backgrounds[0], problem.differences("background", problem.background))


@pytest.mark.parametrize("seed, sh_degree", [(11, None), (12, 2)])
def test_view_matrices_along_motions_of_the_camera(seed, sh_degree):
    problem = Problem(seed, sh_degree=sh_degree)
    found = problem.vjp().viewmats[0].astype(np.float64)
    motions = []
    for axis in range(3):
        turn = np.zeros((4, 4))
        turn[:3, :3] = np.cross(np.eye(3), -np.eye(3)[axis])
        shift = np.zeros((4, 4))
        shift[axis, 3] = 1.0
        motions += [turn, shift]
    slopes = [float((found * (motion @ problem.viewmat)).sum()) for motion in motions]
    expected = []
    for motion in motions:
        # The exponential of a motion, to second order: its error falls out of the difference.
        moved = [
            problem.loss(viewmat=(np.eye(4) + sign * STEP * motion + 0.5 * STEP**2 * motion @ motion) @ problem.viewmat)
            for sign in (1.0, -1.0)
        ]
        expected.append((moved[0] - moved[1]) / (2.0 * STEP))
    agree("viewmats", np.array(slopes), np.array(expected))


def test_expected_depth():
    rng = np.random.default_rng(21)
    gaussians, (viewmats, Ks) = cloud(rng, 8, opacity=(0.4, 0.9)), cameras(rng, 1, *SIZE)
    rules = Rules(**PACKAGE)

    def picture(**changed):
        return render(**{**gaussians, **changed}, viewmat=viewmats[0], K=Ks[0], width=SIZE[0], height=SIZE[1], rules=rules)

    start = picture()
    weights = rng.normal(size=start.alpha.shape) * (start.margin > AT_A_CUT) * (start.alpha > 0.05)

    def loss(**changed):
        seen = picture(**changed)
        return float((weights * seen.depth / np.maximum(seen.alpha, 1e-10)).sum())

    *_, vjp = sg.rasterization_vjp(
        **gaussians, viewmats=viewmats, Ks=Ks, width=SIZE[0], height=SIZE[1], render_mode="ED"
    )
    found = vjp(weights[None, ..., None])
    for name in ("means", "opacities"):
        expected = np.zeros(gaussians[name].shape)
        for index in np.ndindex(expected.shape):
            moved = []
            for sign in (1.0, -1.0):
                changed = gaussians[name].copy()
                changed[index] += sign * STEP
                moved.append(loss(**{name: changed}))
            expected[index] = (moved[0] - moved[1]) / (2.0 * STEP)
        agree(name, getattr(found, name), expected)
    assert not found.colors.any() and found.backgrounds is None


def test_cameras_add_up_and_none_is_zero():
    rng = np.random.default_rng(31)
    gaussians, (viewmats, Ks) = cloud(rng, 20), cameras(rng, 2, *SIZE)
    options = dict(width=SIZE[0], height=SIZE[1])
    pictures, alphas, _, vjp = sg.rasterization_vjp(**gaussians, viewmats=viewmats, Ks=Ks, **options)
    cotangent = rng.normal(size=pictures.shape)
    whole = vjp(cotangent)
    parts = []
    for index in range(2):
        one = slice(index, index + 1)
        *_, part = sg.rasterization_vjp(**gaussians, viewmats=viewmats[one], Ks=Ks[one], **options)
        parts.append(part(cotangent[one]))
    assert np.allclose(whole.means, parts[0].means + parts[1].means, rtol=1e-4, atol=1e-5)
    assert np.array_equal(whole.means2d, np.concatenate([part.means2d for part in parts]))
    each = np.tile(gaussians["colors"], (2, 1, 1))
    *_, vjp_each = sg.rasterization_vjp(**{**gaussians, "colors": each}, viewmats=viewmats, Ks=Ks, **options)
    of_each = vjp_each(cotangent)
    assert of_each.colors.shape == (2, 20, 3)
    assert np.allclose(of_each.colors.sum(0), whole.colors, rtol=1e-4, atol=1e-5)
    assert np.allclose(of_each.means, whole.means, rtol=1e-4, atol=1e-5)
    for gradient in vjp():
        assert gradient is None or not gradient.any()
    with pytest.raises(sg.InvalidInput, match="grad_colors"):
        vjp(cotangent[:, :-1])
