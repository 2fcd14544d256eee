"""Differentiable Gaussian splatting and relightable scenes, on the CPU.

`rasterization` is gsplat's call for arrays of numpy and tensors of torch. `Scene` reads, renders,
relights and exports models of the program specula; `train` makes them. `prefilter`, `shade` and
their kin are image-based lighting as a library.

Functions compute on all cores, or on `RAYON_NUM_THREADS` of them, with the interpreter released;
results do not depend on the number. An array must not change while another thread computes with it.
"""

from ._core import Camera, Light, PrefilteredLight, Renderer, Scene, View, __version__, load_views, thread_count, train
from ._errors import DeviceError, FileError, InvalidInput, SpeculaError, TrainingError, Unsupported, UnsupportedKey
from ._rasterization import Gradients, Meta, rasterization, rasterization_vjp
from ._shading import (
    cube_to_latlong,
    flip,
    ggx,
    irradiance,
    latlong_to_cube,
    normal_mae,
    prefilter,
    psnr,
    radiance,
    shade,
    shade_physical,
    split_sum,
    ssim,
)

__all__ = [
    "Camera",
    "DeviceError",
    "FileError",
    "Gradients",
    "InvalidInput",
    "Light",
    "Meta",
    "PrefilteredLight",
    "Renderer",
    "Scene",
    "SpeculaError",
    "TrainingError",
    "Unsupported",
    "UnsupportedKey",
    "View",
    "__version__",
    "cube_to_latlong",
    "flip",
    "ggx",
    "irradiance",
    "latlong_to_cube",
    "load_views",
    "normal_mae",
    "prefilter",
    "psnr",
    "radiance",
    "rasterization",
    "rasterization_vjp",
    "shade",
    "shade_physical",
    "split_sum",
    "ssim",
    "thread_count",
    "train",
]
