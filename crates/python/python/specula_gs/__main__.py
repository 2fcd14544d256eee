"""`python -m specula_gs`: version, and a self test of a second."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import specula_gs


def self_test() -> None:
    """A picture, its gradient against a difference, and a filtered light; raises where one is wrong."""
    rng = np.random.default_rng(0)
    arguments: dict[str, Any] = dict(
        means=rng.normal(0.0, 0.3, (50, 3)) + (0.0, 0.0, 3.0),
        quats=rng.normal(size=(50, 4)),
        scales=np.full((50, 3), 0.1),
        opacities=np.full(50, 0.5),
        viewmats=np.eye(4)[None],
        Ks=np.array([[[32.0, 0.0, 16.0], [0.0, 32.0, 16.0], [0.0, 0.0, 1.0]]]),
        width=32,
        height=32,
    )
    colors = rng.uniform(size=(50, 3))
    pictures, _, _, vjp = specula_gs.rasterization_vjp(colors=colors, **arguments)
    gradients = vjp(np.ones_like(pictures))
    brighter, _, _ = specula_gs.rasterization(colors=colors + 0.01, **arguments)
    rise = float(np.sum(brighter, dtype=np.float64) - np.sum(pictures, dtype=np.float64))
    slope = 0.01 * float(np.sum(gradients.colors, dtype=np.float64))
    if not pictures.any() or abs(rise - slope) > 1e-3 * abs(rise):
        raise SystemExit(f"self test failed: the gradient of colours is {slope}, their difference {rise}")
    light = specula_gs.prefilter(np.ones((6, 16, 16, 3)))
    if not np.allclose(specula_gs.irradiance(light, [0.0, 0.0, 1.0]), 1.0, atol=1e-3):
        raise SystemExit("self test failed: the irradiance of a white sky is not white")


def main() -> None:
    """Prints the version and runs the self test."""
    print(f"specula-gs {specula_gs.__version__}, {specula_gs.thread_count()} threads, Python {sys.version.split()[0]}")
    self_test()
    print("self test passed")


if __name__ == "__main__":
    main()
