"""Differentiable rasterisation of Gaussians: gsplat's call, on arrays of numpy or tensors of torch."""

from __future__ import annotations

import math
import operator
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from . import _core
from ._arrays import Floats, check, floats, shaped
from ._errors import InvalidInput, Unsupported, UnsupportedKey

RenderMode = Literal["RGB", "D", "ED", "RGB+D", "RGB+ED"]
RasterizeMode = Literal["classic", "antialiased"]

_MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")


class Meta(dict[str, Any]):
    """What a rasterisation found beside its pictures; a dictionary with the keys of gsplat's strategies.

    | key | shape | |
    |---|---|---|
    | `means2d` | [C, N, 2], packed [nnz, 2] | centres in pixels |
    | `radii` | [C, N, 2], packed [nnz, 2], int32 | half sizes in pixels, 0 for what is not drawn |
    | `depths` | [C, N], packed [nnz] | distances along the optical axes |
    | `gaussian_ids`, `camera_ids` | packed [nnz], else None | and `batch_ids` of batches |
    | `width`, `height`, `tile_size`, `n_cameras`, `n_batches` | int | |

    Batches precede C. With torch and without batches, `means2d` receives the gradient of the
    splats' centres (`retain_grad`), and with `absgrad` an attribute of that name. Other keys of
    gsplat raise `UnsupportedKey`.
    """

    def __missing__(self, key: str) -> Any:
        raise UnsupportedKey(f"meta has no entry {key!r}; it has {', '.join(self)}")


class Gradients(NamedTuple):
    """Gradients of a loss with respect to the arguments of a rasterisation, each in its shape."""

    means: Floats
    quats: Floats
    scales: Floats
    opacities: Floats
    colors: Floats
    viewmats: Floats
    backgrounds: Floats | None
    means2d: Floats
    """[C, N, 2], in units of the loss for each pixel."""


@dataclass(frozen=True)
class Options:
    """Arguments of a rasterisation that are no arrays."""

    width: int
    height: int
    near_plane: float
    far_plane: float
    radius_clip: float
    eps2d: float
    sh_degree: int | None
    packed: bool
    tile_size: int
    render_mode: str
    antialiased: bool
    absgrad: bool

    @property
    def has_colors(self) -> bool:
        """Whether pictures have colours."""
        return "RGB" in self.render_mode

    @property
    def has_depths(self) -> bool:
        """Whether pictures have depths."""
        return "D" in self.render_mode


@dataclass
class Part:
    """Cameras that share colours, and three of their channels: one call of the rasteriser."""

    cameras: slice
    colors: slice
    has_colors: bool
    has_depths: bool
    tape: _core.Tape | None

    def vjp(self, grad_colors: Floats | None, grad_alphas: Floats | None) -> dict[str, Floats]:
        """Gradients of the arguments of this call; those of missing channels are zeros."""
        assert self.tape is not None
        grad = None
        if grad_colors is not None:
            taken = []
            if self.has_colors:
                last = grad_colors.shape[-1] - self.has_depths
                of_colors = grad_colors[self.cameras, ..., self.colors.start : min(self.colors.stop, last)]
                taken.append(_padded(of_colors))
            if self.has_depths:
                taken.append(grad_colors[self.cameras, ..., -1:])
            grad = np.ascontiguousarray(np.concatenate(taken, axis=-1) if len(taken) > 1 else taken[0])
        is_first = self.colors.start == 0
        return self.tape.vjp(grad, None if grad_alphas is None or not is_first else grad_alphas[self.cameras])


def _padded(colors: Floats) -> Floats:
    """Colours with a multiple of three channels."""
    missing = -colors.shape[-1] % 3
    return np.pad(colors, [(0, 0)] * (colors.ndim - 1) + [(0, missing)]) if missing else colors


