"""PyTorch: renderings as differentiable functions of tensors. Skipped where it is not installed."""

from __future__ import annotations

from typing import Any

import gaussian_splats as gs
import numpy as np
import pytest

torch: Any = pytest.importorskip("torch")

SMOOTH = {"accuracy": {"alpha-cut": 1e-6}}


def tensors(scene: gs.Scene2d | gs.Scene3d) -> dict[str, Any]:
    """The arrays of a scene as float64 tensors to be trained."""
    return {
        name: torch.tensor(array, dtype=torch.float64, requires_grad=True)
        for name, array in scene.arrays.items()
    }


def check(scene: gs.Scene2d | gs.Scene3d, render: Any, **view: Any) -> None:
    """Compare all gradients of a loss with finite differences."""
    values = tensors(scene)
    image = render(**values, settings=SMOOTH, backend="cpu", **view)
    assert image.dtype == torch.float64
    v_image = torch.tensor(np.random.default_rng(5).normal(size=image.shape), dtype=torch.float32)
    (image * v_image).sum().backward()
    for name, tensor in values.items():
        assert tensor.grad.dtype == torch.float64
        direction = torch.tensor(np.random.default_rng(6).normal(size=tensor.shape))

        def loss(step: float, name: str = name, direction: Any = direction) -> float:
            moved = {**values, name: values[name] + step * direction}
            image = render(**moved, settings=SMOOTH, backend="cpu", **view)
            return float((image.detach() * v_image).sum())

        found = (loss(2e-3) - loss(-2e-3)) / 4e-3
        assert found == pytest.approx(float((tensor.grad * direction).sum()), rel=0.02, abs=0.02)


def test_2d(scene_2d: gs.Scene2d) -> None:
    from gaussian_splats.torch import render_2d

    check(scene_2d, render_2d, size=(32, 32))


def test_3d(scene_3d: gs.Scene3d, camera: gs.Camera) -> None:
    from gaussian_splats.torch import render_3d

    check(scene_3d, render_3d, camera=camera)


def test_the_camera(scene_3d: gs.Scene3d, camera: gs.Camera) -> None:
    """Compare the gradient by a large and a zero offset of the camera with finite differences."""
    from gaussian_splats.torch import render_3d

    values = {name: tensor.detach() for name, tensor in tensors(scene_3d).items()}
    far = [0.1, -0.05, 0.08, 0.2, -0.3, 0.25, 1.5, -2.0, 0.7, 0.4]
    for start in (torch.zeros(10, dtype=torch.float64), torch.tensor(far, dtype=torch.float64)):

        def render(offset: Any) -> Any:
            return render_3d(
                **values, camera=camera, camera_offset=offset, settings=SMOOTH, backend="cpu"
            )

        offset = start.clone().requires_grad_()
        image = render(offset)
        v_image = torch.tensor(np.random.default_rng(5).normal(size=image.shape))
        (image * v_image).sum().backward()
        for k in range(10):
            step = torch.zeros(10, dtype=torch.float64)
            step[k] = 2e-3 if k < 6 else 0.05
            found = float(
                ((render(start + step) - render(start - step)) * v_image).sum() / (2 * step[k])
            )
            size = offset.grad[:6].abs().max() if k < 6 else offset.grad[6:].abs().max()
            assert found == pytest.approx(
                float(offset.grad[k]), rel=0.02, abs=0.02 * float(size)
            ), k


def test_an_optimizer_of_pytorch(scene_2d: gs.Scene2d) -> None:
    from gaussian_splats.torch import render_2d

    brighter = {**scene_2d.arrays, "colors": scene_2d.colors + np.float32(0.3)}
    target = torch.tensor(gs.render(gs.Scene2d(**brighter), size=(32, 32)))
    values = {name: tensor.detach().float() for name, tensor in tensors(scene_2d).items()}
    colors = values.pop("colors").requires_grad_()
    adam = torch.optim.Adam([colors], lr=0.05)
    losses = []
    for _ in range(40):
        loss = ((render_2d(**values, colors=colors, size=(32, 32)) - target) ** 2).mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
        losses.append(loss.item())
    assert losses[-1] < 0.1 * losses[0]


def test_tensors_share_the_memory_of_a_scene(scene_2d: gs.Scene2d) -> None:
    tensor = torch.from_dlpack(gs.shared(scene_2d.means))
    assert tensor.data_ptr() == scene_2d.means.ctypes.data
    expected = scene_2d.means.tolist()
    del scene_2d
    assert tensor.tolist() == expected
