"""What the tests share."""

from __future__ import annotations

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
