"""The compiled part of the package. The docstrings are those that ``help`` shows, too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Callable, Literal, final

import numpy as np
import numpy.typing as npt

from ._types import BackendChoice, Floats, ImageSource, Path, Policy, Settings

@final
class Backend:
    """What computes: the CPU, or a GPU through Vulkan, Metal or Direct3D 12.

    :param name: "auto" (a GPU if there is a suitable one, otherwise the CPU), "cpu" or "wgpu".
    :param threads: threads on the host, 1 to 1024; by default one per core.
    :raises RuntimeError: where there is no such device; the message says what to install.

    Functions take a backend or its name. One backend may be used from several threads. After a
    fork, open another in the child process.
    """

    def __new__(cls, name: str = "auto", *, threads: int | None = None) -> Backend: ...
    @property
    def name(self) -> str:
        """ "cpu" or "wgpu"."""
    @property
    def reason(self) -> str:
        """What was chosen and why, in one line."""
    @property
    def threads(self) -> int:
        """Threads on the host."""

@final
class Camera:
    """A posed pinhole camera. Its axes are right, down, forward, as in OpenCV and COLMAP.

    :param width: columns of the image.
    :param height: rows of the image.
    :param fx: focal length, px; ``fy`` is the same by default.
    :param cx: principal point, px from the top-left corner; by default the centre, as ``cy``.
    :param rotation: world-to-camera rotation, (3, 3), row by row; by default the identity.
    :param translation: world-to-camera translation: x_camera = rotation @ x_world + translation;
        by default 0.
    :param near: near plane, world units: Gaussians whose mean is nearer are not drawn.
    :raises ValueError: for impossible values.
    """

    def __new__(
        cls,
        width: int,
        height: int,
        *,
        fx: float,
        fy: float | None = None,
        cx: float | None = None,
        cy: float | None = None,
        rotation: npt.ArrayLike | None = None,
        translation: npt.ArrayLike | None = None,
        near: float | None = None,
    ) -> Camera: ...
    @staticmethod
    def overview(scene: Scene3d, width: int = 800, height: int = 600) -> Camera:
        """A camera slightly above a scene that has most of it in view, as ``gs view`` begins.

        :raises ValueError: where nothing of the scene can be seen.
        """
    def looking_at(
        self, position: npt.ArrayLike, target: npt.ArrayLike, up: npt.ArrayLike | None = None
    ) -> Camera:
        """The same camera at another position, looking at a point.

        :param position: (3,), world units.
        :param target: the point to look at, (3,), world units.
        :param up: the direction that is up in the image, (3,); by default (0, -1, 0), because y
            points down.
        :raises ValueError: where the target is at the position, or straight up or down from it.
        """
    def moved(
        self,
        translation: npt.ArrayLike | None = None,
        rotation: npt.ArrayLike | None = None,
        *,
        focal: npt.ArrayLike | None = None,
        center: npt.ArrayLike | None = None,
    ) -> Camera:
        """The camera after a small move: against ``ForwardPass.camera_gradient``, for instance.

        A point in camera coordinates is turned by ``rotation`` and then shifted by ``translation``.
        All are 0 by default.

        :param translation: (3,), world units, along the camera's axes.
        :param rotation: an angle in radians times a unit axis, (3,), along the camera's axes.
        :param focal: added to the focal length, (2,), px.
        :param center: added to the principal point, (2,), px.
        :raises ValueError: where the camera would be impossible.
        """
    def resized(self, width: int, height: int) -> Camera:
        """The same view in an image of another size."""
    @property
    def width(self) -> int:
        """Columns of the image."""
    @property
    def height(self) -> int:
        """Rows of the image."""
    @property
    def position(self) -> list[float]:
        """Position, world units."""

@final
class Scene2d:
    """N Gaussians in the image plane.

    Coordinates are pixels of the image that the scene was made for: the origin is its top-left
    corner, y points down, and the centre of pixel (i, j) is (i + 0.5, j + 0.5). All arrays are
    float32. The constructor copies them. The attributes are read-only views of the scene's memory.

    :param means: (N, 2), px.
    :param log_scales: (N, 2), natural logarithms of standard deviations in px.
    :param rotations: (N,), rad, of the first axis, from +x towards +y.
    :param colors: (N, 3), RGB; may lie outside 0 to 1.
    :param opacity_logits: (N,), may be infinite; None for Gaussians without opacity, which are
        summed.
    :raises TypeError: for another dtype.
    :raises ValueError: for another shape, an array that is not C-contiguous, or a number that is
        not finite.
    """

    def __new__(
        cls,
        means: Floats,
        log_scales: Floats,
        rotations: Floats,
        colors: Floats,
        opacity_logits: Floats | None = None,
    ) -> Scene2d: ...
    @property
    def means(self) -> Floats:
        """(N, 2), px; read-only."""
    @property
    def log_scales(self) -> Floats:
        """(N, 2), natural logarithms of standard deviations in px; read-only."""
    @property
    def rotations(self) -> Floats:
        """(N,), rad; read-only."""
    @property
    def colors(self) -> Floats:
        """(N, 3), RGB; read-only."""
    @property
    def opacity_logits(self) -> Floats | None:
        """(N,), or None where Gaussians have no opacity; read-only."""
    @property
    def arrays(self) -> dict[str, Floats]:
        """All arrays by name, as the constructor takes them."""
    @property
    def size(self) -> tuple[int, int] | None:
        """Columns and rows of the image that the scene was made for, where they are known."""
    @property
    def profile(self) -> bytes | None:
        """ICC profile of the colours, which renderings have, too; ``None`` for sRGB.

        Pass it on with an image, as in Pillow's
        ``Image.fromarray(array).save("photo.png", icc_profile=scene.profile)``.
        """
    def save(self, path: Path, size: tuple[int, int] | None = None) -> None:
        """Write the scene to a file, ``.gs2d.safetensors``, without loss.

        :param size: columns and rows of the image, where the scene does not know them.
        :raises OSError: for a file that cannot be written.
        :raises ValueError: for another ending.
        """
    def _repr_png_(self) -> bytes | None:
        """The rendering, for notebooks; None where the size is not known."""
    def __len__(self) -> int: ...

@final
class Scene3d:
    """N Gaussians in 3D. World axes are x right, y down, z forward. All arrays are float32.

    :param means: (N, 3), world units.
    :param log_scales: (N, 3), natural logarithms of standard deviations in world units.
    :param rotations: (N, 4), quaternions (w, x, y, z) of any length. A Gaussian whose quaternion
        is 0 is not drawn.
    :param opacity_logits: (N,), may be infinite.
    :param sh: (N, K, 3) with K = 1, 4, 9 or 16; colour = 0.5 + SH(direction), clamped at 0.

    Errors are those of :class:`Scene2d`.
    """

    def __new__(
        cls,
        means: Floats,
        log_scales: Floats,
        rotations: Floats,
        opacity_logits: Floats,
        sh: Floats,
    ) -> Scene3d: ...
    @property
    def means(self) -> Floats:
        """(N, 3), world units; read-only."""
    @property
    def log_scales(self) -> Floats:
        """(N, 3), natural logarithms of standard deviations in world units; read-only."""
    @property
    def rotations(self) -> Floats:
        """(N, 4), quaternions (w, x, y, z); read-only."""
    @property
    def opacity_logits(self) -> Floats:
        """(N,); read-only."""
    @property
    def sh(self) -> Floats:
        """(N, K, 3), SH coefficients; read-only."""
    @property
    def arrays(self) -> dict[str, Floats]:
        """All arrays by name, as the constructor takes them."""
    @property
    def frame(self) -> tuple[list[float], float]:
        """Origin and unit of the scene's coordinates in the world of its data set: world = origin +
        unit * mean. ([0, 0, 0], 1) unless training moved the scene, as it does for georeferenced
        data sets."""
    @property
    def sh_degree(self) -> int:
        """SH degree, 0 to 3: K = (degree + 1)²."""
    def save(self, path: Path) -> None:
        """Write the scene in the format of the file name's ending.

        ``.ply`` keeps the scene without loss. ``.gltf`` and ``.glb`` keep it but for rounding.
        ``.spz``, ``.sog`` and ``.rad`` are compressed with loss; a SOG can also be a folder of
        files, named by its ``meta.json``. ``.rad`` has levels of detail, and so have a SOG named
        ``lod-meta.json`` and 3D Tiles, named ``tileset.json``. ``.splat`` has no SH above degree 0,
        and does not say with which antialiasing the scene was trained.

        :raises OSError: for a file that cannot be written, or another ending.
        """
    def edited(
        self,
        *operations: str,
        dataset: Path | None = None,
        reading: Settings | None = None,
        backend: BackendChoice = None,
    ) -> Scene3d:
        """A copy after operations, done from first to last, each written as for ``gs edit``.

        ``scene.edited("up=ground", "crop=sphere:0,0,0,4", "drop=opacity<0.02")`` levels the ground
        and removes what is far away or nearly transparent. ``gs edit --help`` lists the operations.
        ``floaters`` and ``contribution`` need the training views of a ``dataset``, which is read
        with ``reading`` as for ``evaluate``.

        :raises ValueError: for an operation that is unknown or cannot be done.
        :raises OSError: for a file to add or a data set that cannot be read.
        """
    def _repr_png_(self) -> bytes | None:
        """The scene from slightly above, for notebooks."""
    def __len__(self) -> int: ...

def load(
    path: Path, *, cameras: Sequence[Camera] | None = None, max_gaussians: int | None = None
) -> Scene2d | Scene3d:
    """Read a scene: a scene file, a checkpoint, or an output folder of ``gs``.

    2D scenes are ``.gs2d.safetensors`` and ``.gsi`` files. 3D scenes are PLY files (also
    compressed ones), ``.splat``, ``.ksplat``, SPZ, SOG, streamed SOG, RAD and glTF files.

    The finest level of a streamed SOG (``lod-meta.json``, or its folder) or a RAD is read. With
    ``cameras``, only the levels of detail that these need are read, as for
    ``gs render --max-gaussians``.

    :param cameras: read each cell in the coarsest level whose error is at most
        1 px in all of these cameras, in images of their size. Cells that no camera sees are read
        in their coarsest level, so an empty list reads the coarsest scene.
    :param max_gaussians: with ``cameras``, read at most this many Gaussians, at least 1. If they
        do not suffice for 1 px, the cells with the largest errors get finer levels first. By
        default there is no limit. The environment, which all levels share, is not counted. If the
        coarsest levels alone have more Gaussians, they are read with a Python warning.
    :raises OSError: for a file that cannot be read or is damaged.
    :raises TypeError: for ``cameras`` that are not a sequence of :class:`Camera`.
    :raises ValueError: for ``cameras`` and a file without levels of detail, for ``max_gaussians``
        without ``cameras``, and for a ``max_gaussians`` of 0.
    """

def render(
    scene: Scene2d | Scene3d,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] | None = None,
    alpha: bool = False,
    settings: Settings | None = None,
    backend: BackendChoice = None,
) -> Floats:
    """Render a scene as a float32 array of shape (H, W, 3), not clamped to 0 to 1.

    :param camera: for 3D scenes only, which need one.
    :param size: columns and rows; by default those of the scene's image or of the camera.
    :param alpha: leave out the background of a 3D scene; the array has shape (H, W, 4), with alpha
        in 8 bits and colours that are not multiplied by it, as in a PNG. Alpha is 1 less the
        transmittance; ``settings={"output": "alpha", "effects": {"background": "none"}}`` renders
        it alone and not rounded.
    :param settings: changes to how the scene was trained, such as
        ``{"effects": {"sh-degree": 0}, "background": [1.0, 1.0, 1.0]}``.
    :param backend: a backend or its name; by default a GPU if there is one, otherwise the CPU.
    :raises ValueError: for a missing camera or size, for alpha of a 2D scene, and for settings that
        are not possible.
    """

def forward(
    scene: Scene2d | Scene3d,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] | None = None,
    settings: Settings | None = None,
    backend: BackendChoice = None,
) -> ForwardPass:
    """Render a scene so that the result can be differentiated.

    Parameters and errors are those of :func:`render`, without alpha.

    >>> forward = gs.forward(scene)
    >>> gradient = forward.backward(2 * (forward.image - target))
    >>> gradient.means  # d(sum of squared differences) / d(means), (N, 2) or (N, 3)

    Renderings cut Gaussians off where they are faint, so finite differences need settings with a
    lower threshold: ``{"accuracy": {"alpha-cut": 1e-6}}``.
    """

@final
class ForwardPass:
    """A rendering that can be differentiated once; :func:`forward` makes it."""

    @property
    def image(self) -> Floats:
        """The rendering, (H, W, 3), not clamped; read-only."""
    def backward(self, v_image: Floats) -> Any:
        """The gradient of a loss with respect to all parameters, as a scene of the same kind.

        :param v_image: the gradient of the loss with respect to the image, float32 of its shape.
        :raises RuntimeError: if this forward pass has been used already.
        """
    @property
    def camera_gradient(self) -> dict[str, Floats]:
        """The gradient of the loss with respect to the camera, after :meth:`backward`.

        Only for 3D scenes rendered with ``settings={"camera-gradient": True}``. The keys are the
        arguments of :meth:`Camera.moved`, by which the gradient is taken at 0: ``"translation"``,
        (3,), per world unit; ``"rotation"``, (3,), per radian; ``"focal"`` and ``"center"``, (2,),
        per px.

        :raises RuntimeError: before :meth:`backward`, and where the settings do not ask for it.
        """

def encode(
    image: ImageSource,
    *,
    quality: int | None = None,
    psnr: float | None = None,
    bytes: int | None = None,
    bpp: float | None = None,
    tune: Literal["psnr", "ssim"] = "psnr",
    progressive: bool = False,
    preview: bool = False,
    seed: int = 0,
    backend: BackendChoice = None,
) -> Encoded:
    """Compress an image into a ``.gsi`` file, as ``gs encode`` does.

    :param image: a file, or an array of shape (H, W, 3) or, with alpha, (H, W, 4), float32 with
        0 to 1 or uint8. Of a file, alpha and the ICC profile are kept as ``gs encode`` keeps them.
    :param quality: 1 (small file) to 100 (best image); 50 where no target is given.
    :param psnr: the smallest file with at least this PSNR, 10 to 60 dB.
    :param bytes: the best image in at most so many bytes.
    :param bpp: the same in bits per pixel.
    :param tune: the measure to tune for; ``"ssim"`` gives low-contrast pixels more weight, which
        raises SSIM and MS-SSIM at some cost in PSNR.
    :param progressive: let the first third of the file show the picture nearly as well as a file of
        that size; the whole is about 1.4 dB worse.
    :param preview: let the first 300 bytes show a coarse picture.
    :param seed: seed of all random numbers.

    Ctrl-C raises ``KeyboardInterrupt`` when the file is done, not before.

    :raises ValueError: for two targets, one out of range, or one that cannot be met.
    """

def decode(data: bytes, *, partial: bool = False) -> Scene2d:
    """The scene of the bytes of a ``.gsi`` file; :func:`render` makes an image of it.

    A transparent picture becomes a scene on white; :func:`decode_image` keeps its alpha.

    :param partial: decode truncated data as far as they go.
    :raises ValueError: for data that are damaged, or truncated without ``partial``.
    """

def decode_image(
    data: bytes,
    *,
    size: tuple[int, int] | None = None,
    partial: bool = False,
    backend: BackendChoice = None,
) -> npt.NDArray[np.uint8]:
    """The picture of the bytes of a ``.gsi`` file: (H, W, 3), or (H, W, 4) with alpha.

    Colours are not premultiplied, and in the colour space of the file's profile, which
    ``gs.decode(data).profile`` has.

    :param size: columns and rows; by default those of the image that was encoded.
    :param partial: decode truncated data as far as they go.
    :raises ValueError: for data that are damaged, or truncated without ``partial``.
    """

@final
class Encoded:
    """A compressed image."""

    @property
    def data(self) -> bytes:
        """The ``.gsi`` file."""
    @property
    def gaussians(self) -> int:
        """Number of Gaussians."""
    @property
    def psnr(self) -> float:
        """PSNR of the decoded 8-bit image, dB; with alpha, of premultiplied colours and alpha."""
    @property
    def seconds(self) -> float:
        """Time of encoding, s."""

def compare(image: ImageSource, reference: ImageSource) -> dict[str, Any]:
    """PSNR (dB), SSIM, MS-SSIM and mean absolute difference of an image, rounded to 8 bits.

    Images are files, or arrays of shape (H, W, 3), float32 with 0 to 1 or uint8.

    :raises ValueError: for images of different sizes.
    """

def evaluate(
    scene: Scene3d,
    dataset: Path,
    *,
    reading: Settings | None = None,
    settings: Settings | None = None,
    backend: BackendChoice = None,
) -> dict[str, Any]:
    """The quality of a 3D scene over the held-out views of a data set, as ``gs eval`` measures it.

    The result has means ("psnr" in dB, "ssim", "l1", ...) and a list of "views" with those of each.
    Without held-out views, all are used.

    :param reading: how the data set is read, as for :func:`gaussian_splats.train`.
    :param settings: changes to how the scene was trained, as for :func:`render`.
    :raises OSError: for a data set that cannot be read.
    """

def poses(
    photos: Path,
    output: Path,
    *,
    lens: Literal["auto", "perspective", "fisheye"] = "auto",
    pairs: Literal["auto", "all", "neighbours"] = "auto",
    max_size: int | None = None,
    vocabulary: Path | None = None,
    threads: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Callable[[str, int, int], object] | None = None,
) -> dict[str, Any]:
    """Find the camera poses of photographs or a video, and make a data set, as ``gs poses`` does.

    COLMAP does it if it is on the PATH, otherwise PyCOLMAP of this Python (the extra ``poses``).
    The result is the verdict, as in ``poses.json``: "quality" ("good", "usable" or "poor"),
    "registered" of "photographs", "left_out" with the reasons, "points", "error_px", "advice", and
    more. Notes, such as files that were left out, are warnings.

    :param photos: a folder of photographs, or a video.
    :param output: folder for the data set; made if necessary.
    :param lens: the kind of lens; by default by the EXIF data.
    :param pairs: which pairs are compared; by default all of up to 150 photographs, otherwise
        neighbours by time (EXIF) or name.
    :param max_size: longer side of the images in which features are found, px; by default 1600.
    :param vocabulary: a vocabulary tree of COLMAP, to compare what looks alike besides neighbours;
        by default that which COLMAP 3.12 and later fetch.
    :param threads: by default one for each core.
    :param resume: continue what an interrupted call with the same arguments has done.
    :param overwrite: replace files of the names of results that gs did not write.
    :param progress: is called with what is being done, and how much of how much is done.
    :raises OSError: for files that cannot be read or written, or are in the way.
    :raises ValueError: for too few photographs, an unusable video, and impossible arguments.
    :raises RuntimeError: where COLMAP, ffmpeg or what converts HEIC is missing or fails, and where
        no poses are found.
    """

def read_image(path: Path) -> Floats:
    """Read a PNG, JPEG, BMP, TIFF, WebP, GIF or PNM as float32 of shape (H, W, 3), 0 to 1.

    Transparent pixels are shown on white.
    """

def write_png(path: Path, image: npt.NDArray[Any]) -> None:
    """Write an image of shape (H, W, 3), float32 or uint8, as PNG."""

@final
class Progress:
    """The state of a run after a step."""

    @property
    def step(self) -> int:
        """Steps done."""
    @property
    def iterations(self) -> int:
        """Steps in all."""
    @property
    def seconds(self) -> float:
        """Training time, s."""
    @property
    def count(self) -> int:
        """Number of Gaussians."""
    @property
    def loss(self) -> float:
        """The last loss that is known."""
    @property
    def psnr(self) -> float | None:
        """PSNR estimated from the loss, dB; None where the loss is not L2 or
        pixels are weighted."""
    @property
    def edits(self) -> tuple[int, int, int, int] | None:
        """Gaussians cloned, split, seeded and pruned after the step, where density control ran."""

@final
class Fit:
    """The result of a fit."""

    @property
    def scene(self) -> Scene2d:
        """The Gaussians."""
    @property
    def image(self) -> Floats:
        """The rendering at the image's size, (H, W, 3), not clamped."""
    @property
    def psnr(self) -> float:
        """PSNR of the 8-bit image, dB."""
    @property
    def history(self) -> dict[str, npt.NDArray[Any]]:
        """Each step's "step", "seconds", "count", "loss" and "psnr" (dB, estimated), (steps,)."""
    @property
    def summary(self) -> dict[str, Any]:
        """Cost, quality and all settings, as in the file ``summary.json`` of ``gs fit``.

        ``shortfall`` says why there are fewer Gaussians than allowed, if so, also under a policy
        of your own.
        """
    def _repr_png_(self) -> bytes:
        """The rendering, for notebooks."""

