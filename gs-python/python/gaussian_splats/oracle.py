"""The oracle: dense rendering and gradients in 64 bits, for comparison with a backend.

It visits every Gaussian at every pixel, so it is for small scenes and images.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ._native import Camera, Scene2d, Scene3d, oracle_gradient, oracle_render
from ._types import Floats, Settings

__all__ = ["gradient", "render"]


def render(
    scene: Scene2d | Scene3d,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] | None = None,
    settings: Settings | None = None,
) -> npt.NDArray[np.float64]:
    """Render a scene as float64 of shape (H, W, 3).

    Parameters and errors are those of :func:`gaussian_splats.render`.
    """
    return oracle_render(scene, camera, size=size, settings=settings)


def gradient(
    scene: Scene2d | Scene3d,
    v_image: Floats,
    camera: Camera | None = None,
    *,
    size: tuple[int, int] | None = None,
    settings: Settings | None = None,
) -> dict[str, npt.NDArray[np.float64]]:
    """The gradient of a loss with respect to all arrays of a scene, by their names.

    The results are float64 arrays of the same shapes.

    :param v_image: the gradient of the loss with respect to the image, float32 of shape (H, W, 3).

    Other parameters and errors are those of :func:`gaussian_splats.render`.
    """
    rows = oracle_gradient(scene, v_image, camera, size=size, settings=settings)
    # The columns of a row are the parameters of one Gaussian in this order.
    names = ["means", "log_scales", "rotations", "opacity_logits"]
    names.append("colors" if isinstance(scene, Scene2d) else "sh")
    found: dict[str, npt.NDArray[np.float64]] = {}
    first = 0
    for name in names:
        array = scene.arrays.get(name)
        width = 1 if array is None else int(np.prod(array.shape[1:]))
        if array is not None:
            found[name] = rows[:, first : first + width].reshape(array.shape)
        first += width
    return found
