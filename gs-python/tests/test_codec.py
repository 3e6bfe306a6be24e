"""Compressed images."""

from __future__ import annotations

from pathlib import Path

import gaussian_splats as gs
import numpy as np
import pytest


def test_an_image_is_encoded_and_decoded(image: np.ndarray, tmp_path: Path) -> None:
    encoded = gs.encode(image, bytes=1500, backend="cpu")
    assert len(encoded.data) <= 1500
    scene = gs.decode(encoded.data)
    assert (len(scene), scene.size) == (encoded.gaussians, (64, 48))
    found = gs.compare(np.clip(gs.render(scene, backend="cpu"), 0, 1), image)["psnr"]
    assert found == pytest.approx(encoded.psnr, abs=0.01)
    assert found > 20
    file = tmp_path / "image.gsi"
    file.write_bytes(encoded.data)
    loaded = gs.load(file)
    assert np.array_equal(loaded.means, scene.means)


def test_the_first_third_of_a_progressive_file_is_a_picture(image: np.ndarray) -> None:
    encoded = gs.encode(image, bytes=2400, progressive=True, backend="cpu")
    third = encoded.data[: len(encoded.data) // 3]
    with pytest.raises(ValueError, match="truncated"):
        gs.decode(third)
    scene = gs.decode(third, partial=True)
    assert 0 < len(scene) < encoded.gaussians
    plain = gs.encode(image, bytes=768, backend="cpu")
    assert np.array_equal(scene.means[: plain.gaussians], gs.decode(plain.data).means)


def test_wrong_targets_and_data(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="expected at most one of them"):
        gs.encode(image, quality=50, psnr=30.0)
    with pytest.raises(ValueError, match="quality"):
        gs.encode(image, quality=0)
    with pytest.raises(ValueError, match="bpp"):
        gs.encode(image, bpp=-1.0)
    with pytest.raises(TypeError, match="image: expected a NumPy array"):
        gs.encode(3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="data: "):
        gs.decode(b"no image")
