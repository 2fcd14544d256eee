"""Error against run time: Gaussians of low opacity left out, drawn with matplotlib into a picture."""

import sys
import time

try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
except ImportError as error:
    sys.exit(f"this example needs matplotlib ({error}): pip install matplotlib")

import numpy as np

import specula_gs as sg

COUNT, SIZE = (2_000, 100) if "--quick" in sys.argv else (50_000, 400)
rng = np.random.default_rng(0)
gaussians = dict(
    means=rng.normal(0, 0.5, (COUNT, 3)) + (0, 0, 3),
    quats=rng.normal(size=(COUNT, 4)),
    scales=rng.uniform(0.005, 0.03, (COUNT, 3)),
    opacities=rng.beta(1, 3, COUNT),
    colors=rng.uniform(size=(COUNT, 3)),
)
gaussians = {name: array.astype(np.float32) for name, array in gaussians.items()}
camera = dict(
    viewmats=np.eye(4, dtype=np.float32)[None],
    Ks=np.array([[[SIZE, 0, SIZE / 2], [0, SIZE, SIZE / 2], [0, 0, 1]]], np.float32),
    width=SIZE,
    height=SIZE,
)


def timed(kept):
    """Picture of some of the Gaussians, and the least of three times in seconds."""
    some = {name: np.ascontiguousarray(array[kept]) for name, array in gaussians.items()}
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        picture, _, _ = sg.rasterization(**some, **camera)
        seconds.append(time.perf_counter() - start)
    return picture[0], min(seconds)


whole, _ = timed(slice(None))
points = []
for least in (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5):
    kept = gaussians["opacities"] >= least
    picture, seconds = timed(kept)
    points.append((1e3 * seconds, np.abs(picture - whole).mean(), f"α ≥ {least}"))
    print(f"opacity of {least} or more: {kept.sum()} Gaussians, {points[-1][0]:.1f} ms, mean error {points[-1][1]:.5f}")
figure, axes = plt.subplots()
axes.plot([ms for ms, _, _ in points], [error for _, error, _ in points], "o-")
for ms, error, label in points:
    axes.annotate(label, (ms, error))
axes.set(xlabel="run time in ms", ylabel="mean absolute error", title=f"{COUNT} Gaussians, {SIZE} × {SIZE} pixels")
figure.savefig("error_against_time.png")
