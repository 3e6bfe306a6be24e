"""Gradients against finite differences."""

from __future__ import annotations

from typing import Any

import gaussian_splats as gs
import numpy as np
import pytest

# Nearly without the cut of small weights, so that the image is differentiable.
SMOOTH = {"accuracy": {"alpha-cut": 1e-6}}


def check(scene: gs.Scene2d | gs.Scene3d, **view: Any) -> None:
    """Compare a directional derivative by each array with a central difference."""
    rng = np.random.default_rng(3)
    arrays = {name: np.array(array) for name, array in scene.arrays.items()}
    first = gs.forward(scene, settings=SMOOTH, backend="cpu", **view)
    v_image = rng.normal(size=first.image.shape).astype(np.float32)
    gradient = first.backward(v_image)
    for name in arrays:
        direction = rng.normal(size=arrays[name].shape).astype(np.float32)
        expected = float(np.sum(np.array(getattr(gradient, name), np.float64) * direction))

        def loss(step: float, name: str = name, direction: np.ndarray = direction) -> float:
            moved = {**arrays, name: (arrays[name] + step * direction).astype(np.float32)}
            image = gs.render(type(scene)(**moved), settings=SMOOTH, backend="cpu", **view)
            return float(np.sum(image.astype(np.float64) * v_image))

        step = 2e-3
        found = (loss(step) - loss(-step)) / (2 * step)
        assert found == pytest.approx(expected, rel=0.02, abs=0.02), name


def test_2d_against_finite_differences(scene_2d: gs.Scene2d) -> None:
    check(scene_2d, size=(32, 32))
    opaque = gs.Scene2d(**scene_2d.arrays, opacity_logits=np.linspace(-2, 2, 12, dtype=np.float32))
    check(opaque, size=(32, 32))


def test_3d_against_finite_differences(scene_3d: gs.Scene3d, camera: gs.Camera) -> None:
    check(scene_3d, camera=camera)


def test_the_gradient_by_the_camera(scene_3d: gs.Scene3d, camera: gs.Camera) -> None:
    settings = {**SMOOTH, "camera-gradient": True}
    first = gs.forward(scene_3d, camera, settings=settings, backend="cpu")
    v_image = np.random.default_rng(7).normal(size=first.image.shape).astype(np.float32)
    with pytest.raises(RuntimeError, match="backward"):
        first.camera_gradient  # noqa: B018
    first.backward(v_image)
    gradient = first.camera_gradient
    shapes = {name: part.shape for name, part in gradient.items()}
    assert shapes == {"translation": (3,), "rotation": (3,), "focal": (2,), "center": (2,)}
    for name, part in gradient.items():
        size = np.abs(part).max()
        for axis, expected in enumerate(part):
            # In px, an intrinsic moves the image far less than a unit of the pose does.
            step = 2e-3 if part.size == 3 else 0.05

            def loss(by: float, name: str = name, axis: int = axis, n: int = part.size) -> float:
                moved = camera.moved(**{name: by * np.eye(n)[axis]})
                image = gs.render(scene_3d, moved, settings=SMOOTH, backend="cpu")
                return float(np.sum(image.astype(np.float64) * v_image))

            found = (loss(step) - loss(-step)) / (2 * step)
            assert found == pytest.approx(expected, rel=0.02, abs=0.02 * float(size)), (name, axis)


def test_a_gradient_by_the_camera_that_nobody_asked_for(
    scene_2d: gs.Scene2d, scene_3d: gs.Scene3d, camera: gs.Camera
) -> None:
    first = gs.forward(scene_3d, camera, backend="cpu")
    first.backward(np.ones_like(first.image))
    with pytest.raises(RuntimeError, match="camera-gradient"):
        first.camera_gradient  # noqa: B018
    with pytest.raises(ValueError, match="2D"):
        gs.forward(scene_2d, size=(8, 6), settings={"camera-gradient": True}, backend="cpu")


def test_a_pass_is_used_once(scene_2d: gs.Scene2d) -> None:
    forward = gs.forward(scene_2d, size=(8, 6))
    v_image = np.ones((6, 8, 3), np.float32)
    with pytest.raises(TypeError, match="v_image: .* float32"):
        forward.backward(v_image.astype(np.float64))
    with pytest.raises(TypeError, match="v_image: .* float32"):
        forward.backward(v_image.astype(np.uint8))
    with pytest.raises(ValueError, match=r"v_image: expected shape \(6, 8, 3\), not"):
        forward.backward(np.ones((8, 6, 3), np.float32))
    v_image[2, 3, 1] = np.inf
    with pytest.raises(ValueError, match=r"v_image\[2, 3, 1\] is inf: expected finite numbers"):
        forward.backward(v_image)
    forward.backward(np.ones((6, 8, 3), np.float32))
    with pytest.raises(RuntimeError, match="once"):
        forward.backward(np.ones((6, 8, 3), np.float32))
