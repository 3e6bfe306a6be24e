"""Whole fits and trainings in one call."""

from __future__ import annotations

from contextlib import suppress
from typing import Callable, TypeVar

from ._native import Fit, FitRun, Progress, Scene3d, Training, TrainRun
from ._types import BackendChoice, ImageSource, Path, Policy, Settings

_Run = TypeVar("_Run", FitRun, TrainRun)


def fit(
    image: ImageSource,
    gaussians: int | None = None,
    *,
    preset: str | None = None,
    iterations: int | None = None,
    policy: str | Policy | None = None,
    settings: Settings | Path | None = None,
    backend: BackendChoice = None,
    checkpoint: Path | None = None,
    progress: Callable[[Progress], object] | None = None,
) -> Fit:
    """Fit 2D Gaussians to an image.

    :param image: a file, or an array of shape (H, W, 3), float32 with 0 to 1 or uint8.
    :param gaussians: largest number of Gaussians; by default 9,000 per 768x512 px.
    :param preset: "standard" (the default), "quick", "best" or "paper", as for ``gs fit``.
    :param iterations: number of steps; by default the preset's.
    :param policy: a name, as for ``gs fit --policy``, or an object with a method ``plan``
        (:class:`Policy`).
    :param settings: changes to all that, with the names of settings files; or a settings file,
        such as the ``settings.toml`` of a fit, in place of a preset.
    :param backend: a backend or its name; by default a GPU if there is one, otherwise the CPU.
    :param checkpoint: a file for the state of the fit. The state is written every two minutes, and
        when the fit is interrupted, for example by Ctrl-C. If the file exists, the fit goes on
        from it. At the end the file is removed.
    :param progress: called with the state after each step.
    :raises TypeError: for an argument of the wrong type, or an array of the wrong dtype.
    :raises ValueError: for a wrong shape or setting, and for a checkpoint of a fit with others.
    :raises OSError: for a file that cannot be read.
    """
    _check(progress)
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
    _follow(run, progress)
    return run.result()


def train(
    dataset: Path,
    gaussians: int | None = None,
    *,
    preset: str | None = None,
    iterations: int | None = None,
    start: str | Scene3d | None = None,
    reading: Settings | None = None,
    policy: str | Policy | None = None,
    settings: Settings | Path | None = None,
    backend: BackendChoice = None,
    checkpoint: Path | None = None,
    progress: Callable[[Progress], object] | None = None,
) -> Training:
    """Train a 3D scene from posed images.

    :param dataset: the folder of a COLMAP, Nerfstudio or Blender data set.
    :param gaussians: largest number of Gaussians; by default the preset's, which many initial
        points raise.
    :param preset: "standard" (the default), "quick", "3dgs" or "mcmc", as for ``gs train``.
    :param iterations: number of steps; by default the preset's.
    :param start: "points" (those of the data set), "points-and-images" (these and points found
        in the images), "depths" (these and points of the depth maps), "images" (only points found
        in the images) or "random"; or a scene, whose antialiasing a preset keeps. The default is
        that of ``gs train``.
    :param reading: how the data set is read: "max-size", "holdout", "images", "alpha", "views" and
        "test-views", as in study files.

    Other parameters and errors are those of :func:`fit`.
    """
    _check(progress)
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
    _follow(run, progress)
    return run.result()


def _check(progress: object) -> None:
    if progress is not None and not callable(progress):
        found = type(progress).__name__
        raise TypeError(f"progress: expected a function of the state, not {found}")


def _follow(run: _Run, progress: Callable[[Progress], object] | None) -> None:
    """Reports the steps of a run. If that fails, the run is stopped and its checkpoint written."""
    if progress is None:
        return
    try:
        for state in run:
            progress(state)
    except BaseException:
        run.stop()
        with suppress(Exception):
            run.result()
        raise
