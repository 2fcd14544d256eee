"""The program `specula`, also as `python -m specula_gs`; without arguments the latter tests the package for a second."""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np

import specula_gs
from specula_gs import _core


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


def program() -> int:
    """Runs the program with the arguments of this process."""
    # Drivers of Vulkan print errors without the first, on machines without a display; the second is
    # for processes that the program starts with a limit on memory.
    for name, value in (("XDG_RUNTIME_DIR", os.devnull), ("OPENBLAS_NUM_THREADS", "1")):
        os.environ.setdefault(name, value)
    return _core.run_program([sys.executable, "-m", "specula_gs"], sys.argv[1:])


def main() -> int:
    """Runs the program, or without arguments prints the version and tests the package."""
    if len(sys.argv) > 1:
        return program()
    print(f"specula-gs {specula_gs.__version__}, {specula_gs.thread_count()} threads, Python {sys.version.split()[0]}")
    self_test()
    print("self test passed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
