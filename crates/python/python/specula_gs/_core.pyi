"""Extension module: the crates of the project behind arrays."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Camera",
    "Light",
    "PrefilteredLight",
    "Renderer",
    "Scene",
    "Tape",
    "View",
    "__version__",
    "cube_to_latlong",
    "ggx",
    "latlong_to_cube",
    "load_views",
    "normal_mae",
    "prefilter",
    "psnr",
    "rasterize",
    "run_program",
    "shade",
    "shade_physical",
    "split_sum",
    "ssim",
    "flip",
    "thread_count",
    "train",
]

__version__: str

_Path = str | PathLike[str]
_Color = tuple[float, float, float] | Sequence[float]
_Split = Literal["all", "train", "test"]

@final
class Camera:
    """Pinhole camera of OpenCV's axes: x to the right, y down, z forward; pixel centres at + 0.5."""

    def __new__(
        cls, viewmat: ArrayLike, K: ArrayLike, width: int, height: int, *, near: float = 0.01, name: str = ""
    ) -> Camera: ...
    @staticmethod
    def look_at(
        eye: Sequence[float],
        target: Sequence[float],
        up: Sequence[float],
        fov_x: float,
        width: int,
        height: int,
        *,
        near: float = 0.01,
        name: str = "",
    ) -> Camera:
        """Camera at `eye` that looks at `target`, with `up` upwards in the picture.

        `fov_x` is the horizontal field of view in radians, between 0 and π.
        """

    def resized(self, width: int, height: int) -> Camera:
        """The same view at another size; focal lengths and principal point scale along."""

    @property
    def viewmat(self) -> NDArray[np.float32]:
        """Matrix from the world to the camera, [4, 4]."""

    @property
    def K(self) -> NDArray[np.float32]:
        """Intrinsics in pixels, [3, 3]."""

    @property
    def position(self) -> list[float]:
        """Centre in the world."""

    @property
    def width(self) -> int:
        """Pixels in a row."""

    @property
    def height(self) -> int:
        """Rows."""

    @property
    def near(self) -> float:
        """Depth from which on Gaussians are drawn."""

    @property
    def name(self) -> str:
        """Name in its data set."""

@final
class View:
    """Picture of a data set with its camera."""

    @property
    def camera(self) -> Camera:
        """Camera of the picture."""

    @property
    def rgba(self) -> NDArray[np.uint8]:
        """Pixels [H, W, 4] in 8-bit sRGB with straight alpha."""

    @property
    def unclipped(self) -> NDArray[np.float32] | None:
        """Colours [H, W, 3] of a linear picture, on the curve of sRGB without a limit at white.

        A training fits these. None for pictures of 8 bits."""

    @property
    def normals(self) -> NDArray[np.float32] | None:
        """Unit normals [H, W, 3] in the world, 0 where there is none; None without ground truth."""

def load_views(dataset: _Path, split: Literal["train", "test"] = "train", *, downscale: int = 1) -> list[View]:
    """Pictures of a data set, of any kind that the program reads, and their cameras.

    `split` names those to train on or those held out: no picture is in both. Pictures are made
    smaller by `downscale`: 1, 2, 4 or 8.
    """

@final
class Light:
    """Light that replaces that of a scene: an environment map, suns and lamps."""

    @staticmethod
    def load(path: _Path, *, up: Literal["scene", "y", "z"] = "scene", exposure: float = 0.0) -> Light:
        """Light of a file: a lat-long map of linear radiance, `.hdr` or `.exr`.

        `up` is the direction of the scene at the upper edge of the map; `exposure` is in stops.
        """

    @staticmethod
    def from_latlong(map: ArrayLike, *, up: Literal["scene", "y", "z"] = "scene") -> Light:
        """Light of a lat-long map [H, W, 3] of linear radiance, rows from the zenith."""

    @staticmethod
    def dark() -> Light:
        """Darkness, to which suns and lamps can be added."""

    def with_sun(
        self,
        azimuth: float,
        elevation: float,
        *,
        strength: float = 3.0,
        diameter: float = 0.53,
        color: str = "ffffff",
    ) -> Light:
        """The same light and a sun.

        Angles are in degrees, azimuths counterclockwise as seen from above, from the centre of an
        environment map. `strength` is the irradiance of a surface that faces a white sun, `color`
        its colour in sRGB as two hexadecimal digits for each of red, green and blue.
        """

    def with_lamp(
        self, position: Sequence[float], strength: float, *, radius: float = 0.0, color: str = "ffffff"
    ) -> Light:
        """The same light and a spherical lamp.

        `strength` is the radiant intensity of a white lamp: the irradiance at a distance of 1.
        """

    def turned(self, degrees: float) -> Light:
        """The same light, its map and suns turned about the up direction, counterclockwise from above."""

    @property
    def latlong(self) -> NDArray[np.float32] | None:
        """Environment map [H, W, 3]; None for darkness."""

    @property
    def lamp_count(self) -> int:
        """Number of suns and lamps."""

