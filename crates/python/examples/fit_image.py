"""Fits 2000 Gaussians to a picture: with torch where it is installed, else with numpy and Adam by hand."""

import sys

import numpy as np

import specula_gs as sg

SIZE, COUNT = 96, 2000
STEPS = 30 if "--quick" in sys.argv else 300
y, x = np.mgrid[0:SIZE, 0:SIZE] / SIZE
target = np.stack([x, y, 0.5 + 0.5 * np.sin(20 * x * y)], -1).astype(np.float32)
camera = dict(
    viewmats=np.eye(4, dtype=np.float32)[None],
    Ks=np.array([[[SIZE, 0, SIZE / 2], [0, SIZE, SIZE / 2], [0, 0, 1]]], np.float32),
    width=SIZE,
    height=SIZE,
)
rng = np.random.default_rng(0)
start = dict(
    means=np.append(rng.uniform(-0.5, 0.5, (COUNT, 2)), np.ones((COUNT, 1)), 1).astype(np.float32),
    quats=np.tile(np.float32([1, 0, 0, 0]), (COUNT, 1)),
    log_scales=np.full((COUNT, 3), -4, np.float32),
    logits=np.zeros(COUNT, np.float32),
    colors=np.full((COUNT, 3), 0.5, np.float32),
)


def with_torch(torch):
    parameters = {name: torch.tensor(array, requires_grad=True) for name, array in start.items()}
    optimizer = torch.optim.Adam(parameters.values(), lr=0.01)
    fixed = {name: torch.as_tensor(value) if isinstance(value, np.ndarray) else value for name, value in camera.items()}
    for _ in range(STEPS):
        p = parameters
        picture, _, _ = sg.rasterization(
            p["means"], p["quats"], p["log_scales"].exp(), p["logits"].sigmoid(), p["colors"], **fixed
        )
        loss = (picture[0] - torch.as_tensor(target)).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return picture[0].detach().numpy()


def with_numpy():
    parameters = {name: array.copy() for name, array in start.items()}
    moments = {name: [np.zeros_like(array), np.zeros_like(array)] for name, array in start.items()}
    for step in range(1, STEPS + 1):
        scales, opacities = np.exp(parameters["log_scales"]), 1 / (1 + np.exp(-parameters["logits"]))
        picture, _, _, vjp = sg.rasterization_vjp(
            parameters["means"], parameters["quats"], scales, opacities, parameters["colors"], **camera
        )
        grads = vjp((picture - target) * (2 / target.size))
        chain = dict(means=grads.means, quats=grads.quats, colors=grads.colors)
        chain |= dict(log_scales=grads.scales * scales, logits=grads.opacities * opacities * (1 - opacities))
        for name, grad in chain.items():
            first, second = moments[name]
            first += 0.1 * (grad - first)
            second += 0.001 * (grad**2 - second)
            parameters[name] -= 0.01 * first / (1 - 0.9**step) / (np.sqrt(second / (1 - 0.999**step)) + 1e-8)
    return picture[0]


try:
    import torch
except ImportError:
    torch = None
fitted = with_torch(torch) if torch else with_numpy()
print(f"{sg.psnr(fitted, target):.2f} dB after {STEPS} steps with {'torch' if torch else 'numpy'}")
assert sg.psnr(fitted, target) > (15 if "--quick" in sys.argv else 25)
