"""Rasterisation in plain numpy and f64, from the conventions that gsplat documents. Shares nothing with the package."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Y0 = 0.28209479177387814
Y1 = 0.4886025119029199
Y2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
Y3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277)


@dataclass
class Rules:
    """Constants in which rasterisers differ, and the options of a call."""

    eps2d: float = 0.3
    near: float = 0.01
    far: float = 1e10
    antialiased: bool = False
    alpha_max: float = 0.999
    alpha_min: float = 1 / 255
    transmittance_min: float = 1e-4
    # Limits of x/z and y/z in the Jacobian: 0.15 of the picture beyond its edges, or 1.3 of the
    # larger half.
    symmetric_limits: bool = False


@dataclass
class Picture:
    """Sums of a view, and how near its pixels are to a cut."""

    rgb: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray
    # Per pixel: least relative distance of an alpha to the cut, of a transmittance to its end.
    margin: np.ndarray
    # Which splat counts in which pixel: equal masks mean that no cut was crossed.
    counted: np.ndarray
    means2d: np.ndarray


def rotation(quats):
    w, x, y, z = (quats / np.linalg.norm(quats, axis=-1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def harmonics(direction, degree):
    x, y, z = direction.T
    basis = [np.full_like(x, Y0)]
    if degree > 0:
        basis += [-Y1 * y, Y1 * z, -Y1 * x]
    if degree > 1:
        a, b, c = Y2
        basis += [a * x * y, -a * y * z, b * (2 * z * z - x * x - y * y), -a * x * z, c * (x * x - y * y)]
    if degree > 2:
        a, b, c, d, e = Y3
        basis += [
            -a * y * (3 * x * x - y * y),
            b * x * y * z,
            -c * y * (4 * z * z - x * x - y * y),
            d * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -c * x * (4 * z * z - x * x - y * y),
            e * z * (x * x - y * y),
            -a * x * (x * x - 3 * y * y),
        ]
    return np.stack(basis, axis=-1)


def render(
    means, quats, scales, opacities, colors, viewmat, K, width, height, sh_degree=None, background=None, rules=Rules(),
    means2d_shift=None,
):
    """One picture. `means2d_shift` [N, 2] moves the splats, for the gradient of their centres."""
    R, t = viewmat[:3, :3], viewmat[:3, 3]
    camera = means @ R.T + t
    z = camera[:, 2]
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    drawn = (z > rules.near) & (z <= rules.far)
    safe_z = np.where(drawn, z, 1.0)
    means2d = np.stack([fx * camera[:, 0] / safe_z + cx, fy * camera[:, 1] / safe_z + cy], axis=-1)

    size, focal, centre = (width, height), (fx, fy), (cx, cy)
    slopes = []
    for axis in range(2):
        if rules.symmetric_limits:
            high = 1.3 * max(centre[axis], size[axis] - centre[axis]) / focal[axis]
            low = -high
        else:
            beyond = 0.15 * size[axis] / focal[axis]
            high, low = (size[axis] - centre[axis]) / focal[axis] + beyond, -(centre[axis] / focal[axis] + beyond)
        slopes.append(np.clip(camera[:, axis] / safe_z, low, high))
    zero = np.zeros_like(z)
    J = np.array([[fx / safe_z, zero, -fx * slopes[0] / safe_z], [zero, fy / safe_z, -fy * slopes[1] / safe_z]])
    J = np.moveaxis(J, -1, 0)
    half = J @ R @ (rotation(quats) * scales[:, None, :])
    cov = half @ np.swapaxes(half, 1, 2)
    det_before = np.linalg.det(cov)
    cov = cov + rules.eps2d * np.eye(2)
    det = np.linalg.det(cov)
    conic = np.linalg.inv(cov)
    opacity = opacities
    if rules.antialiased:
        opacity = opacities * np.sqrt(np.maximum(det_before / det, 0.0))

    if sh_degree is not None:
        eye = -R.T @ t
        direction = means - eye
        direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
        basis = harmonics(direction, sh_degree)
        colors = np.maximum(np.einsum("nk,nkc->nc", basis, colors[:, : basis.shape[1]]) + 0.5, 0.0)

    if means2d_shift is not None:
        means2d = means2d + means2d_shift
    xs, ys = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    dx = xs.ravel()[None] - means2d[:, :1]
    dy = ys.ravel()[None] - means2d[:, 1:]
    power = 0.5 * (conic[:, 0, :1] * dx**2 + conic[:, 1, 1:] * dy**2) + conic[:, 0, 1:] * dx * dy
    strength = np.where(drawn[:, None], opacity[:, None] * np.exp(-power), 0.0)
    alphas = np.minimum(strength, rules.alpha_max)

    T = np.ones(width * height)
    open_ = np.ones(width * height, bool)
    rgb, depth = np.zeros((width * height, 3)), np.zeros(width * height)
    margin = np.full(width * height, np.inf)
    counted = np.zeros((len(means), width * height), bool)
    for k in np.argsort(np.where(drawn, z, np.inf), kind="stable"):
        if not drawn[k]:
            continue
        alpha = alphas[k]
        margin = np.where(open_, np.minimum(margin, abs(alpha / rules.alpha_min - 1.0)), margin)
        margin = np.where(open_, np.minimum(margin, abs(strength[k] / rules.alpha_max - 1.0)), margin)
        counts = open_ & (alpha >= rules.alpha_min)
        behind = T * (1.0 - alpha)
        margin = np.where(counts, np.minimum(margin, abs(behind / rules.transmittance_min - 1.0)), margin)
        ends = counts & (behind <= rules.transmittance_min)
        open_ &= ~ends
        counts &= ~ends
        weight = np.where(counts, alpha * T, 0.0)
        rgb += weight[:, None] * colors[k]
        depth += weight * z[k]
        T = np.where(counts, behind, T)
        counted[k] = counts
    if background is not None:
        rgb = rgb + T[:, None] * background
    shape = (height, width)
    return Picture(
        rgb.reshape(*shape, 3), (1.0 - T).reshape(shape), depth.reshape(shape), margin.reshape(shape), counted, means2d
    )
