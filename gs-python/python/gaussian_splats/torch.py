"""Rendering as a differentiable function of PyTorch tensors.

PyTorch is not installed with this package. Tensors may be on any device and of any float type;
images are computed in float32 on the backend and come back as the means are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from ._native import Camera, Scene2d, Scene3d, forward
from ._types import BackendChoice, Settings


def _array(tensor: torch.Tensor) -> Any:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float32)


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        kind: type,
        names: tuple[str, ...],
        options: dict[str, Any],
        *tensors: torch.Tensor,
    ) -> torch.Tensor:
        scene = kind(**{name: _array(tensor) for name, tensor in zip(names, tensors)})
        ctx.forward_pass = forward(scene, **options)
        ctx.names, ctx.kinds = names, [(tensor.device, tensor.dtype) for tensor in tensors]
        return torch.tensor(ctx.forward_pass.image).to(*ctx.kinds[0])

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, v_image: torch.Tensor) -> tuple[Any, ...]:
        gradient = ctx.forward_pass.backward(_array(v_image)).arrays
        pairs = zip(ctx.names, ctx.kinds)
        return (None, None, None, *(torch.tensor(gradient[name]).to(*kind) for name, kind in pairs))


def render_2d(
    means: torch.Tensor,
    log_scales: torch.Tensor,
    rotations: torch.Tensor,
    colors: torch.Tensor,
    opacity_logits: torch.Tensor | None = None,
    *,
    size: tuple[int, int],
    settings: Settings | None = None,
    backend: BackendChoice = None,
) -> torch.Tensor:
    """The image, (H, W, 3), of the Gaussians of a :class:`~gaussian_splats.Scene2d`.

    Shapes and units are those of the scene's arrays, errors those of its constructor.

    :param size: columns and rows of the image.
    """
    names: tuple[str, ...] = ("means", "log_scales", "rotations", "colors")
    tensors: tuple[torch.Tensor, ...] = (means, log_scales, rotations, colors)
    if opacity_logits is not None:
        names, tensors = (*names, "opacity_logits"), (*tensors, opacity_logits)
    options = {"size": size, "settings": settings, "backend": backend}
    result: torch.Tensor = _Render.apply(Scene2d, names, options, *tensors)
    return result


def render_3d(
    means: torch.Tensor,
    log_scales: torch.Tensor,
    rotations: torch.Tensor,
    opacity_logits: torch.Tensor,
    sh: torch.Tensor,
    *,
    camera: Camera,
    settings: Settings | None = None,
    backend: BackendChoice = None,
) -> torch.Tensor:
    """The image, (H, W, 3), of the Gaussians of a :class:`~gaussian_splats.Scene3d`.

    Shapes and units are those of the scene's arrays, errors those of its constructor.
    """
    names = ("means", "log_scales", "rotations", "opacity_logits", "sh")
    options = {"camera": camera, "settings": settings, "backend": backend}
    tensors = (means, log_scales, rotations, opacity_logits, sh)
    result: torch.Tensor = _Render.apply(Scene3d, names, options, *tensors)
    return result
