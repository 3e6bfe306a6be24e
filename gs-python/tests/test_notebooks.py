"""What notebooks show, and the tutorial."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gaussian_splats as gs
import numpy as np
import pytest

PNG = b"\x89PNG"
TUTORIAL = Path(__file__).parents[1] / "examples" / "tutorial.ipynb"


def test_scenes_show_themselves(scene_2d: gs.Scene2d, scene_3d: gs.Scene3d, tmp_path: Path) -> None:
    assert scene_2d._repr_png_() is None
    scene_2d.save(tmp_path / "scene.gs2d.safetensors", size=(32, 24))
    loaded = gs.load(tmp_path / "scene.gs2d.safetensors")._repr_png_()
    shown = scene_3d._repr_png_()
    assert loaded is not None and loaded.startswith(PNG)
    assert shown is not None and shown.startswith(PNG)


def test_curves(image: np.ndarray) -> None:
    pytest.importorskip("matplotlib")
    from gaussian_splats.plots import curves

    fit = gs.fit(image, 50, iterations=40, backend="cpu")
    figure = curves({"first": fit, "second": fit}, against="seconds")
    (first, second) = figure.axes
    assert len(first.lines) == len(second.lines) == 2
    assert np.array_equal(first.lines[0].get_xdata(), fit.history["seconds"])
    assert np.array_equal(second.lines[1].get_ydata(), fit.history["count"])
    assert first.get_ylabel() == "PSNR, dB"
    figure.savefig("/dev/null", format="png")
    with pytest.raises(ValueError, match="against: expected 'step' or 'seconds'"):
        curves(fit, against="time")


def test_the_tutorial_runs() -> None:
    nbclient: Any = pytest.importorskip("nbclient")
    nbformat: Any = pytest.importorskip("nbformat")
    notebook = nbformat.read(TUTORIAL, as_version=4)
    nbclient.NotebookClient(notebook, timeout=180, kernel_name="python3").execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    printed = "".join(output.get("text", "") for output in outputs)
    assert "Equal, bit for bit" in printed
    assert "24 runs" in printed
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) == 3
