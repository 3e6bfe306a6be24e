"""Compressed images."""

from __future__ import annotations

import zlib
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


def test_alpha_and_profile_are_kept(image: np.ndarray, tmp_path: Path) -> None:
    rows, columns, _ = image.shape
    alpha = np.linspace(0, 1, columns, dtype=np.float32)[None, :, None].repeat(rows, 0)
    encoded = gs.encode(np.concatenate([image, alpha], 2), bytes=3000, backend="cpu")
    assert len(encoded.data) <= 3000
    pixels = gs.decode_image(encoded.data, backend="cpu")
    assert pixels.shape == (rows, columns, 4)
    assert pixels.dtype == np.uint8
    assert np.abs(pixels[..., 3:] / 255 - alpha).mean() < 0.01
    shown = gs.render(gs.decode(encoded.data), backend="cpu")
    found = gs.compare(np.clip(shown, 0, 1), image * alpha + 1 - alpha)["psnr"]
    assert found > 25

    opaque = gs.encode(image, bytes=1500, preview=True, backend="cpu").data
    assert gs.decode(opaque).profile is None
    assert gs.decode_image(opaque, size=(32, 24), backend="cpu").shape == (24, 32, 3)
    assert len(gs.decode(opaque[:320], partial=True)) > 0

    # A profile is behind the header, and the checksum of a file of one layer at its end.
    data = gs.encode(image, bytes=900, backend="cpu").data
    packed = zlib.compress(b"profile")
    block = len(packed).to_bytes(2, "little") + packed
    data = data[:5] + b"\x02" + data[6:14] + block + data[14:-4]
    scene = gs.decode(data + zlib.crc32(data).to_bytes(4, "little"))
    assert scene.profile == b"profile"
    scene.save(tmp_path / "a.gs2d.safetensors")
    loaded = gs.load(tmp_path / "a.gs2d.safetensors")
    assert isinstance(loaded, gs.Scene2d)
    assert loaded.profile == b"profile"


def test_wrong_targets_and_data(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="expected at most one of them"):
        gs.encode(image, quality=50, psnr=30.0)
    with pytest.raises(ValueError, match="quality"):
        gs.encode(image, quality=0)
    with pytest.raises(ValueError, match="expected at most one of them"):
        gs.encode(image, progressive=True, preview=True)
    with pytest.raises(ValueError, match="tune"):
        gs.encode(image, tune="looks")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="bpp"):
        gs.encode(image, bpp=-1.0)
    with pytest.raises(TypeError, match="image: expected a NumPy array"):
        gs.encode(3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="data: "):
        gs.decode(b"no image")
