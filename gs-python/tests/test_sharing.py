"""Arrays that other libraries share without a copy."""

from __future__ import annotations

from typing import Any

import gaussian_splats as gs
import numpy as np
import pytest


@pytest.mark.skipif(not hasattr(np, "from_dlpack"), reason="this NumPy has no from_dlpack")
def test_dlpack_needs_no_copy_and_keeps_the_scene(scene_3d: gs.Scene3d) -> None:
    array = np.from_dlpack(gs.shared(scene_3d.sh))
    assert array.ctypes.data == scene_3d.sh.ctypes.data
    assert array.shape == (10, 4, 3) and array.dtype == np.float32
    expected = scene_3d.sh.tolist()
    del scene_3d
    assert array.tolist() == expected


def test_the_buffer_protocol_is_read_only(scene_3d: gs.Scene3d) -> None:
    view = memoryview(scene_3d.means)  # type: ignore[arg-type]
    assert view.readonly and view.shape == (10, 3) and view.format == "f"


def test_jax(scene_3d: gs.Scene3d) -> None:
    jax: Any = pytest.importorskip("jax")
    array = jax.numpy.from_dlpack(gs.shared(scene_3d.means))
    assert isinstance(array, jax.Array)
    assert np.array_equal(np.asarray(array), scene_3d.means)
