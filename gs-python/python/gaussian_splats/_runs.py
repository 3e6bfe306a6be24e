"""Whole fits and trainings in one call."""

from __future__ import annotations

from typing import Callable

from ._native import Backend, Fit, FitRun, Progress, Training, TrainRun
from ._types import ImageSource, Path, Policy, Settings


def fit(
    image: ImageSource,
    gaussians: int | None = None,
    *,
    preset: str = "standard",
    iterations: int | None = None,
    policy: str | Policy | None = None,
    settings: Settings | None = None,
    backend: Backend | None = None,
    checkpoint: Path | None = None,
    progress: Callable[[Progress], object] | None = None,
) -> Fit:
    """Fit 2D Gaussians to an image.

    :param image: a file, or an array of shape (H, W, 3), float32 with 0 to 1 or uint8.
    :param gaussians: largest number of Gaussians; by default 9,000 per 768x512 pixels.
    :param preset: "quick", "standard", "best" or "paper", as for ``gs fit``.
    :param iterations: number of steps; by default the preset's.
    :param policy: a name, as for ``gs fit --policy``, or an object with a method ``plan``.
    :param settings: changes to all that, with the names of settings files.
    :param backend: what computes; by default a GPU if there is one, otherwise the CPU.
    :param checkpoint: a file from which an interrupted fit goes on if it exists, and to which
        Ctrl-C writes the state of this one.
    :param progress: called now and then, at least after each round of density control.
    :raises TypeError: for an array of the wrong dtype.
    :raises ValueError: for a wrong shape or setting.
    :raises OSError: for a file that cannot be read.
    """
    run = FitRun(
        image,
        gaussians,
        preset=preset,
        iterations=iterations,
        policy=policy,
        settings=settings,
        backend=backend,
        checkpoint=checkpoint,
    )
    for state in run:
        if progress is not None:
            progress(state)
    return run.result()


def train(
    dataset: Path,
    gaussians: int | None = None,
    *,
    preset: str = "standard",
    iterations: int | None = None,
    start: str | None = None,
    reading: Settings | None = None,
    policy: str | Policy | None = None,
    settings: Settings | None = None,
    backend: Backend | None = None,
    checkpoint: Path | None = None,
    progress: Callable[[Progress], object] | None = None,
) -> Training:
    """Train a 3D scene from posed images.

    :param dataset: the folder of a COLMAP, Nerfstudio or Blender data set.
    :param gaussians: largest number of Gaussians; by default the preset's.
    :param preset: "quick", "standard", "3dgs" or "mcmc", as for ``gs train``.
    :param start: "points", "depths", "images" or "random"; by default what suits the data set.
    :param reading: how the data set is read: "max-size", "holdout", "images", "alpha", "views" and
        "test-views", as in study files.

    Other parameters and errors are those of :func:`fit`.
    """
    run = TrainRun(
        dataset,
        gaussians,
        preset=preset,
        iterations=iterations,
        start=start,
        reading=reading,
        policy=policy,
        settings=settings,
        backend=backend,
        checkpoint=checkpoint,
    )
    for state in run:
        if progress is not None:
            progress(state)
    return run.result()
