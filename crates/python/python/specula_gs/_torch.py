"""Rasterisation as a function of torch's autograd. Imported only for tensors."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from ._errors import InvalidInput, Unsupported
from ._rasterization import Arguments, Forward, Meta, Options, forward

_NAMES = Arguments._fields


class _Shared:
    """One rasterisation, which two functions of the graph share."""

    def __init__(self, done: Forward, options: Options, rows: torch.Tensor | None) -> None:
        self.done = done
        self.options = options
        self.rows = rows
        self.grad_means2d: torch.Tensor | None = None
        self.means2d: weakref.ref[torch.Tensor] | None = None

    def chosen(self, array: Any) -> torch.Tensor:
        """Entries of an array [C, N, …] that `meta` has: all, or some rows of [C · N, …]."""
        tensor = torch.from_numpy(array)
        return tensor if self.rows is None else tensor.flatten(0, 1).index_select(0, self.rows)


class _Centers(torch.autograd.Function):
    """Centres of the splats, through which no gradient passes on: `_Pictures` has the whole of it."""

    @staticmethod
    def forward(ctx: Any, shared: _Shared, *tensors: Any) -> torch.Tensor:
        ctx.shared = shared
        return shared.chosen(shared.done.means2d)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: torch.Tensor) -> Any:
        known = ctx.shared.grad_means2d
        if known is None or not torch.equal(known, grad):
            raise Unsupported("a loss on meta['means2d'] itself is not supported; it only reports a gradient")
        return (None,) * (1 + len(_NAMES))


class _Pictures(torch.autograd.Function):
    """Pictures and coverages."""

    @staticmethod
    def forward(ctx: Any, shared: _Shared, means2d: torch.Tensor, *tensors: Any) -> tuple[torch.Tensor, torch.Tensor]:
        ctx.shared = shared
        ctx.set_materialize_grads(False)
        return torch.from_numpy(shared.done.colors), torch.from_numpy(shared.done.alphas)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_colors: torch.Tensor | None, grad_alphas: torch.Tensor | None) -> Any:
        shared: _Shared = ctx.shared
        means2d_needed, *needed = ctx.needs_input_grad[1:]
        grads = shared.done.vjp(_numpy(grad_colors), _numpy(grad_alphas))
        if means2d_needed:
            # Another backward pass through the same graph adds its own.
            shared.grad_means2d = shared.chosen(grads["means2d"])
        means2d = None if shared.means2d is None else shared.means2d()
        if means2d is not None and "absgrad" in grads:
            means2d.absgrad = shared.chosen(grads["absgrad"])  # type: ignore[attr-defined]
        out = [None if not is_needed else _tensor(grads.get(name)) for name, is_needed in zip(_NAMES, needed)]
        if needed[-1] and not shared.options.has_colors:
            out[-1] = torch.zeros((len(shared.done.radii), 1))
        return (None, shared.grad_means2d if means2d_needed else None, *out)


def _numpy(tensor: torch.Tensor | None) -> Any:
    return None if tensor is None else tensor.detach().to(torch.float32).contiguous().numpy()


def _tensor(array: Any) -> torch.Tensor | None:
    return None if array is None else torch.from_numpy(array)


def _checked(value: Any, name: str) -> Any:
    """A tensor of 32-bit floats on the CPU; gradients pass the conversion."""
    if value is None and name == "backgrounds":
        return None
    if not isinstance(value, torch.Tensor):
        try:
            value = torch.as_tensor(np.asarray(value))
        except (TypeError, ValueError, RuntimeError) as error:
            raise InvalidInput(f"{name} is no tensor of numbers: {error}") from None
    if value.device.type != "cpu":
        raise Unsupported(f"{name} is on {value.device}; only tensors on the CPU are supported, use .cpu()")
    if value.layout is not torch.strided or value.is_complex():
        raise Unsupported(f"{name} is a {value.layout} tensor of {value.dtype}; use a dense one of real numbers")
    return value.to(torch.float32)


def rasterize_tensors(arguments: Arguments, options: Options) -> tuple[torch.Tensor, torch.Tensor, Meta]:
    """Rasterisation of tensors; see `rasterization`."""
    tensors = [_checked(value, name) for value, name in zip(arguments, _NAMES)]
    is_taped = torch.is_grad_enabled()
    wants_grad = [is_taped and tensor is not None and tensor.requires_grad for tensor in tensors]
    if wants_grad[_NAMES.index("Ks")]:
        raise Unsupported("Ks gets no gradient; detach it")
    arrays = [None if tensor is None else tensor.detach().contiguous().numpy() for tensor in tensors]
    views = wants_grad[_NAMES.index("viewmats")]
    done = forward(Arguments(*arrays), options, taped=any(wants_grad), views=views)
    ids = rows = None
    if options.packed:
        cameras, gaussians = (torch.from_numpy(index) for index in done.ids())
        ids = (cameras, gaussians)
        rows = cameras * done.radii.shape[1] + gaussians
    shared = _Shared(done, options, rows)
    centers = _Centers.apply(shared, *tensors)  # type: ignore[no-untyped-call]
    # Centres hold the graph, which holds what is shared.
    shared.means2d = weakref.ref(centers)
    pictures, alphas = _Pictures.apply(shared, centers, *tensors)  # type: ignore[no-untyped-call]
    return pictures, alphas, done.meta(options, centers, shared.chosen(done.radii), shared.chosen(done.depths), ids)