@final
class PrefilteredLight:
    """Environment, filtered into levels of roughness by `prefilter`."""

    @property
    def levels(self) -> list[tuple[float, NDArray[np.float32]]]:
        """Levels, sharpest first: perceptual roughness, and faces [6, N, N, 3]."""

    def _radiance(self, directions: NDArray[np.float32], roughness: NDArray[np.float32]) -> NDArray[np.float32]: ...
    def _irradiance(self, normals: NDArray[np.float32]) -> NDArray[np.float32]: ...

@final
class Renderer:
    """Scene on an executor, its light filtered, for many pictures."""

    def render(self, camera: Camera, *, background: _Color | None = None) -> dict[str, NDArray[np.float32]]:
        """Picture of a camera, layer by layer; see `Scene.render`."""

    @property
    def layers(self) -> list[str]:
        """Layers of each picture."""

@final
class Scene:
    """Scene of a model: Gaussians, their light, and the function of their colours."""

    @staticmethod
    def load(path: _Path) -> Scene:
        """Scene of a model's folder, or of a `.ply`, `.glb` or `.gltf` file."""

    def save(self, folder: _Path, *, iteration: int | None = None) -> None:
        """Writes the scene into the folder of a model, as the program reads it."""

    def cameras(self, split: _Split = "all") -> list[Camera]:
        """Cameras that the model records; empty for a file on its own."""

    def render(
        self,
        camera: Camera,
        layers: Sequence[str] = ...,
        *,
        background: _Color | None = None,
        executor: str = "auto",
    ) -> dict[str, NDArray[np.float32]]:
        """Picture of a camera, layer by layer.

        "rgb" [H, W, 3] is in sRGB over the background, by default that of the training; "alpha"
        [H, W] is coverage, "depth" [H, W] the distance along the optical axis, "normal" [H, W, 3]
        in the world. Other layers of shaded scenes are those of the program's `render --layers`:
        colours [H, W, 3], numbers [H, W], premultiplied. For many pictures, `renderer` is faster.
        """

    def renderer(self, layers: Sequence[str] = ..., *, executor: str = "auto") -> Renderer:
        """Renderer of many pictures. A later change of the scene does not change it."""

    def relight(self, light: Light, *, shadows: bool = True) -> None:
        """Puts the scene under another light, in place.

        Physical materials take the place of view-dependent colours where there are any. Suns and
        lamps need them; with `shadows`, a surface that is fused from the scene's depths occludes
        them.
        """

    def fit_light(
        self,
        views: Sequence[View],
        *,
        iterations: int = 900,
        background: _Color | None = None,
        executor: str = "auto",
    ) -> Light:
        """Light of pictures of the scene: geometry and materials are held, the light is fitted.

        `views` are those of `load_views`, in the world of the scene, cut out by alpha; `background`
        is behind them, by default that of the training. The scene is not changed: `relight` shows
        it under the light. Ctrl-C raises KeyboardInterrupt.
        """

    def shade_as(self, shading: Literal["view", "physical"]) -> None:
        """Shows view-dependent colours or physical materials, in place."""

    def export(
        self, path: _Path, *, sh_degree: int = 3, min_opacity: float = 0.0, upright: bool = False
    ) -> None:
        """Writes plain Gaussians for other programs: `.ply`, `.splat`, `.spz` or `.glb`.

        Colours of shaded scenes are baked into harmonics under the present light.
        """

    def gaussians(self, *, sh_degree: int = 3) -> dict[str, Any]:
        """Plain Gaussians as arguments of `rasterization`; colours of shaded scenes are baked.

        means [N, 3], quats [N, 4], scales [N, 3], opacities [N], colors [N, K, 3], and sh_degree.
        """

    def __len__(self) -> int: ...
    @property
    def is_shaded(self) -> bool:
        """Whether colours depend on a light."""

    @property
    def has_materials(self) -> bool:
        """Whether the scene has physical materials."""

    @property
    def background(self) -> list[float]:
        """Background of the training in sRGB."""

    @property
    def up(self) -> list[float]:
        """Unit up direction in the world."""

    @property
    def notes(self) -> list[str]:
        """Notes on parts of the files that are not taken as they are, a sentence each."""

