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


def _twist_vjp(twist: Any, v_translation: Any, v_rotation: Any) -> Any:
    """Gradient by a twist (v, w) of any size from that by a small twist after it.

    A change of w turns p - v by J dw, where J is the left Jacobian of the rotation.
    """
    v, w = twist[:3], twist[3:6]
    angle2 = float(w @ w)
    angle = angle2**0.5
    if angle > 1e-3:
        first, second = (1 - np.cos(angle)) / angle2, (angle - np.sin(angle)) / (angle2 * angle)
    else:
        first, second = 0.5 - angle2 / 24, 1 / 6 - angle2 / 120
    cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    jacobian = np.eye(3) + first * cross + second * (cross @ cross)
    turned = jacobian.T @ (v_rotation - np.cross(v, v_translation))
    return np.concatenate([v_translation, turned])


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        kind: type,
        names: tuple[str, ...],
        options: dict[str, Any],
        *tensors: torch.Tensor,
    ) -> torch.Tensor:
        arrays = {name: _array(tensor) for name, tensor in zip(names, tensors)}
        ctx.offset = arrays.pop("camera_offset", None)
        if ctx.offset is not None:
            by = ctx.offset.astype(np.float64)
            camera = options["camera"].moved(by[:3], by[3:6], focal=by[6:8], center=by[8:])
            settings = {**(options["settings"] or {}), "camera-gradient": True}
            options = {**options, "camera": camera, "settings": settings}
        ctx.forward_pass = forward(kind(**arrays), **options)
        ctx.names, ctx.kinds = names, [(tensor.device, tensor.dtype) for tensor in tensors]
        return torch.tensor(ctx.forward_pass.image).to(*ctx.kinds[0])

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, v_image: torch.Tensor) -> tuple[Any, ...]:
        gradient = dict(ctx.forward_pass.backward(_array(v_image)).arrays)
        if ctx.offset is not None:
            by = {
                name: part.astype(np.float64)
                for name, part in ctx.forward_pass.camera_gradient.items()
            }
            twist = _twist_vjp(ctx.offset.astype(np.float64), by["translation"], by["rotation"])
            gradient["camera_offset"] = np.concatenate([twist, by["focal"], by["center"]])
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
    camera_offset: torch.Tensor | None = None,
    settings: Settings | None = None,
    backend: BackendChoice = None,
) -> torch.Tensor:
    """The image, (H, W, 3), of the Gaussians of a :class:`~gaussian_splats.Scene3d`.

    Shapes and units are those of the scene's arrays, errors those of its constructor.

    :param camera_offset: what ``camera`` is moved by, (10,): the translation and rotation of
        :meth:`~gaussian_splats.Camera.moved`, and what is added to fx, fy, cx and cy. Zeros are
        where to start.
    """
    names: tuple[str, ...] = ("means", "log_scales", "rotations", "opacity_logits", "sh")
    options = {"camera": camera, "settings": settings, "backend": backend}
    tensors: tuple[torch.Tensor, ...] = (means, log_scales, rotations, opacity_logits, sh)
    if camera_offset is not None:
        names, tensors = (*names, "camera_offset"), (*tensors, camera_offset)
    result: torch.Tensor = _Render.apply(Scene3d, names, options, *tensors)
    return result
