"""Image-based lighting and shading as a library; measures of pictures."""

from __future__ import annotations

import operator
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import _core
from ._arrays import Floats, floats, rows
from ._core import PrefilteredLight
from ._errors import InvalidInput

Up = Literal["y", "z"]


def count(value: Any, name: str) -> int:
    """A whole number of 0 or more."""
    try:
        number = operator.index(value)
    except TypeError:
        raise InvalidInput(f"{name} is {value!r}; use a whole number") from None
    if not 0 <= number < 1 << 31:
        raise InvalidInput(f"{name} is {number}; use a whole number from 0")
    return number


def latlong_to_cube(map: ArrayLike, resolution: int, *, up: Up = "z") -> Floats:
    """Resamples a lat-long map to a cube map; each texel is the mean radiance over its solid angle.

    Args:
        map: linear radiance, [H, W, 3], rows from the zenith.
        resolution: texels along an edge of a face.
        up: world axis at the upper edge of the map, "z" as in Blender or "y" as in nvdiffrec.

    Returns:
        [6, N, N, 3]: faces +x, −x, +y, −y, +z, −z as Vulkan, OpenGL and Direct3D look them up.
    """
    return _core.latlong_to_cube(map, count(resolution, "resolution"), up=up)


def cube_to_latlong(cube: ArrayLike, height: int, *, up: Up = "z") -> Floats:
    """Resamples a cube map [6, N, N, 3] to a lat-long map [height, 2 · height, 3].

    The inverse of `latlong_to_cube`, up to the resampling.
    """
    return _core.cube_to_latlong(cube, count(height, "height"), up=up)


def prefilter(
    env: ArrayLike,
    *,
    resolution: int | None = None,
    up: Up = "z",
    scheme: Literal["exact", "official"] = "exact",
) -> PrefilteredLight:
    """Filters an environment by GGX lobes into levels of roughness.

    Args:
        env: linear radiance, a cube map [6, N, N, 3] or a lat-long map [H, W, 3].
        resolution: texels along an edge of a face, a power of two; only for lat-long maps, 128 by
            default.
        up: world axis at the upper edge of a lat-long map.
        scheme: "exact" integrates over solid angles, "official" is the filter of GaussianShader's
            code.
    """
    env = floats(env, "env")
    if env.ndim == 4:
        if resolution is not None:
            raise InvalidInput("a cube map has its own resolution; omit resolution")
        return _core.prefilter(env, scheme)
    return _core.prefilter(latlong_to_cube(env, 128 if resolution is None else resolution, up=up), scheme)


def radiance(light: PrefilteredLight, directions: ArrayLike, roughness: ArrayLike) -> Floats:
    """Filtered radiance along directions.

    Args:
        light: levels of `prefilter`.
        directions: [..., 3], of any length but 0, in the world.
        roughness: [...], perceptual, from 0 to 1; GGX's α is its square.

    Returns:
        [..., 3], linear.
    """
    (directions, roughness), leading = rows((directions, "directions", 3), (roughness, "roughness", 0))
    return light._radiance(directions, roughness).reshape(*leading, 3)


def irradiance(light: PrefilteredLight, normals: ArrayLike) -> Floats:
    """Irradiance / π along normals [..., 3]: the colour of a white wall."""
    (normals,), leading = rows((normals, "normals", 3))
    return light._irradiance(normals).reshape(*leading, 3)


def ggx(n_dot_h: ArrayLike, roughness: ArrayLike) -> Floats:
    """Density D of the GGX distribution (Walter et al. 2007, eq. 33), in 1/sr.

    Args:
        n_dot_h: [...], cosine between normal and half vector, from 0 to 1.
        roughness: [...], perceptual, from 0 to 1; α is its square.
    """
    (n_dot_h, roughness), leading = rows((n_dot_h, "n_dot_h", 0), (roughness, "roughness", 0))
    return _core.ggx(n_dot_h, roughness).reshape(leading)


