"""The compiled part of the package."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Callable, final

import numpy as np
import numpy.typing as npt

from ._types import Floats, ImageSource, Path, Policy, Settings

@final
class Backend:
    """What computes: the CPU, or a GPU through Vulkan, Metal or Direct3D 12.

    :param name: "auto" (a GPU if there is a suitable one, otherwise the CPU), "cpu" or "wgpu".
    :param threads: threads on the host; by default one per core.
    :raises RuntimeError: where there is no such device; the message says what to install.

    One backend may be used from several threads. After a fork, open another in the child process.
    """

    def __init__(self, name: str = "auto", *, threads: int | None = None) -> None: ...
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
    :param cx: principal point, px from the top-left corner; by default the centre.
    :param rotation: world-to-camera rotation, (3, 3), row by row.
    :param translation: world-to-camera translation: x_camera = rotation @ x_world + translation.
    :param near: near plane, world units.
    """

    def __init__(
        self,
        width: int,
        height: int,
        *,
        fx: float,
        fy: float | None = None,
        cx: float | None = None,
        cy: float | None = None,
        rotation: Any = None,
        translation: Any = None,
        near: float | None = None,
    ) -> None: ...
    def looking_at(self, position: Any, target: Any, up: Any = (0.0, -1.0, 0.0)) -> Camera:
        """The same camera at another position, looking at a point."""
    def resized(self, width: int, height: int) -> Camera:
        """The same view in an image of another size."""
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def position(self) -> list[float]:
        """Position, world units."""

@final
class Scene2d:
    """N Gaussians in the image plane.

    Coordinates are pixels of the image that the scene was made for: the origin is its top-left
    corner, y points down, and the centre of pixel (i, j) is (i + 0.5, j + 0.5). All arrays are
    float32. They are copied; the scene's own arrays are read-only views without a copy.

    :param means: (N, 2), px.
    :param log_scales: (N, 2), natural logarithms of standard deviations in px.
    :param rotations: (N,), rad, of the first axis, from +x towards +y.
    :param colors: (N, 3), RGB; may lie outside 0 to 1.
    :param opacity_logits: (N,), or None where Gaussians have no opacity and are summed.
    :raises TypeError: for another dtype.
    :raises ValueError: for another shape, an array that is not C-contiguous, or a number that is
        not finite.
    """

    def __init__(
        self,
        means: Floats,
        log_scales: Floats,
        rotations: Floats,
        colors: Floats,
        opacity_logits: Floats | None = None,
    ) -> None: ...
    @property
    def means(self) -> Floats: ...
    @property
    def log_scales(self) -> Floats: ...
    @property
    def rotations(self) -> Floats: ...
    @property
    def colors(self) -> Floats: ...
    @property
    def opacity_logits(self) -> Floats | None: ...
    @property
    def size(self) -> tuple[int, int] | None:
        """Columns and rows of the image that the scene was made for, where they are known."""
    def save(self, path: Path, size: tuple[int, int] | None = None) -> None:
        """Write the scene to a file whose name ends in ``.gs2d.safetensors``, without loss."""
    def __len__(self) -> int: ...

@final
class Scene3d:
    """N Gaussians in 3D. World axes are x right, y down, z forward. All arrays are float32.

    :param means: (N, 3), world units.
    :param log_scales: (N, 3), natural logarithms of standard deviations in world units.
    :param rotations: (N, 4), quaternions (w, x, y, z) of any length but 0.
    :param opacity_logits: (N,).
    :param sh: (N, K, 3) with K = 1, 4, 9 or 16; colour = 0.5 + SH(direction), clamped at 0.

    Errors are those of :class:`Scene2d`.
    """

    def __init__(
        self,
        means: Floats,
        log_scales: Floats,
        rotations: Floats,
        opacity_logits: Floats,
        sh: Floats,
    ) -> None: ...
    @property
    def means(self) -> Floats: ...
    @property
    def log_scales(self) -> Floats: ...
    @property
    def rotations(self) -> Floats: ...
    @property
    def opacity_logits(self) -> Floats: ...
    @property
    def sh(self) -> Floats: ...
    @property
    def sh_degree(self) -> int: ...
    def save(self, path: Path) -> None:
        """Write the scene as PLY, ``.splat``, SPZ or glTF, by the ending of the name."""
    def __len__(self) -> int: ...

