"""Rendering as a differentiable function of PyTorch tensors.

PyTorch is not installed with this package.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from ._native import Backend, Camera, ForwardPass, Scene2d, Scene3d
from ._types import Settings


def _array(tensor: torch.Tensor) -> Any:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float32)


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, kind: type, options: dict[str, Any], *tensors: torch.Tensor
    ) -> torch.Tensor:
        ctx.forward_pass = ForwardPass(kind(*map(_array, tensors)), **options)
        ctx.device, ctx.dtype = tensors[0].device, tensors[0].dtype
        image = torch.from_numpy(np.array(ctx.forward_pass.image))
        return image.to(ctx.device, ctx.dtype)

    @staticmethod
    def backward(ctx: Any, *v_images: torch.Tensor) -> tuple[Any, ...]:
        gradient = ctx.forward_pass.backward(_array(v_images[0]))
        if isinstance(gradient, Scene2d):
            names = ["means", "log_scales", "rotations", "colors", "opacity_logits"]
        else:
            names = ["means", "log_scales", "rotations", "opacity_logits", "sh"]
        arrays = (getattr(gradient, name) for name in names)
        tensors = [
            torch.from_numpy(np.array(a)).to(ctx.device, ctx.dtype) for a in arrays if a is not None
        ]
        return (None, None, *tensors)


def render_2d(
    means: torch.Tensor,
    log_scales: torch.Tensor,
    rotations: torch.Tensor,
    colors: torch.Tensor,
    opacity_logits: torch.Tensor | None = None,
    *,
    size: tuple[int, int],
    settings: Settings | None = None,
    backend: Backend | None = None,
) -> torch.Tensor:
    """The image, (H, W, 3), of the Gaussians of a :class:`~gaussian_splats.Scene2d`."""
    options = {"size": size, "settings": settings, "backend": backend}
    tensors = [means, log_scales, rotations, colors]
    if opacity_logits is not None:
        tensors.append(opacity_logits)
    result: torch.Tensor = _Render.apply(Scene2d, options, *tensors)
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
    backend: Backend | None = None,
) -> torch.Tensor:
    """The image, (H, W, 3), of the Gaussians of a :class:`~gaussian_splats.Scene3d`."""
    options = {"camera": camera, "settings": settings, "backend": backend}
    tensors = (means, log_scales, rotations, opacity_logits, sh)
    result: torch.Tensor = _Render.apply(Scene3d, options, *tensors)
    return result
