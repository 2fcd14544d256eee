"""Conversion and shapes of arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ._errors import InvalidInput

Floats = npt.NDArray[np.float32]


def floats(value: Any, name: str) -> Floats:
    """The value as an array of 32-bit floats in rows; the value itself where it is one."""
    try:
        array = np.asarray(value)
    except Exception as error:
        raise InvalidInput(f"{name} is no array of numbers: {error}") from None
    if array.dtype.kind not in "fiub":
        raise InvalidInput(f"{name} is an array of {array.dtype}, not of real numbers")
    with np.errstate(over="ignore"):
        return np.asarray(array, np.float32, order="C")


def shaped(value: Any, name: str, shape: tuple[int | str, ...]) -> Floats:
    """An array of this shape, in which letters stand for any length."""
    array = floats(value, name)
    check(array.shape, name, shape)
    return array


def check(found: tuple[int, ...], name: str, shape: tuple[int | str, ...]) -> None:
    """Refuses an array of another shape."""
    fits = len(found) == len(shape) and all(isinstance(w, str) or w == n for w, n in zip(shape, found))
    if not fits:
        wanted = ", ".join(str(n) for n in shape)
        raise InvalidInput(f"{name} has the shape {list(found)}; use [{wanted}]")


def rows(*values: tuple[Any, str, int]) -> tuple[list[Floats], tuple[int, ...]]:
    """Arrays as rows of their last axes, after their other axes are broadcast, and those axes.

    Each value comes with its name and the length of its last axis; length 0 stands for no such
    axis.
    """
    arrays = []
    for value, name, width in values:
        array = floats(value, name)
        if width and (array.ndim == 0 or array.shape[-1] != width):
            raise InvalidInput(f"{name} has the shape {list(array.shape)}; use [..., {width}]")
        arrays.append(array)
    leading = [array.shape[:-1] if width else array.shape for array, (_, _, width) in zip(arrays, values)]
    try:
        common = np.broadcast_shapes(*leading)
    except ValueError:
        listed = ", ".join(f"{name} {list(array.shape)}" for array, (_, name, _) in zip(arrays, values))
        raise InvalidInput(f"the shapes {listed} do not go together") from None
    flat = []
    for array, (_, _, width) in zip(arrays, values):
        full = np.broadcast_to(array, (*common, width) if width else common)
        flat.append(np.ascontiguousarray(full).reshape((-1, width) if width else (-1,)))
    return flat, common