@final
class Tape:
    """What the gradient of a rasterisation needs."""

    def vjp(
        self, grad_colors: NDArray[np.float32] | None, grad_alphas: NDArray[np.float32] | None
    ) -> dict[str, NDArray[np.float32]]: ...

def train(
    dataset: _Path,
    folder: _Path,
    *,
    profile: Literal["specula", "paper", "official", "3dgs"] = ...,
    iterations: int = 30000,
    seed: int = 0,
    background: _Color | None = None,
    random_points: int | None = None,
    downscale: int = 1,
    hold_out: bool = False,
    executor: str = "auto",
    checkpoint_every: int = 1000,
    resume: bool = False,
    overwrite: bool = False,
    callback: Callable[[int, float | None, int], object] | None = None,
    callback_every: int = 100,
) -> Scene:
    """Trains a model on a data set into a folder, as the program does, and loads it.

    `callback(iteration, psnr, gaussians)` is called after every `callback_every` steps; psnr is in
    dB, of training pictures. Ctrl-C, or an exception of the callback, ends the training with a
    checkpoint and a saved model; `resume=True` continues it. The same seed gives the same bits, whatever the number
    of threads.

    Args:
        profile: shading function and settings, "specula" by default; "3dgs" has plain Gaussians.
        background: colour behind the Gaussians in sRGB; by default white where pictures are
            transparent, else black.
        random_points: points to start from in place of those of the data set.
        downscale: factor by which pictures are made smaller, 1, 2, 4 or 8.
        hold_out: whether test views are held out; otherwise they are trained on too, and say nothing
            about new views.
        checkpoint_every: steps between checkpoints; 0 for none before the end.
        overwrite: whether a training in the folder is replaced.
    """

def thread_count() -> int:
    """Number of threads that calls compute on."""

def run_program(program: list[str], arguments: list[str]) -> int:
    """Runs the program with these arguments, and returns its exit code; `program` starts it again."""

def rasterize(
    means: NDArray[np.float32],
    quats: NDArray[np.float32],
    scales: NDArray[np.float32],
    opacities: NDArray[np.float32],
    colors: NDArray[np.float32],
    sh_degree: int | None,
    viewmats: NDArray[np.float32],
    Ks: NDArray[np.float32],
    backgrounds: NDArray[np.float32] | None,
    width: int,
    height: int,
    near: float,
    far: float,
    radius_clip: float,
    eps2d: float,
    antialiased: bool,
    render_mode: str,
    is_taped: bool,
    view_gradients: bool,
    absolute_gradients: bool,
) -> tuple[
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.int32],
    NDArray[np.float32],
    NDArray[np.float32],
    Tape | None,
]: ...
def latlong_to_cube(map: ArrayLike, resolution: int, *, up: str = "z") -> NDArray[np.float32]: ...
def cube_to_latlong(cube: ArrayLike, height: int, *, up: str = "z") -> NDArray[np.float32]: ...
def prefilter(cube: ArrayLike, scheme: str = "exact") -> PrefilteredLight: ...
def ggx(n_dot_h: NDArray[np.float32], roughness: NDArray[np.float32]) -> NDArray[np.float32]: ...
def split_sum(n_dot_v: NDArray[np.float32], roughness: NDArray[np.float32]) -> NDArray[np.float32]: ...
def shade(
    light: PrefilteredLight,
    normals: NDArray[np.float32],
    view_dirs: NDArray[np.float32],
    diffuse: NDArray[np.float32],
    tint: NDArray[np.float32],
    roughness: NDArray[np.float32],
    residual: NDArray[np.float32],
    form: str,
) -> NDArray[np.float32]: ...
def shade_physical(
    light: PrefilteredLight,
    normals: NDArray[np.float32],
    view_dirs: NDArray[np.float32],
    albedo: NDArray[np.float32],
    metalness: NDArray[np.float32],
    roughness: NDArray[np.float32],
) -> NDArray[np.float32]: ...
def psnr(a: ArrayLike, b: ArrayLike, *, quantized: bool = True) -> float: ...
def ssim(a: ArrayLike, b: ArrayLike) -> float: ...
def flip(reference: ArrayLike, test: ArrayLike) -> float: ...
def normal_mae(a: ArrayLike, b: ArrayLike, mask: ArrayLike | None = None) -> float: ...