def split_sum(n_dot_v: ArrayLike, roughness: ArrayLike) -> Floats:
    """Scale and bias of the reflectance at normal incidence (Karis 2013), within 2e-4.

    With height-correlated Smith shadowing and Schlick's Fresnel.

    Args:
        n_dot_v: [...], cosine between normal and view, from 0 to 1.
        roughness: [...], perceptual, from 0 to 1.

    Returns:
        [..., 2], both from 0 to 1.
    """
    (n_dot_v, roughness), leading = rows((n_dot_v, "n_dot_v", 0), (roughness, "roughness", 0))
    return _core.split_sum(n_dot_v, roughness).reshape(*leading, 2)


def shade(
    light: PrefilteredLight,
    normals: ArrayLike,
    view_dirs: ArrayLike,
    diffuse: ArrayLike,
    tint: ArrayLike,
    roughness: ArrayLike,
    residual: ArrayLike = (0.0, 0.0, 0.0),
    *,
    form: Literal["paper", "official"] = "paper",
) -> Floats:
    """Colours of surface points by GaussianShader's shading function, in sRGB.

    "paper": γ(diffuse + tint ⊙ L(r, roughness) + residual), γ the sRGB curve, r the view direction
    mirrored at the normal. "official": the sum of the authors' code, with an ambient term and a
    split sum, without γ.

    Args:
        light: levels of `prefilter`.
        normals: [..., 3], in the world, of any length but 0.
        view_dirs: [..., 3], from the point to the eye, of any length but 0.
        diffuse, tint, residual: [..., 3], linear.
        roughness: [...], perceptual, from 0 to 1.

    Returns:
        [..., 3].
    """
    named = (
        (normals, "normals", 3),
        (view_dirs, "view_dirs", 3),
        (diffuse, "diffuse", 3),
        (tint, "tint", 3),
        (roughness, "roughness", 0),
        (residual, "residual", 3),
    )
    (normal, view, base, specular, rough, rest), leading = rows(*named)
    return _core.shade(light, normal, view, base, specular, rough, rest, form).reshape(*leading, 3)


def shade_physical(
    light: PrefilteredLight,
    normals: ArrayLike,
    view_dirs: ArrayLike,
    albedo: ArrayLike,
    metalness: ArrayLike,
    roughness: ArrayLike,
) -> Floats:
    """Colours of surface points of physical materials under a light from far away, in sRGB.

    The metallic-roughness model with a reflectance of dielectrics of 0.04; nothing casts shadows.

    Args:
        light: levels of `prefilter`.
        normals: [..., 3], in the world, of any length but 0.
        view_dirs: [..., 3], from the point to the eye, of any length but 0.
        albedo: [..., 3], linear.
        metalness, roughness: [...], from 0 to 1.

    Returns:
        [..., 3].
    """
    named = (
        (normals, "normals", 3),
        (view_dirs, "view_dirs", 3),
        (albedo, "albedo", 3),
        (metalness, "metalness", 0),
        (roughness, "roughness", 0),
    )
    (normal, view, base, metal, rough), leading = rows(*named)
    return _core.shade_physical(light, normal, view, base, metal, rough).reshape(*leading, 3)


def psnr(a: ArrayLike, b: ArrayLike, *, quantized: bool = True) -> float:
    """Peak signal-to-noise ratio of two pictures [H, W, 3] in [0, 1], in dB; infinite for equal ones.

    Quantised to 8 bits first, as the program and the literature measure it, unless `quantized` is
    False.
    """
    return _core.psnr(a, b, quantized=bool(quantized))


def ssim(a: ArrayLike, b: ArrayLike) -> float:
    """Mean structural similarity of two pictures [H, W, 3] in [0, 1], quantised to 8 bits; at most 1."""
    return _core.ssim(a, b)


def flip(reference: ArrayLike, test: ArrayLike) -> float:
    """Mean ꟻLIP of two sRGB pictures [H, W, 3] in [0, 1]: the difference that is seen when they alternate.

    0 for equal pictures, at most 1, at 67 pixels per degree (Andersson et al. 2020).
    """
    return _core.flip(reference, test)


def normal_mae(a: ArrayLike, b: ArrayLike, mask: ArrayLike | None = None) -> float:
    """Mean angle between two pictures of normals [H, W, 3], in degrees.

    Over the pixels where both have a normal that is not 0 and `mask` [H, W], if given, is true.
    """
    return _core.normal_mae(a, b, None if mask is None else np.asarray(mask))
