"""Random scenes for tests."""

from __future__ import annotations

import numpy as np
from reference import rotation

# In these two the package differs from gsplat (README.md, Differences).
PACKAGE = dict(alpha_max=0.99, symmetric_limits=True)


def cameras(rng, count, width, height, off_centre=True):
    """Cameras around the origin at a distance of about 4, off-centre unless told otherwise."""
    views, intrinsics = [], []
    for _ in range(count):
        quat = rng.normal(size=4)
        R = rotation(quat[None])[0]
        eye = -R.T @ np.array([0.0, 0.0, rng.uniform(3.0, 5.0)])
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = R, -R @ eye
        views.append(view)
        shift = rng.uniform(-0.2, 0.2, 2) * (width, height) if off_centre else np.zeros(2)
        focal = rng.uniform(0.8, 1.5) * width
        other_focal = focal * rng.uniform(0.9, 1.1)
        intrinsics.append([[focal, 0, width / 2 + shift[0]], [0, other_focal, height / 2 + shift[1]], [0, 0, 1]])
    # What the package reads are 32-bit floats; the reference reads the same numbers.
    return single(np.array(views)), single(np.array(intrinsics))


def single(array):
    return np.asarray(array, np.float32).astype(np.float64)


def cloud(rng, count, sh_degree=None, spread=0.8, scales=(0.02, 0.3), opacity=(0.05, 0.95)):
    """Gaussians around the origin."""
    colors = rng.uniform(0, 1, (count, 3))
    if sh_degree is not None:
        colors = rng.normal(0, 0.3, (count, (sh_degree + 1) ** 2, 3))
    return dict(
        means=single(rng.normal(0, spread, (count, 3))),
        quats=single(rng.normal(size=(count, 4))),
        scales=single(np.exp(rng.uniform(*np.log(scales), (count, 3)))),
        opacities=single(rng.uniform(*opacity, count)),
        colors=single(colors),
    )
