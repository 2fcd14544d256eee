"""Trains Gaussians with densification by gsplat's own DefaultStrategy; the pictures are rasterised here, on the CPU.

gsplat's strategies are plain Python: `pip install --no-deps gsplat` needs no CUDA for them.
"""

import sys

try:
    import torch
    from gsplat import DefaultStrategy
except ImportError as error:
    sys.exit(f"this example needs torch and gsplat ({error}): pip install torch, pip install --no-deps gsplat")

import specula_gs as sg

SIZE, VIEWS = 64, 8
STEPS = 60 if "--quick" in sys.argv else 600
torch.manual_seed(0)
K = torch.tensor([[80.0, 0.0, SIZE / 2], [0.0, 80.0, SIZE / 2], [0.0, 0.0, 1.0]])


def view(angle):
    """Matrix of a camera on a circle around the origin."""
    c, s = torch.cos(angle), torch.sin(angle)
    matrix = torch.eye(4)
    matrix[:3, :3] = torch.tensor([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    matrix[2, 3] = 3.0
    return matrix


viewmats = torch.stack([view(angle) for angle in torch.arange(VIEWS) * (2 * torch.pi / VIEWS)])


def picture(means, quats, scales, opacities, colors, which):
    return sg.rasterization(
        means, quats, scales, opacities, colors, viewmats[which, None], K[None], SIZE, SIZE,
        backgrounds=torch.ones(1, 3), packed=False,
    )


# The truth: a coloured shell of 3000 Gaussians.
shell = torch.nn.functional.normalize(torch.randn(3000, 3), dim=-1)
truth = (shell * 0.8, torch.randn(3000, 4), torch.full((3000, 3), 0.04), torch.full((3000,), 0.9), 0.5 + 0.5 * shell)
with torch.no_grad():
    photographs = [picture(*truth, which)[0] for which in range(VIEWS)]

count = 200
params = torch.nn.ParameterDict(
    {
        "means": torch.randn(count, 3) * 0.5,
        "quats": torch.randn(count, 4),
        "scales": torch.full((count, 3), -2.0),
        "opacities": torch.zeros(count),
        "colors": torch.rand(count, 3),
    }
)
rates = {"means": 3e-3, "quats": 1e-3, "scales": 1e-2, "opacities": 3e-2, "colors": 1e-2}
optimizers = {name: torch.optim.Adam([{"params": [params[name]], "name": name}], lr=rates[name]) for name in params}
strategy = DefaultStrategy(
    refine_start_iter=20, refine_stop_iter=STEPS * 3 // 4, refine_every=20, reset_every=10**9, grow_grad2d=2e-4
)
strategy.check_sanity(params, optimizers)
state = strategy.initialize_state()
for step in range(STEPS):
    which = step % VIEWS
    colors, alphas, info = picture(
        params["means"], params["quats"], params["scales"].exp(), params["opacities"].sigmoid(), params["colors"], which
    )
    strategy.step_pre_backward(params, optimizers, state, step, info)
    loss = (colors - photographs[which]).abs().mean()
    loss.backward()
    for optimizer in optimizers.values():
        optimizer.step()
        optimizer.zero_grad()
    strategy.step_post_backward(params, optimizers, state, step, info)
quality = sg.psnr(colors[0].detach().numpy(), photographs[which][0].numpy())
print(f"{quality:.2f} dB after {STEPS} steps; {count} Gaussians grew to {len(params['means'])}")
assert len(params["means"]) > count