@dataclass
class Forward:
    """Pictures of a rasterisation, and what its gradients need."""

    colors: Floats
    alphas: Floats
    radii: np.ndarray[Any, np.dtype[np.int32]]
    means2d: Floats
    depths: Floats
    parts: list[Part]
    color_shape: tuple[int, ...]
    color_channels: int

    def vjp(self, grad_colors: Floats | None, grad_alphas: Floats | None) -> dict[str, Floats]:
        """Gradients of the arguments from those of the pictures."""
        done = [(part, part.vjp(grad_colors, grad_alphas)) for part in self.parts]
        total = {name: _sum([grads[name] for _, grads in done]) for name in ("means", "quats", "scales", "opacities")}
        cameras = list(dict.fromkeys(part.cameras.start for part in self.parts))
        of_camera = [[grads for part, grads in done if part.cameras.start == start] for start in cameras]
        for name in ("viewmats", "means2d", "absgrad"):
            if name in done[0][1]:
                total[name] = _joined([_sum([grads[name] for grads in each]) for each in of_camera], axis=0)
        for name in ("colors", "backgrounds"):
            channels = [_joined([grads[name] for grads in each], axis=-1) for each in of_camera]
            total[name] = _joined(channels, axis=0)
        total["colors"] = self._colors(total["colors"])
        total["backgrounds"] = total["backgrounds"][:, : self.color_channels]
        return total

    def _colors(self, grads: Floats) -> Floats:
        """Gradient in the shape of the colours; that of channels which are not drawn is zero."""
        wanted = self.color_shape[-1]
        grads = grads[..., :wanted]
        missing = wanted - grads.shape[-1]
        grads = np.pad(grads, [(0, 0), (0, missing)]) if missing else grads
        return np.ascontiguousarray(grads).reshape(self.color_shape)

    def ids(self) -> tuple[np.ndarray[Any, np.dtype[np.int64]], np.ndarray[Any, np.dtype[np.int64]]]:
        """Cameras and Gaussians of the splats that are drawn."""
        is_drawn = self.radii > 0
        cameras, gaussians = np.nonzero(is_drawn[..., 0] & is_drawn[..., 1])
        return cameras, gaussians

    def meta(self, options: Options, means2d: Any, radii: Any, depths: Any, ids: tuple[Any, Any] | None) -> Meta:
        """Entries, with arrays of the caller's kind."""
        cameras, gaussians = ids or (None, None)
        return Meta(
            camera_ids=cameras,
            gaussian_ids=gaussians,
            radii=radii,
            means2d=means2d,
            depths=depths,
            width=options.width,
            height=options.height,
            tile_size=options.tile_size,
            n_cameras=len(self.radii),
            n_batches=1,
        )


def _whole(value: Any, name: str) -> int:
    try:
        return operator.index(value)
    except TypeError:
        raise InvalidInput(f"{name} is {value!r}; use a whole number") from None