@final
class FitRun:
    """A fit under way in a thread of its own; iterate over it for its :class:`Progress`.

    Parameters are those of :func:`gaussian_splats.fit`. Its length is the number of steps. Ctrl-C
    stops the fit and, if there is ``checkpoint``, writes its state there.
    """

    def __new__(
        cls,
        image: ImageSource,
        gaussians: int | None = None,
        *,
        preset: str | None = None,
        iterations: int | None = None,
        policy: str | Policy | None = None,
        settings: Settings | Path | None = None,
        backend: BackendChoice = None,
        checkpoint: Path | None = None,
    ) -> FitRun: ...
    def __iter__(self) -> Iterator[Progress]: ...
    def __next__(self) -> Progress: ...
    def __len__(self) -> int: ...
    def stop(self) -> None:
        """Stop the run at its next step."""
    def result(self) -> Fit:
        """Wait for the end.

        :raises RuntimeError: if the run was stopped; and what a policy has raised.
        """

@final
class Training:
    """The result of a training."""

    @property
    def scene(self) -> Scene3d:
        """The Gaussians."""
    @property
    def psnr(self) -> float:
        """Mean PSNR over the held-out views, dB."""
    @property
    def history(self) -> dict[str, npt.NDArray[Any]]:
        """Each step's "step", "seconds", "count", "loss" and "psnr" (dB, estimated), (steps,)."""
    @property
    def summary(self) -> dict[str, Any]:
        """Cost, quality and all settings, as in the file ``summary.json`` of ``gs train``.

        ``shortfall`` says why there are fewer Gaussians than allowed, if so, also under a policy
        of your own.
        """
    def _repr_png_(self) -> bytes | None:
        """The scene from slightly above, for notebooks."""

