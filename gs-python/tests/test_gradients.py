"""Gradients against finite differences."""

from __future__ import annotations

from typing import Callable

import gaussian_splats as gs
import numpy as np
import pytest

NAMES_2D = ["means", "log_scales", "rotations", "colors"]
NAMES_3D = ["means", "log_scales", "rotations", "opacity_logits", "sh"]


def check(
    kind: type,
    names: list[str],
    scene: gs.Scene2d | gs.Scene3d,
    forward: Callable[[object], gs.ForwardPass],
) -> None:
    """Compare a directional derivative by each array with a central difference."""
    rng = np.random.default_rng(3)
    arrays = {name: np.array(getattr(scene, name)) for name in names}
    first = forward(kind(**arrays))
    v_image = rng.normal(size=first.image.shape).astype(np.float32)
    gradient = first.backward(v_image)
    for name in names:
        direction = rng.normal(size=arrays[name].shape).astype(np.float32)
        expected = float(np.sum(np.array(getattr(gradient, name), np.float64) * direction))

        def loss(step: float, name: str = name, direction: np.ndarray = direction) -> float:
            moved = {**arrays, name: (arrays[name] + step * direction).astype(np.float32)}
            return float(np.sum(forward(kind(**moved)).image.astype(np.float64) * v_image))

        step = 2e-3
        found = (loss(step) - loss(-step)) / (2 * step)
        assert found == pytest.approx(expected, rel=0.02, abs=0.02), name


def test_2d(scene_2d: gs.Scene2d, cpu: gs.Backend) -> None:
    # Nearly without the cut of small weights, so that the image is differentiable.
    settings = {"accuracy": {"alpha-cut": 1e-6}}
    check(
        gs.Scene2d,
        NAMES_2D,
        scene_2d,
        lambda s: gs.ForwardPass(s, size=(32, 32), settings=settings, backend=cpu),  # type: ignore[arg-type]
    )


def test_3d(scene_3d: gs.Scene3d, camera: gs.Camera, cpu: gs.Backend) -> None:
    settings = {"accuracy": {"alpha-cut": 1e-6}}
    check(
        gs.Scene3d,
        NAMES_3D,
        scene_3d,
        lambda s: gs.ForwardPass(s, camera, settings=settings, backend=cpu),  # type: ignore[arg-type]
    )


def test_a_pass_is_used_once(scene_2d: gs.Scene2d) -> None:
    forward = gs.ForwardPass(scene_2d, size=(8, 8))
    v_image = np.ones((8, 8, 3), np.float32)
    with pytest.raises(TypeError, match="v_image"):
        forward.backward(v_image.astype(np.float64))
    forward.backward(v_image)
    with pytest.raises(RuntimeError, match="once"):
        forward.backward(v_image)
