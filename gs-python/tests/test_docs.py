"""The examples of docs/python.md run as they are printed, one after the other."""

from __future__ import annotations

import importlib.util
import re
import shutil
from pathlib import Path
from typing import Any

import gaussian_splats as gs
import numpy as np
import pytest
from test_studies import STUDY

PAGE = Path(__file__).parents[2] / "docs" / "python.md"

# Smaller numbers, so that the examples take seconds.
QUICKER = [("9000", "300"), ("gaussians=9000", "gaussians=300"), ("100_000", "200")]


def test_the_examples_run(
    dataset: Path,
    scene_3d: gs.Scene3d,
    image: np.ndarray,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    gs.write_png("photo.png", image)
    scene_3d.save("bicycle.spz")
    scene_3d.save("city/lod-meta.json")
    Path("study.toml").write_text(STUDY)
    Path("out").mkdir()
    Path("out/settings.toml").write_text("gaussians = 40\niterations = 20\n")
    # Short trainings, whatever the preset.
    train = gs.train
    monkeypatch.setattr(gs, "train", lambda *a, **k: train(*a, **k, iterations=30, start="random"))
    examples = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    assert len(examples) > 12
    space: dict[str, Any] = {"__name__": "__main__"}
    for example in examples:
        needed = re.search(r"^import (ray)$|\b(torch)\b", example, re.MULTILINE)
        if needed and (needed[1] or importlib.util.find_spec("torch") is None):
            continue
        for usual, quicker in QUICKER:
            example = example.replace(usual, quicker)
        path = tmp_path / f"example{len(space)}.py"
        # Studies want to know the source of a policy.
        path.write_text(example)
        exec(compile(example, str(path), "exec"), space)
    assert {"photo.gsi", "near.ply", "scene.ply", "fit.png", "curves.png"} <= {
        path.name for path in tmp_path.iterdir()
    }
    assert (tmp_path / "results" / "report.html").is_file()
    shutil.rmtree(tmp_path / "results")