@final
class TrainRun:
    """A training under way; see :class:`FitRun` and :func:`gaussian_splats.train`.

    Without ``iterations``, a trial may lengthen it beyond its length: ``Progress.iterations`` has
    the number that was decided.
    """

    def __new__(
        cls,
        dataset: Path,
        gaussians: int | None = None,
        *,
        preset: str | None = None,
        iterations: int | None = None,
        start: str | Scene3d | None = None,
        reading: Settings | None = None,
        policy: str | Policy | None = None,
        settings: Settings | Path | None = None,
        backend: BackendChoice = None,
        checkpoint: Path | None = None,
    ) -> TrainRun: ...
    def __iter__(self) -> Iterator[Progress]: ...
    def __next__(self) -> Progress: ...
    def __len__(self) -> int: ...
    def stop(self) -> None:
        """Stop the run at its next step."""
    def result(self) -> Training:
        """Wait for the end; see :meth:`FitRun.result`."""

def stop_runs() -> None: ...

@final
class Observation:
    """What a policy sees in a round of density control. All arrays are read-only."""

    @property
    def means(self) -> Floats:
        """(N, 2) in px, or (N, 3) in world units."""
    @property
    def log_scales(self) -> Floats:
        """(N, 2) or (N, 3): natural logarithms of standard deviations."""
    @property
    def rotations(self) -> Floats:
        """(N,) angles in rad, or (N, 4) quaternions (w, x, y, z)."""
    @property
    def opacity_logits(self) -> Floats | None:
        """(N,), or None where Gaussians have no opacity."""
    @property
    def colors(self) -> Floats:
        """(N, 3); in 3D without the part that depends on the direction."""
    @property
    def signal(self) -> Floats:
        """(N,): mean of the policy's statistic over the steps since the last edit."""
    @property
    def visible(self) -> npt.NDArray[np.uint32]:
        """(N,): number of steps since the last edit in which a Gaussian was drawn."""
    @property
    def target(self) -> Floats | None:
        """The image, (H, W, 3), where the policy has ``needs_residual``."""
    @property
    def rendered(self) -> Floats | None:
        """Its present rendering, (H, W, 3), likewise."""
    @property
    def weights(self) -> Floats | None:
        """How much each pixel counts, (H, W), likewise; None where all count 1."""
    @property
    def extent(self) -> float:
        """Longer side of the image, px, or radius of the cameras' positions, world units."""
    @property
    def step(self) -> int:
        """Step, from 0, after which the round takes place."""
    @property
    def progress(self) -> float:
        """From just above 0 at the first round to 1 at the last."""
    @property
    def budget(self) -> int:
        """Largest number of Gaussians after the round."""
    def __len__(self) -> int: ...

