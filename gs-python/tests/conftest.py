"""What the tests share."""

from __future__ import annotations

import json
from pathlib import Path

import gaussian_splats as gs
import numpy as np
import numpy.typing as npt
import pytest


@pytest.fixture(scope="session")
def cpu() -> gs.Backend:
    return gs.Backend("cpu", threads=2)


@pytest.fixture(scope="session")
def image() -> npt.NDArray[np.float32]:
    """A smooth picture with an edge, 64 x 48 px."""
    y, x = np.mgrid[0:48, 0:64].astype(np.float32)
    waves = 0.5 + 0.4 * np.sin(x / 7) * np.cos(y / 5)
    edge = (x + y > 60).astype(np.float32)
    return np.ascontiguousarray(np.stack([waves, edge * 0.8, 1 - waves], axis=2), dtype=np.float32)


@pytest.fixture
def scene_2d() -> gs.Scene2d:
    rng = np.random.default_rng(1)
    n = 12
    return gs.Scene2d(
        rng.uniform(4, 28, (n, 2)).astype(np.float32),
        rng.uniform(0.5, 1.5, (n, 2)).astype(np.float32),
        rng.uniform(0, 3, n).astype(np.float32),
        rng.uniform(0, 0.6, (n, 3)).astype(np.float32),
    )


@pytest.fixture
def scene_3d() -> gs.Scene3d:
    rng = np.random.default_rng(2)
    n = 10
    means = rng.uniform(-1, 1, (n, 3)) + [0, 0, 5]
    return gs.Scene3d(
        means.astype(np.float32),
        rng.uniform(-2.5, -1, (n, 3)).astype(np.float32),
        rng.normal(size=(n, 4)).astype(np.float32),
        rng.uniform(-1, 1.5, n).astype(np.float32),
        rng.uniform(-0.5, 1, (n, 4, 3)).astype(np.float32),
    )


@pytest.fixture
def camera() -> gs.Camera:
    return gs.Camera(32, 24, fx=30.0)


def same(a: gs.Scene2d, b: gs.Scene2d) -> bool:
    """Whether two scenes have the same bits."""
    return a.arrays.keys() == b.arrays.keys() and all(
        np.array_equal(array, b.arrays[name]) for name, array in a.arrays.items()
    )


@pytest.fixture
def dataset(scene_3d: gs.Scene3d, tmp_path: Path) -> Path:
    """A small data set in Blender's form, of renderings of a scene."""
    folder = tmp_path / "dataset"
    folder.mkdir()
    splits = {"train": np.linspace(0, 5.5, 8), "test": np.array([0.3, 2.1])}
    for split, angles in splits.items():
        frames = []
        for number, angle in enumerate(angles):
            position = np.array([4 * np.sin(angle), 0.0, 5 - 4 * np.cos(angle)])
            camera = gs.Camera(48, 48, fx=48.0).looking_at(position.tolist(), [0, 0, 5])
            name = f"{split}_{number}"
            white = {"background": [1.0, 1.0, 1.0]}
            picture = np.clip(gs.render(scene_3d, camera, settings=white, backend="cpu"), 0, 1)
            gs.write_png(folder / f"{name}.png", picture)
            # Camera to world; Blender's world has z up, its cameras look along -z with y up.
            forward = np.array([0, 0, 5]) - position
            forward = forward / np.linalg.norm(forward)
            down = np.array([0.0, 1.0, 0.0])
            right = np.cross(down, forward)
            to_world = np.eye(4)
            to_world[:3, 0], to_world[:3, 1], to_world[:3, 2] = right, -down, -forward
            to_world[:3, 3] = position
            swap = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
            pose = (swap @ to_world).tolist()
            frames.append({"file_path": f"./{name}", "transform_matrix": pose})
        content = {"camera_angle_x": float(2 * np.arctan(0.5)), "frames": frames}
        (folder / f"transforms_{split}.json").write_text(json.dumps(content))
    return folder