def load(path: Path) -> Scene2d | Scene3d:
    """Read a scene: a scene file of any format, a checkpoint, or an output folder of ``gs``.

    :raises OSError: for a file that cannot be read or is damaged.
    """

def render(
    scene: Scene2d | Scene3d,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] | None = None,
    settings: Settings | None = None,
    backend: Backend | None = None,
) -> Floats:
    """Render a scene as a float32 array of shape (H, W, 3), not clamped to 0 to 1.

    :param camera: for 3D scenes only.
    :param size: columns and rows; by default those of the scene's image or of the camera.
    :param settings: changes to how the scene was trained, such as
        ``{"effects": {"sh-degree": 0}, "background": [1.0, 1.0, 1.0]}``.
    """

def compare(image: npt.NDArray[Any], reference: npt.NDArray[Any]) -> dict[str, Any]:
    """PSNR (dB), SSIM, MS-SSIM and mean absolute difference of an image, rounded to 8 bits."""

def read_image(path: Path) -> Floats:
    """Read a PNG, JPEG, BMP, TIFF, WebP, GIF or PNM as float32 of shape (H, W, 3), 0 to 1."""

def write_png(path: Path, image: npt.NDArray[Any]) -> None:
    """Write an image of shape (H, W, 3), float32 or uint8, as PNG."""

@final
class ForwardPass:
    """A rendering that can be differentiated once. Parameters are those of :func:`render`.

    >>> forward = ForwardPass(scene)
    >>> gradient = forward.backward(2 * (forward.image - target))
    >>> gradient.means  # of the sum of squared differences, by each mean
    """

    def __init__(
        self,
        scene: Scene2d | Scene3d,
        camera: Camera | None = None,
        *,
        size: tuple[int, int] | None = None,
        settings: Settings | None = None,
        backend: Backend | None = None,
    ) -> None: ...
    @property
    def image(self) -> Floats:
        """The rendering, (H, W, 3), not clamped; read-only."""
    def backward(self, v_image: Floats) -> Any:
        """The gradient of a loss by all parameters, as a scene of the same kind.

        :param v_image: the gradient of the loss by the image, float32 of its shape.
        :raises RuntimeError: if this forward pass has been used already.
        """

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
        """PSNR estimated from the loss, dB; None where the loss is not L2."""
    @property
    def edits(self) -> tuple[int, int, int, int] | None:
        """Gaussians cloned, split, seeded and pruned after the step, where density control ran."""

@final
class Fit:
    """The result of a fit."""

    @property
    def scene(self) -> Scene2d: ...
    @property
    def image(self) -> Floats:
        """The rendering at the image's size, (H, W, 3), not clamped."""
    @property
    def psnr(self) -> float:
        """PSNR of the 8-bit image, dB."""
    @property
    def summary(self) -> dict[str, Any]:
        """Cost, quality and all settings, as in the file ``summary.json`` of ``gs fit``."""

@final
class FitRun:
    """A fit under way in a thread of its own; iterate over it for its :class:`Progress`.

    Parameters are those of :func:`gaussian_splats.fit`. Ctrl-C stops the fit and, if there is
    ``checkpoint``, writes its state there.
    """

    def __init__(
        self,
        image: ImageSource,
        gaussians: int | None = None,
        *,
        preset: str = "standard",
        iterations: int | None = None,
        policy: str | Policy | None = None,
        settings: Settings | None = None,
        backend: Backend | None = None,
        checkpoint: Path | None = None,
    ) -> None: ...
    def __iter__(self) -> Iterator[Progress]: ...
    def __next__(self) -> Progress: ...
    def __len__(self) -> int: ...
    def stop(self) -> None:
        """Stop the run at its next step."""
    def result(self) -> Fit:
        """Wait for the end."""