@final
class Plan:
    """The edits of a round. Lists are integer arrays of indices.

    ``grow``, ``clone``, ``split``, ``prune`` and ``moved`` must have no index in common and none
    twice.

    :param grow: Gaussians that become two, the most urgent first: small ones are cloned, large ones
        split, as far as the budget allows.
    :param clone: Gaussians that are copied, whatever their size.
    :param split: Gaussians that become two halves, whatever their size.
    :param prune: Gaussians to remove.
    :param relocate: (moved, onto): each of ``moved`` becomes a copy of the Gaussian at the same
        place in ``onto``, which must be neither moved nor pruned.
    :param add: a scene of new Gaussians, of the kind that is trained.
    :param opacity_ceiling: lowers all larger opacities to this value, above 0 and at most 1.

    Gaussians that the policy's ``actions`` prune are left out of all lists. Indices that do not
    exist, contradictions, and more Gaussians than the budget are a ``ValueError`` of the run.
    """

    def __new__(
        cls,
        grow: npt.NDArray[Any] | None = None,
        *,
        clone: npt.NDArray[Any] | None = None,
        split: npt.NDArray[Any] | None = None,
        prune: npt.NDArray[Any] | None = None,
        relocate: tuple[npt.NDArray[Any], npt.NDArray[Any]] | None = None,
        add: Scene2d | Scene3d | None = None,
        opacity_ceiling: float | None = None,
    ) -> Plan: ...

@final
class Study:
    """See :class:`gaussian_splats.Study`."""

    def __new__(
        cls,
        definition: str,
        arms: list[tuple[str, str, str | Policy, str]],
        data: Path | None,
        beside: Path | None,
        backend: str,
    ) -> Study: ...
    @property
    def runs(self) -> int:
        """Number of runs."""
    def run(
        self,
        output: Path,
        *,
        jobs: int = 1,
        resume: bool = False,
        progress: Callable[[int, int], object] | None = None,
    ) -> list[str]:
        """See :meth:`gaussian_splats.Study.run`."""
    def work(
        self,
        output: Path,
        *,
        jobs: int = 1,
        shard: tuple[int, int] | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> None:
        """See :meth:`gaussian_splats.Study.work`."""
    def report(self, output: Path) -> list[str]:
        """See :meth:`gaussian_splats.Study.report`."""
