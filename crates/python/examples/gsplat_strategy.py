"""Trains plain Gaussians on a data set as 3DGS does, in torch on the CPU: losses and Adam are torch's, densification is
gsplat's own DefaultStrategy, pictures and gradients are specula's.

    python gsplat_strategy.py DATASET [STEPS]      # a folder with transforms_train.json or COLMAP's model

gsplat's strategies are plain Python: `pip install --no-deps gsplat` needs no CUDA for them.
"""

import sys

import numpy as np

try:
    import torch
    import torch.nn.functional as F
    from gsplat import DefaultStrategy
except ImportError as error:
    sys.exit(f"this example needs torch and gsplat ({error}): pip install torch, pip install --no-deps gsplat")

import specula_gs as sg

POINTS = 300 if "--quick" in sys.argv else 10_000
SH_C0 = 0.28209479177387814


def read(dataset, split):
    """Pictures over white [H, W, 3], world-to-camera matrices and intrinsics."""
    for view in sg.load_views(dataset, split):
        rgba = torch.from_numpy(view.rgba.astype(np.float32) / 255)
        picture = rgba[..., :3] * rgba[..., 3:] + 1 - rgba[..., 3:]
        yield picture, torch.from_numpy(view.camera.viewmat)[None], torch.from_numpy(view.camera.K)[None], view.camera.position


def shell():
    """Views of a coloured shell of Gaussians, for a run without data."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    for angle in np.arange(8) * np.pi / 4:
        camera = sg.Camera.look_at((3 * np.cos(angle), 3 * np.sin(angle), 1.0), (0, 0, 0), (0, 0, 1), 0.8, 64, 64)
        pictures, *_ = sg.rasterization(
            normals * 0.8, rng.normal(size=(3000, 4)), np.full((3000, 3), 0.04), np.full(3000, 0.9), 0.5 + 0.5 * normals,
            camera.viewmat[None], camera.K[None], 64, 64, backgrounds=np.ones((1, 3)),
        )
        viewmat, K = torch.from_numpy(camera.viewmat)[None], torch.from_numpy(camera.K)[None]
        yield torch.from_numpy(pictures[0]), viewmat, K, camera.position


def ssim(a, b, window=torch.exp(-((torch.arange(11) - 5.0) ** 2) / 4.5)):
    """Mean SSIM of two pictures [H, W, 3]."""
    kernel = torch.outer(window, window) / window.sum() ** 2
    a, b = a.permute(2, 0, 1)[:, None], b.permute(2, 0, 1)[:, None]
    blur = lambda picture: F.conv2d(picture, kernel[None, None], padding=5)
    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b, cov = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2, blur(a * b) - mean_a * mean_b
    return ((2 * mean_a * mean_b + 1e-4) * (2 * cov + 9e-4) / ((mean_a**2 + mean_b**2 + 1e-4) * (var_a + var_b + 9e-4))).mean()


def render(params, viewmat, K, size, degree):
    colors = torch.cat([params["sh0"], params["shN"]], dim=1)
    return sg.rasterization(
        params["means"], params["quats"], params["scales"].exp(), params["opacities"].sigmoid(), colors, viewmat, K, *size,
        sh_degree=degree, packed=False, backgrounds=torch.ones(1, 3), near_plane=0.2,
    )


is_quick = "--quick" in sys.argv
words = [word for word in sys.argv[1:] if word != "--quick"]
train = list(read(words[0], "train") if words else shell())
test = list(read(words[0], "test")) if words else train
steps = int(words[1]) if len(words) > 1 else 40 if is_quick else 2000
torch.manual_seed(0)

positions = torch.tensor(np.array([position for *_, position in train]), dtype=torch.float32)
extent = 1.1 * (positions - positions.mean(0)).norm(dim=-1).max().item()
means = (torch.rand(POINTS, 3) * 2 - 1) * 1.3
near = torch.cdist(means, means).topk(4, largest=False).values[:, 1:].square().mean(-1).sqrt()
start = {
    "means": means,
    "quats": F.pad(torch.zeros(POINTS, 3), (1, 0), value=1.0),
    "scales": near.log()[:, None].repeat(1, 3),
    "opacities": torch.full((POINTS,), 0.1).logit(),
    "sh0": ((torch.rand(POINTS, 1, 3) - 0.5) / SH_C0),
    "shN": torch.zeros(POINTS, 15, 3),
}
params = torch.nn.ParameterDict(start)
rates = {"means": 1.6e-4 * extent, "quats": 1e-3, "scales": 5e-3, "opacities": 5e-2, "sh0": 2.5e-3, "shN": 1.25e-4}
optimizers = {name: torch.optim.Adam([{"params": [params[name]], "name": name}], lr=rates[name], eps=1e-15) for name in params}
decay = torch.optim.lr_scheduler.ExponentialLR(optimizers["means"], 0.01 ** (1 / steps))
# Of 30 000 steps: refinement from 500 to 15 000, a band of harmonics every 1000; of fewer, the same shares.
strategy = DefaultStrategy(
    refine_start_iter=min(500, steps // 6), refine_stop_iter=steps // 2 + 1, refine_every=min(100, steps // 8)
)
degree = lambda step: min(30 * step // steps, 3)
strategy.check_sanity(params, optimizers)
state = strategy.initialize_state(scene_scale=extent)
order = []
for step in range(steps):
    order = order or torch.randperm(len(train)).tolist()
    truth, viewmat, K, _ = train[order.pop()]
    size = truth.shape[1], truth.shape[0]
    pictures, _, info = render(params, viewmat, K, size, degree(step))
    strategy.step_pre_backward(params, optimizers, state, step, info)
    loss = 0.8 * (pictures[0] - truth).abs().mean() + 0.2 * (1 - ssim(pictures[0], truth))
    loss.backward()
    for optimizer in optimizers.values():
        optimizer.step()
        optimizer.zero_grad()
    decay.step()
    strategy.step_post_backward(params, optimizers, state, step, info)

with torch.no_grad():
    shown = [render(params, viewmat, K, truth.shape[1::-1], degree(steps))[0][0] for truth, viewmat, K, _ in test]
quality = [sg.psnr(picture.numpy(), truth.numpy()) for picture, (truth, *_) in zip(shown, test)]
print(f"{np.mean(quality):.2f} dB on {len(test)} views after {steps} steps; {POINTS} Gaussians became {len(params['means'])}")
