"""Autograd of torch: the same bits as the arrays, gsplat's meta, and named refusals."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from scenes import cameras, cloud

import specula_gs as sg

torch = pytest.importorskip("torch")
SIZE = (32, 24)
NAMES = ("means", "quats", "scales", "opacities", "colors", "viewmats")


def problem(seed=0, count=30, **options):
    rng = np.random.default_rng(seed)
    arrays = cloud(rng, count, **options)
    arrays["viewmats"], arrays["Ks"] = cameras(rng, 2, *SIZE)
    return {name: np.asarray(array, np.float32) for name, array in arrays.items()}


def leaves(arrays, wanted=NAMES):
    return {name: torch.tensor(array, requires_grad=name in wanted) for name, array in arrays.items()}


@pytest.mark.parametrize("mode", ["RGB", "RGB+ED", "D"])
def test_gradients_have_the_bits_of_arrays(mode):
    arrays = problem()
    backgrounds = np.full((2, 3), 0.5, np.float32) if mode == "RGB" else None
    options = dict(width=SIZE[0], height=SIZE[1], render_mode=mode)
    pictures, alphas, _, vjp = sg.rasterization_vjp(**arrays, backgrounds=backgrounds, **options)
    rng = np.random.default_rng(1)
    weights = [rng.normal(size=image.shape).astype(np.float32) for image in (pictures, alphas)]
    expected = vjp(*weights)

    tensors = leaves(arrays)
    behind = None if backgrounds is None else torch.tensor(backgrounds, requires_grad=True)
    colors, coverage, meta = sg.rasterization(**tensors, backgrounds=behind, packed=False, **options)
    assert np.array_equal(colors.detach().numpy(), pictures) and np.array_equal(coverage.detach().numpy(), alphas)
    meta["means2d"].retain_grad()
    loss = (colors * torch.tensor(weights[0])).sum() + (coverage * torch.tensor(weights[1])).sum()
    loss.backward()
    for name in NAMES:
        assert np.array_equal(tensors[name].grad.numpy(), getattr(expected, name)), name
    assert np.array_equal(meta["means2d"].grad.numpy(), expected.means2d)
    if behind is not None:
        assert np.array_equal(behind.grad.numpy(), expected.backgrounds)


def test_batches_have_the_gradients_of_each():
    batches = [problem(seed) for seed in range(2)]
    options = dict(width=SIZE[0], height=SIZE[1])
    joined = leaves({name: np.stack([one[name] for one in batches]) for name in batches[0]})
    colors, _, _ = sg.rasterization(**joined, **options)
    colors.square().sum().backward()
    for index, one in enumerate(batches):
        tensors = leaves(one)
        own, _, _ = sg.rasterization(**tensors, **options)
        own.square().sum().backward()
        for name in NAMES:
            assert torch.equal(joined[name].grad[index], tensors[name].grad), name


def test_packed_centres_have_packed_gradients():
    tensors = leaves(problem(spread=3.0))
    options = dict(width=SIZE[0], height=SIZE[1])
    grads = {}
    for packed in (False, True):
        colors, _, meta = sg.rasterization(**tensors, packed=packed, **options)
        meta["means2d"].retain_grad()
        colors.square().sum().backward()
        grads[packed] = meta["means2d"].grad
    assert len(grads[True]) == len(meta["gaussian_ids"]) == len(meta["radii"])
    assert torch.equal(grads[True], grads[False][meta["camera_ids"], meta["gaussian_ids"]])


def test_absolute_gradients_are_those_of_single_pixels():
    tensors = leaves(problem(spread=3.0))
    width, height = 12, 9
    grads = {}
    for packed in (False, True):
        colors, alphas, meta = sg.rasterization(
            **tensors, width=width, height=height, packed=packed, absgrad=True, render_mode="RGB+ED"
        )
        means2d = meta["means2d"]
        means2d.retain_grad()
        weights = torch.linspace(-1.0, 1.0, colors.numel()).reshape(colors.shape)
        (colors * weights).sum().backward(retain_graph=not packed)
        assert means2d.absgrad.shape == means2d.shape and (means2d.absgrad >= means2d.grad.abs() - 1e-4).all()
        grads[packed] = means2d.absgrad
        if packed:
            continue
        expected = torch.zeros_like(means2d)
        for row in range(height):
            for column in range(width):
                means2d.grad = None
                one = (colors * weights)[:, row, column].sum()
                one.backward(retain_graph=True)
                expected += means2d.grad.abs()
        assert torch.allclose(grads[False], expected, atol=1e-4 * float(expected.max()))
        assert (expected > 2 * means2d.grad.abs()).any()
    assert torch.equal(grads[True], grads[False][meta["camera_ids"], meta["gaussian_ids"]])


def test_graphs_of_other_operations_and_dtypes():
    arrays = problem()
    logits = torch.randn(30, dtype=torch.float64, requires_grad=True)
    tensors = leaves(arrays, ())
    tensors["opacities"] = torch.sigmoid(logits)
    colors, alphas, _ = sg.rasterization(**tensors, width=SIZE[0], height=SIZE[1])
    colors.mean().backward(retain_graph=True)
    first = logits.grad.clone()
    colors.mean().backward()
    assert logits.grad.dtype == torch.float64 and torch.allclose(logits.grad, 2 * first) and first.any()


def test_no_graph_without_gradients():
    with torch.no_grad():
        colors, _, _ = sg.rasterization(**leaves(problem()), width=SIZE[0], height=SIZE[1])
    assert not colors.requires_grad
    colors, _, meta = sg.rasterization(**leaves(problem(), ()), width=SIZE[0], height=SIZE[1])
    assert not colors.requires_grad and not meta["means2d"].requires_grad


def test_strided_inputs():
    arrays = problem()
    tensors = leaves(arrays, ())
    tensors["means"] = torch.tensor(arrays["means"].T.copy()).T
    assert not tensors["means"].is_contiguous()
    found = sg.rasterization(**tensors, width=SIZE[0], height=SIZE[1])[0].numpy()
    assert np.array_equal(found, sg.rasterization(**arrays, width=SIZE[0], height=SIZE[1])[0])


def test_refusals_are_named():
    arrays = problem()
    options = dict(width=SIZE[0], height=SIZE[1])
    with pytest.raises(sg.Unsupported, match="Ks"):
        sg.rasterization(**leaves(arrays, ("Ks",)), **options)
    tensors = leaves(arrays)
    with pytest.raises(sg.Unsupported, match="means is on meta"):
        sg.rasterization(**{**tensors, "means": tensors["means"].to("meta")}, **options)
    colors, _, meta = sg.rasterization(**tensors, **options)
    with pytest.raises(sg.Unsupported, match="means2d"):
        (colors.sum() + meta["means2d"].sum()).backward()
    (gradient,) = torch.autograd.grad(
        sg.rasterization(**tensors, **options)[0].square().sum(), tensors["means"], create_graph=True
    )
    with pytest.raises(RuntimeError, match="twice"):
        gradient.sum().backward()


def test_graphs_are_freed():
    from specula_gs._torch import _Shared

    gc.collect()
    gc.disable()
    try:
        for _ in range(3):
            colors, alphas, meta = sg.rasterization(**leaves(problem()), width=SIZE[0], height=SIZE[1])
            colors.sum().backward()
            del colors, alphas, meta
        assert not [one for one in gc.get_objects() if type(one) is _Shared], "nothing waits for the collector"
    finally:
        gc.enable()


def test_gsplat_s_strategy_grows_gaussians():
    gsplat = pytest.importorskip("gsplat")
    torch.manual_seed(0)
    arrays = problem(count=60)
    params = torch.nn.ParameterDict(
        {
            "means": torch.tensor(arrays["means"]),
            "scales": torch.tensor(arrays["scales"]).log(),
            "quats": torch.tensor(arrays["quats"]),
            "opacities": torch.logit(torch.tensor(arrays["opacities"])),
            "colors": torch.tensor(arrays["colors"]),
        }
    )
    optimizers = {name: torch.optim.Adam([{"params": [params[name]], "name": name}], lr=1e-3) for name in params}
    strategy = gsplat.DefaultStrategy(refine_start_iter=2, refine_every=5, grow_grad2d=1e-6, reset_every=1000)
    strategy.check_sanity(params, optimizers)
    state = strategy.initialize_state()
    views = {name: torch.tensor(arrays[name]) for name in ("viewmats", "Ks")}
    for packed in (False, True):
        before = len(params["means"])
        for step in range(1, 11):
            colors, _, info = sg.rasterization(
                params["means"], params["quats"], params["scales"].exp(), torch.sigmoid(params["opacities"]),
                params["colors"], **views, width=SIZE[0], height=SIZE[1], packed=packed,
            )
            strategy.step_pre_backward(params, optimizers, state, step, info)
            colors.square().mean().backward()
            for optimizer in optimizers.values():
                optimizer.step()
                optimizer.zero_grad()
            strategy.step_post_backward(params, optimizers, state, step, info, packed=packed)
        assert len(params["means"]) > before


@pytest.mark.parametrize("seed", range(5))
def test_gsplat_s_own_reference_agrees(seed):
    """Projection, compensation and harmonics of gsplat's torch code, in f64; pictures by them."""
    reference = pytest.importorskip("gsplat.cuda._torch_impl")
    degree = seed % 4
    arrays = problem(seed, sh_degree=degree, spread=0.3, opacity=(0.05, 0.9), scales=(0.03, 0.2))
    exact = {name: torch.tensor(array, dtype=torch.float64) for name, array in arrays.items()}
    means, viewmats = exact["means"], exact["viewmats"]
    covars, _ = reference._quat_scale_to_covar_preci(exact["quats"], exact["scales"], True, False)
    _, means2d, depths, conics, _ = reference._fully_fused_projection(means, covars, viewmats, exact["Ks"], *SIZE)
    pictures, alphas, meta = sg.rasterization(
        **{name: torch.tensor(array) for name, array in arrays.items()}, width=SIZE[0], height=SIZE[1], sh_degree=degree, packed=False
    )
    seen = (meta["radii"] > 0).all(-1)
    assert seen.sum() > 20
    assert (meta["means2d"] - means2d)[seen].abs().max() <= 1e-4 and (meta["depths"] - depths)[seen].abs().max() <= 1e-5
    rows, columns = torch.meshgrid(torch.arange(SIZE[1]) + 0.5, torch.arange(SIZE[0]) + 0.5, indexing="ij")
    for camera in range(2):
        eye = -viewmats[camera, :3, :3].T @ viewmats[camera, :3, 3]
        colors = (reference._spherical_harmonics(degree, means - eye, exact["colors"]) + 0.5).clamp(min=0)
        transmittance = torch.ones(SIZE[1], SIZE[0], dtype=torch.float64)
        picture = torch.zeros(SIZE[1], SIZE[0], 3, dtype=torch.float64)
        is_clear = torch.ones(SIZE[1], SIZE[0], dtype=torch.bool)
        for splat in depths[camera].argsort():
            x, y = columns - means2d[camera, splat, 0], rows - means2d[camera, splat, 1]
            a, b, c = conics[camera, splat]
            alpha = exact["opacities"][splat] * torch.exp(-0.5 * (a * x * x + c * y * y) - b * x * y)
            is_clear &= (alpha - 1 / 255).abs() > 1e-5
            alpha = torch.where(alpha < 1 / 255, 0.0, alpha)
            picture += (transmittance * alpha)[..., None] * colors[splat]
            transmittance = transmittance * (1 - alpha)
        is_clear &= transmittance > 1e-3
        assert is_clear.float().mean() > 0.7
        assert (pictures[camera] - picture)[is_clear].abs().max() <= 1e-5
        assert (alphas[camera, ..., 0] - (1 - transmittance))[is_clear].abs().max() <= 1e-5