def _real(value: Any, name: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InvalidInput(f"{name} is {value!r}; use a number") from None
    if math.isnan(number):
        raise InvalidInput(f"{name} is not a number")
    return number


def options_of(
    *,
    width: Any,
    height: Any,
    near_plane: Any,
    far_plane: Any,
    radius_clip: Any,
    eps2d: Any,
    sh_degree: Any,
    packed: Any,
    tile_size: Any,
    render_mode: Any,
    sparse_grad: Any,
    absgrad: Any,
    rasterize_mode: Any,
    distributed: Any,
    camera_model: Any,
    **others: Any,
) -> Options:
    """Checked options; raises `Unsupported` for what only gsplat has."""
    if camera_model != "pinhole":
        raise Unsupported(f"camera_model {camera_model!r} is not supported; use 'pinhole'")
    wanted = {"sparse_grad": sparse_grad, "distributed": distributed, **others}
    for name, value in wanted.items():
        if value is not None and value is not False:
            raise Unsupported(f"{name}={value!r} is not supported; omit it")
    if render_mode not in _MODES:
        raise Unsupported(f"render_mode {render_mode!r} is not supported; use {', '.join(_MODES)}")
    if rasterize_mode not in ("classic", "antialiased"):
        raise Unsupported(f"rasterize_mode {rasterize_mode!r} is not supported; use classic or antialiased")
    width, height = _whole(width, "width"), _whole(height, "height")
    if not (0 < width <= 65536 and 0 < height <= 65536):
        raise InvalidInput(f"{width} × {height} is no size; use 1 to 65536 pixels")
    if sh_degree is not None:
        sh_degree = _whole(sh_degree, "sh_degree")
        if sh_degree > 3:
            raise Unsupported(f"sh_degree={sh_degree} is not supported; use 0 to 3")
        if sh_degree < 0:
            raise InvalidInput(f"sh_degree is {sh_degree}; use 0 to 3")
    return Options(
        width=width,
        height=height,
        near_plane=_real(near_plane, "near_plane"),
        far_plane=_real(far_plane, "far_plane"),
        radius_clip=_real(radius_clip, "radius_clip"),
        eps2d=_real(eps2d, "eps2d"),
        sh_degree=sh_degree,
        packed=bool(packed),
        tile_size=16 if tile_size is None else _whole(tile_size, "tile_size"),
        render_mode=render_mode,
        antialiased=rasterize_mode == "antialiased",
        absgrad=bool(absgrad),
    )


class Arguments(NamedTuple):
    """Arrays of a rasterisation, or tensors."""

    means: Any
    quats: Any
    scales: Any
    opacities: Any
    colors: Any
    viewmats: Any
    Ks: Any
    backgrounds: Any


def forward(arguments: Arguments, options: Options, *, taped: bool, views: bool) -> Forward:
    """Checks shapes and renders; keeps what gradients need if `taped`."""
    means, quats, scales, opacities, colors, viewmats, Ks, backgrounds = arguments
    means = floats(means, "means")
    if means.ndim > 2:
        raise Unsupported(f"means has the shape {list(means.shape)}; batches have no vjp, use [N, 3]")
    check(means.shape, "means", ("N", 3))
    count = len(means)
    quats = shaped(quats, "quats", (count, 4))
    scales = shaped(scales, "scales", (count, 3))
    opacities = shaped(opacities, "opacities", (count,))
    viewmats = shaped(viewmats, "viewmats", ("C", 4, 4))
    cameras = len(viewmats)
    if cameras == 0:
        raise InvalidInput("viewmats has no camera")
    Ks = shaped(Ks, "Ks", (cameras, 3, 3))
    colors = floats(colors, "colors")
    is_each = _check_colors(colors, count, cameras, options)
    channels = colors.shape[-1]
    if backgrounds is not None:
        backgrounds = shaped(backgrounds, "backgrounds", (cameras, channels if options.has_colors else 1))
        # Depths have no background.
        backgrounds = _padded(backgrounds) if options.has_colors else None
    padded = _padded(colors)
    if options.absgrad and padded.shape[-1] > 3 and options.has_colors:
        raise Unsupported(f"absgrad with {channels} channels is not supported; use at most 3")

    def call(cameras: slice, first: int) -> tuple[Any, Part]:
        taken = slice(first, first + 3)
        # Depths are in the first call.
        mode = options.render_mode if first == 0 else "RGB"
        drawn = _core.rasterize(
            means,
            quats,
            scales,
            opacities,
            np.ascontiguousarray((padded[cameras.start] if is_each else padded)[..., taken]).reshape(-1, 3),
            options.sh_degree,
            viewmats[cameras],
            Ks[cameras],
            None if backgrounds is None else np.ascontiguousarray(backgrounds[cameras, taken]),
            options.width,
            options.height,
            options.near_plane,
            options.far_plane,
            options.radius_clip,
            options.eps2d,
            options.antialiased,
            mode,
            taped,
            views,
            options.absgrad,
        )
        return drawn, Part(cameras, taken, "RGB" in mode, "D" in mode, drawn[5])

    alike = [slice(index, index + 1) for index in range(cameras)] if is_each else [slice(0, cameras)]
    firsts = range(0, padded.shape[-1], 3) if options.has_colors else range(1)
    calls = [[call(one, first) for first in firsts] for one in alike]

    def pictures(drawn: list[Any]) -> Any:
        """Pictures of some cameras from their channels."""
        if len(drawn) == 1 and channels == 3:
            return drawn[0][0]
        colors = [picture[0][..., : 3 if options.has_colors else 0] for picture in drawn]
        depths = drawn[0][0][..., -1:] if options.has_depths else drawn[0][0][..., :0]
        return np.concatenate([np.concatenate(colors, axis=-1)[..., :channels], depths], axis=-1)

    def joined(position: int) -> Any:
        return _joined([drawn[0][0][position] for drawn in calls], axis=0)

    return Forward(
        colors=_joined([pictures([drawn for drawn, _ in of_camera]) for of_camera in calls], axis=0),
        alphas=joined(1),
        radii=joined(2),
        means2d=joined(3),
        depths=joined(4),
        parts=[part for of_camera in calls for _, part in of_camera],
        color_shape=colors.shape,
        color_channels=channels,
    )


def _joined(arrays: list[Any], axis: int) -> Any:
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=axis)


