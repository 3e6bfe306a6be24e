"""Plots of runs, for which matplotlib must be installed (``pip install matplotlib``)."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ._native import Fit, Training


class _Figure(Figure):
    """A figure that shows itself in notebooks without pyplot, which draws in a state of its own."""

    def _repr_png_(self) -> bytes:
        png = io.BytesIO()
        self.savefig(png, format="png", dpi=100)
        return png.getvalue()


def curves(
    runs: Fit | Training | Mapping[str, Fit | Training], *, against: str = "step", axes: Any = None
) -> Any:
    """PSNR and number of Gaussians of one or several runs over their steps.

    PSNR is estimated from the loss. Where the loss is not L2, the loss is shown instead.

    :param runs: a run, or runs by the names of the legend.
    :param against: "step", or "seconds" of training time.
    :param axes: two axes of matplotlib to draw on, for PSNR and for the number of Gaussians; by
        default those of a new figure.
    :returns: the figure of matplotlib, which notebooks show.
    :raises ValueError: for another ``against``.
    """
    if against not in ("step", "seconds"):
        raise ValueError(f"against: expected 'step' or 'seconds', not {against!r}")
    named = runs if isinstance(runs, Mapping) else {"": runs}
    histories = {name: run.history for name, run in named.items()}
    has_psnr = all(np.isfinite(history["psnr"]).any() for history in histories.values())
    quality, unit = ("psnr", "PSNR, dB") if has_psnr else ("loss", "loss")
    if axes is None:
        axes = _Figure(figsize=(9.0, 3.2), layout="constrained").subplots(1, 2)
    first, second = axes
    for name, history in histories.items():
        first.plot(history[against], history[quality], label=name)
        second.plot(history[against], history["count"], label=name)
    for axis, label in [(first, unit), (second, "Gaussians")]:
        axis.set_xlabel("step" if against == "step" else "training time, s")
        axis.set_ylabel(label)
    if len(named) > 1:
        first.legend()
    return first.figure
