"""Camera poses, with a program in place of COLMAP."""

from __future__ import annotations

import struct
from pathlib import Path

import gaussian_splats as gs
import numpy as np
import pytest

COLMAP = """#!/bin/sh
[ "$1" = help ] && echo "COLMAP 3.8 -- fake" && exit 0
[ "$2" = -h ] && exit 0
for last; do :; done
case "$1" in
feature_extractor) echo "Processed file [2/4]" ;;
mapper) cp -r "${0%/*}/model" "$(echo "$*" | sed 's/.*--output_path \\([^ ]*\\).*/\\1/')/0" ;;
esac
"""


@pytest.fixture
def photos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, image: np.ndarray) -> Path:
    """Four photographs, and a COLMAP that finds the poses of three."""
    (tmp_path / "bin" / "model").mkdir(parents=True)
    program = tmp_path / "bin" / "colmap"
    program.write_text(COLMAP)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
    photos = tmp_path / "photos"
    photos.mkdir()
    for i in range(4):
        gs.write_png(photos / f"{i}.png", np.roll(image, 3 * i, axis=1))
    model = tmp_path / "bin" / "model"
    images = [
        struct.pack("<I7dI", i + 1, 1, 0, 0, 0, -i, 0, 0, 1)
        + f"{i}.png\0".encode()
        + struct.pack("<Q", 200)
        + b"".join(struct.pack("<ddQ", 1, 1, p) for p in range(200))
        for i in range(3)
    ]
    (model / "images.bin").write_bytes(struct.pack("<Q", 3) + b"".join(images))
    points = [struct.pack("<Q3d3BdQ", p, p / 50, 0, 4, 9, 9, 9, 0.5, 0) for p in range(200)]
    (model / "points3D.bin").write_bytes(struct.pack("<Q", 200) + b"".join(points))
    camera = struct.pack("<QIIQQ3d", 1, 1, 0, 64, 48, 60, 32, 24)
    (model / "cameras.bin").write_bytes(camera)
    return photos


def test_poses_are_found_and_judged(photos: Path, tmp_path: Path) -> None:
    stages: list[tuple[str, int, int]] = []
    output = tmp_path / "dataset"
    (photos / "broken.png").write_text("no image")
    with pytest.warns(UserWarning, match=r"left out: .*broken\.png"):
        verdict = gs.poses(photos, output, progress=lambda *report: stages.append(report))
    (photos / "broken.png").unlink()
    assert (verdict["quality"], verdict["registered"], verdict["photographs"]) == ("usable", 3, 4)
    assert verdict["left_out"][0]["name"] == "3.png"
    assert verdict["error_px"] == pytest.approx(0.5)
    assert ("finding features", 2, 4) in stages
    assert {stage for stage, _, _ in stages} >= {"matching the photographs", "finding the poses"}
    assert (output / "sparse" / "0" / "cameras.bin").is_file()
    stages.clear()
    assert gs.poses(photos, output, resume=True, progress=lambda *r: stages.append(r)) == verdict
    assert stages == []


def test_a_slow_version_is_a_warning(photos: Path, tmp_path: Path) -> None:
    (tmp_path / "bin" / "colmap").write_text(COLMAP.replace("3.8", "4.0.2"))
    with pytest.warns(UserWarning, match=r"COLMAP 4\.0\.2 compares photographs .* more slowly"):
        gs.poses(photos, tmp_path / "dataset")


def test_an_exception_ends_the_work(photos: Path, tmp_path: Path) -> None:
    def refuse(stage: str, done: int, total: int) -> None:
        raise KeyError(stage)

    with pytest.raises(KeyError, match="finding features"):
        gs.poses(photos, tmp_path / "dataset", progress=refuse)
    assert not (tmp_path / "dataset" / "sparse").exists()


def test_what_cannot_work_is_refused(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(OSError, match="no such folder"):
        gs.poses(tmp_path / "nowhere", tmp_path / "dataset")
    with pytest.raises(ValueError, match="lens"):
        gs.poses(photos, tmp_path / "dataset", lens="round")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="max_size"):
        gs.poses(photos, tmp_path / "dataset", max_size=10)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="no photograph"):
        gs.poses(tmp_path / "empty", tmp_path / "dataset")
    assert not (tmp_path / "dataset").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "transforms.json").write_text("{}")
    with pytest.raises(OSError, match="has camera poses already"):
        gs.poses(photos, tmp_path / "mine")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("GS_PYTHON", str(tmp_path / "no-python"))
    with pytest.raises(RuntimeError, match="pip install pycolmap"):
        gs.poses(photos, tmp_path / "dataset")