def _sum(arrays: list[Any]) -> Any:
    total = arrays[0]
    for array in arrays[1:]:
        total = total + array
    return total


def _check_colors(colors: Floats, count: int, cameras: int, options: Options) -> bool:
    """Whether there are colours for each camera; raises for other shapes."""
    shape = list(colors.shape)
    if options.sh_degree is None:
        least, kinds = 2, "[N, D] or [C, N, D]"
    else:
        least, kinds = 3, "[N, K, 3] or [C, N, K, 3]"
    is_each = colors.ndim == least + 1
    inner = shape[1:] if is_each else shape
    fits = len(inner) == least and inner[0] == count and (not is_each or shape[0] == cameras)
    if not fits:
        raise InvalidInput(
            f"colors has the shape {shape} for {count} Gaussians and {cameras} cameras; use {kinds}"
            + (", or give sh_degree for harmonics" if options.sh_degree is None else "")
        )
    if inner[-1] == 0:
        raise InvalidInput("colors has no channel")
    if options.sh_degree is not None:
        if inner[-1] != 3:
            raise Unsupported(f"harmonics have {inner[-1]} channels; use 3, others are not supported")
        needed = (options.sh_degree + 1) ** 2
        if inner[1] < needed:
            raise InvalidInput(f"sh_degree {options.sh_degree} needs {needed} coefficients; colors has {inner[1]}")
        if inner[1] not in (1, 4, 9, 16):
            raise Unsupported(f"colors has {inner[1]} coefficients; use 1, 4, 9 or 16")
    return is_each