@final
class Training:
    """The result of a training."""

    @property
    def scene(self) -> Scene3d: ...
    @property
    def psnr(self) -> float:
        """Mean PSNR over the held-out views, dB."""
    @property
    def summary(self) -> dict[str, Any]:
        """Cost, quality and all settings, as in the file ``summary.json`` of ``gs train``."""

@final
class TrainRun:
    """A training under way; see :class:`FitRun` and :func:`gaussian_splats.train`."""

    def __init__(
        self,
        dataset: Path,
        gaussians: int | None = None,
        *,
        preset: str = "standard",
        iterations: int | None = None,
        start: str | None = None,
        reading: Settings | None = None,
        policy: str | Policy | None = None,
        settings: Settings | None = None,
        backend: Backend | None = None,
        checkpoint: Path | None = None,
    ) -> None: ...
    def __iter__(self) -> Iterator[Progress]: ...
    def __next__(self) -> Progress: ...
    def __len__(self) -> int: ...
    def stop(self) -> None:
        """Stop the run at its next step."""
    def result(self) -> Training:
        """Wait for the end."""

@final
class Observation:
    """What a policy sees in a round of density control. All arrays are read-only."""

    @property
    def means(self) -> Floats:
        """(N, 2) in px, or (N, 3) in world units."""
    @property
    def log_scales(self) -> Floats: ...
    @property
    def rotations(self) -> Floats:
        """(N,) angles, or (N, 4) quaternions."""
    @property
    def opacity_logits(self) -> Floats | None: ...
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
        """The image, where the policy has ``needs_residual``."""
    @property
    def rendered(self) -> Floats | None:
        """Its present rendering."""
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
    @property
    def rng(self) -> np.random.Generator:
        """Random numbers of this round: the same whenever a run is repeated or resumed."""
    def __len__(self) -> int: ...

@final
class Plan:
    """The edits of a round. Lists are integer arrays of indices; none may be in two of them.

    :param grow: Gaussians that become two, the most urgent first: small ones are cloned, large ones
        split, as far as the budget allows.
    :param clone: Gaussians that are copied, whatever their size.
    :param split: Gaussians that become two halves, whatever their size.
    :param prune: Gaussians to remove.
    :param relocate: (moved, onto): each of ``moved`` becomes a copy of that in ``onto``.
    :param add: a scene of new Gaussians.
    :param opacity_ceiling: lowers all larger opacities to this value.

    Gaussians that the policy's ``actions`` prune are left out of all lists. Indices that do not
    exist, contradictions, and more Gaussians than the budget are a ``ValueError`` of the run.
    """

    def __init__(
        self,
        grow: npt.NDArray[Any] | None = None,
        *,
        clone: npt.NDArray[Any] | None = None,
        split: npt.NDArray[Any] | None = None,
        prune: npt.NDArray[Any] | None = None,
        relocate: tuple[npt.NDArray[Any], npt.NDArray[Any]] | None = None,
        add: Scene2d | Scene3d | None = None,
        opacity_ceiling: float | None = None,
    ) -> None: ...

@final
class Study:
    """See :class:`gaussian_splats.Study`."""

    def __init__(
        self,
        definition: str,
        arms: list[tuple[str, str, str | Policy, str]],
        data: Path | None = None,
        beside: Path | None = None,
    ) -> None: ...
    @property
    def runs(self) -> int: ...
    def run(
        self,
        output: Path,
        *,
        jobs: int = 1,
        resume: bool = False,
        progress: Callable[[int, int], object] | None = None,
    ) -> list[str]: ...
    def work(
        self,
        output: Path,
        *,
        jobs: int = 1,
        shard: tuple[int, int] | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> None: ...
    def report(self, output: Path) -> list[str]: ...