def is_tensor(value: Any) -> bool:
    """Whether a value is a tensor of torch, which is not imported for this."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.Tensor)


def rasterization(
    means: Any,
    quats: Any,
    scales: Any,
    opacities: Any,
    colors: Any,
    viewmats: Any,
    Ks: Any,
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int = 16,
    backgrounds: Any = None,
    render_mode: RenderMode = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: RasterizeMode = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: Literal["pinhole", "ortho", "fisheye", "ftheta"] = "pinhole",
    segmented: bool = False,
    covars: Any = None,
    with_ut: bool = False,
    with_eval3d: bool = False,
    radial_coeffs: Any = None,
    tangential_coeffs: Any = None,
    thin_prism_coeffs: Any = None,
    ftheta_coeffs: Any = None,
    rolling_shutter: Any = None,
    viewmats_rs: Any = None,
) -> tuple[Any, Any, Meta]:
    """Rasterises N Gaussians into the pictures of C cameras, by gsplat's call and conventions.

    Tensors of torch on the CPU give tensors with gradients with respect to means, quats, scales,
    opacities, colors, viewmats and backgrounds; arrays of numpy give arrays. Cameras have OpenCV's
    axes, pixel centres are at + 0.5. A splat is skipped in pixels where its alpha is below 1/255; a
    pixel ends where its transmittance would fall to 1e-4. These cuts have no gradient.

    Args:
        means: [N, 3], centres in the world.
        quats: [N, 4], rotations as w, x, y, z, of any length but 0.
        scales: [N, 3], standard deviations, above 0.
        opacities: [N], from 0 to 1.
        colors: [N, D] or [C, N, D], D = 3 for colours, any for features, which take D / 3 passes;
            with `sh_degree`, harmonics [N, K, 3] or [C, N, K, 3].
        viewmats: [C, 4, 4], from the world to the cameras.
        Ks: [C, 3, 3], intrinsics in pixels, without skew; they get no gradient.
        width, height: size of the pictures in pixels.
        near_plane, far_plane: Gaussians with other depths are not drawn.
        radius_clip: Gaussians whose radii are both at most this many pixels are not drawn.
        eps2d: variance that is added to splats, in square pixels; 0.3, or 0.1 if antialiased.
        sh_degree: harmonics to evaluate, 0 to 3; a colour is max(sum + 0.5, 0).
        packed: whether the arrays of `meta` have entries only for splats that are drawn.
        backgrounds: [C, D], colours behind the Gaussians.
        render_mode: colours, accumulated depth D, expected depth ED, or both.
        absgrad: whether a backward pass through tensors also sets `meta["means2d"].absgrad`, the sums
            over the pixels of the absolute gradients of the splats' centres; for at most 3 channels.
        rasterize_mode: "antialiased" compensates opacities for eps2d.
        tile_size, channel_chunk, segmented: without influence.

    Batch dimensions, the same ones of every array, may precede these shapes; each batch is
    rasterised by itself. Other arguments are gsplat's and raise `Unsupported` unless they have
    their default.

    Returns:
        Pictures [C, H, W, X], coverages [C, H, W, 1] and `Meta`, after the batch dimensions. X is
        D, 1 for depths, or D + 1.
    """
    options = options_of(
        width=width,
        height=height,
        near_plane=near_plane,
        far_plane=far_plane,
        radius_clip=radius_clip,
        eps2d=eps2d,
        sh_degree=sh_degree,
        packed=packed,
        tile_size=tile_size,
        render_mode=render_mode,
        sparse_grad=sparse_grad,
        absgrad=absgrad,
        rasterize_mode=rasterize_mode,
        distributed=distributed,
        camera_model=camera_model,
        covars=covars,
        with_ut=with_ut,
        with_eval3d=with_eval3d,
        radial_coeffs=radial_coeffs,
        tangential_coeffs=tangential_coeffs,
        thin_prism_coeffs=thin_prism_coeffs,
        ftheta_coeffs=ftheta_coeffs,
        rolling_shutter=_moving(rolling_shutter),
        viewmats_rs=viewmats_rs,
    )
    arguments = Arguments(means, quats, scales, opacities, colors, viewmats, Ks, backgrounds)
    batch = _shape(means)[:-2]
    return _rasterize_batches(arguments, options, batch) if batch else _rasterize(arguments, options)


def _rasterize(arguments: Arguments, options: Options) -> tuple[Any, Any, Meta]:
    if any(is_tensor(array) for array in arguments):
        from ._torch import rasterize_tensors

        return rasterize_tensors(arguments, options)
    if options.absgrad:
        raise Unsupported("absgrad=True is not supported for arrays; use tensors of torch")
    done = forward(arguments, options, taped=False, views=False)
    return done.colors, done.alphas, _meta_of(done, options)


def _shape(array: Any) -> tuple[int, ...]:
    if hasattr(array, "shape"):
        return tuple(array.shape)
    try:
        return np.shape(array)
    except ValueError as error:
        raise InvalidInput(f"means is no array: {error}") from None


def _rasterize_batches(arguments: Arguments, options: Options, batch: tuple[int, ...]) -> tuple[Any, Any, Meta]:
    """Rasterises every batch by itself."""
    if options.absgrad:
        raise Unsupported("absgrad=True is not supported in batches; rasterise each by itself")
    count = math.prod(batch)
    if count == 0:
        raise InvalidInput(f"means has the shape {list(_shape(arguments.means))}, which has no batch")
    flat: list[Any] = []
    for name, array in zip(Arguments._fields, arguments):
        if array is not None and not hasattr(array, "shape"):
            array = floats(array, name)
        if array is not None and tuple(array.shape[: len(batch)]) != batch:
            raise InvalidInput(f"{name} has the shape {list(array.shape)}; it begins with {list(batch)}, as means does")
        flat.append(None if array is None else array.reshape(count, *array.shape[len(batch) :]))
    calls = [_rasterize(Arguments(*(None if array is None else array[k] for array in flat)), options) for k in range(count)]
    colors, alphas, metas = zip(*calls)

    def stacked(arrays: Any) -> Any:
        return _stack(arrays).reshape(*batch, *arrays[0].shape)

    meta = Meta(metas[0])
    for name in ("means2d", "radii", "depths"):
        arrays = [one[name] for one in metas]
        meta[name] = _concatenate(arrays) if options.packed else stacked(arrays)
    meta["batch_ids"] = None
    if options.packed:
        for name in ("camera_ids", "gaussian_ids"):
            meta[name] = _concatenate([one[name] for one in metas])
        ids = [one["gaussian_ids"] for one in metas]
        meta["batch_ids"] = _concatenate([one * 0 + k for k, one in enumerate(ids)])
    meta["n_batches"] = count
    return stacked(colors), stacked(alphas), meta


def _stack(arrays: Any) -> Any:
    return sys.modules["torch"].stack(arrays) if is_tensor(arrays[0]) else np.stack(arrays)


def _concatenate(arrays: Any) -> Any:
    return sys.modules["torch"].cat(arrays) if is_tensor(arrays[0]) else np.concatenate(arrays)


def rasterization_vjp(
    means: Any,
    quats: Any,
    scales: Any,
    opacities: Any,
    colors: Any,
    viewmats: Any,
    Ks: Any,
    width: int,
    height: int,
    *,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = False,
    backgrounds: Any = None,
    render_mode: RenderMode = "RGB",
    rasterize_mode: RasterizeMode = "classic",
) -> tuple[Floats, Floats, Meta, Callable[..., Gradients]]:
    """Rasterises arrays of numpy as `rasterization`, and gives the function of its gradients.

    Returns:
        Pictures, coverages, `Meta`, and `vjp(grad_colors=None, grad_alphas=None) -> Gradients`,
        whose arguments are the gradients of a loss with respect to the pictures [C, H, W, X] and
        the coverages [C, H, W, 1]; None stands for zeros.
    """
    options = options_of(
        width=width,
        height=height,
        near_plane=near_plane,
        far_plane=far_plane,
        radius_clip=radius_clip,
        eps2d=eps2d,
        sh_degree=sh_degree,
        packed=packed,
        tile_size=16,
        render_mode=render_mode,
        sparse_grad=False,
        absgrad=False,
        rasterize_mode=rasterize_mode,
        distributed=False,
        camera_model="pinhole",
    )
    arguments = Arguments(means, quats, scales, opacities, colors, viewmats, Ks, backgrounds)
    done = forward(arguments, options, taped=True, views=True)

    def vjp(grad_colors: Any = None, grad_alphas: Any = None) -> Gradients:
        if grad_colors is not None:
            grad_colors = shaped(grad_colors, "grad_colors", done.colors.shape)
        if grad_alphas is not None:
            grad_alphas = shaped(grad_alphas, "grad_alphas", done.alphas.shape)
        grads = done.vjp(grad_colors, grad_alphas)
        background = grads.pop("backgrounds")
        if backgrounds is None:
            return Gradients(backgrounds=None, **grads)
        return Gradients(backgrounds=background if options.has_colors else np.zeros((len(background), 1), np.float32), **grads)

    return done.colors, done.alphas, _meta_of(done, options), vjp


def _meta_of(done: Forward, options: Options) -> Meta:
    if not options.packed:
        return done.meta(options, done.means2d, done.radii, done.depths, None)
    ids = done.ids()
    return done.meta(options, done.means2d[ids], done.radii[ids], done.depths[ids], ids)


def _moving(rolling_shutter: Any) -> Any:
    """A rolling shutter that is one."""
    return None if getattr(rolling_shutter, "name", rolling_shutter) == "GLOBAL" else rolling_shutter
