"""Fits and trainings."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import gaussian_splats as gs
import numpy as np
import pytest
from conftest import same


def test_a_fit(image: np.ndarray, cpu: gs.Backend) -> None:
    seen: list[gs.Progress] = []
    fit = gs.fit(image, 200, preset="quick", backend=cpu, progress=seen.append)
    assert fit.psnr > 25
    assert fit.psnr == pytest.approx(gs.compare(fit.image, image)["psnr"], abs=1e-9)
    # The scene is rendered in other coordinates than it was trained in, which rounds otherwise.
    assert np.abs(gs.render(fit.scene, backend=cpu) - fit.image).max() < 1e-4
    assert fit.summary["gaussians"] == len(fit.scene)
    assert seen[-1].step == seen[-1].iterations == fit.summary["iterations"]
    assert fit._repr_png_().startswith(b"\x89PNG")
    assert [state.step for state in seen] == fit.history["step"].tolist()
    assert fit.history["psnr"][-1] == pytest.approx(fit.psnr, abs=0.5)


def test_a_fit_is_the_same_for_every_number_of_threads(image: np.ndarray) -> None:
    fits = [gs.fit(image, 100, iterations=60, backend=gs.Backend("cpu", threads=n)) for n in [1, 2]]
    assert same(fits[0].scene, fits[1].scene)


def test_iterating_over_a_run(image: np.ndarray, cpu: gs.Backend) -> None:
    from tqdm import tqdm  # type: ignore[import-untyped,unused-ignore]

    run = gs.FitRun(image, 100, iterations=80, backend=cpu)
    assert len(run) == 80
    steps = [state.step for state in tqdm(run, disable=True)]
    assert steps == list(range(1, 81))
    assert run.result().psnr == run.result().psnr


def test_two_runs_at_once_and_two_threads(image: np.ndarray, cpu: gs.Backend) -> None:
    alone = gs.fit(image, 80, iterations=50, backend=cpu)
    found: list[gs.Fit] = []
    threads = [
        threading.Thread(target=lambda: found.append(gs.fit(image, 80, iterations=50, backend=cpu)))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 3
    assert all(same(fit.scene, alone.scene) for fit in found)


def test_an_image_that_changes_during_a_fit(image: np.ndarray, cpu: gs.Backend) -> None:
    alone = gs.fit(image, 80, iterations=60, backend=cpu)
    mine = image.copy()
    run = gs.FitRun(mine, 80, iterations=60, backend=cpu)
    mine[:] = 0.0
    assert same(run.result().scene, alone.scene)


def test_settings_from_a_file(image: np.ndarray, cpu: gs.Backend, tmp_path: Path) -> None:
    file = tmp_path / "settings.toml"
    file.write_text("gaussians = 50\niterations = 30\nseed = 3\n")
    fit = gs.fit(image, settings=file, backend=cpu)
    settings = fit.summary["settings"]
    assert (settings["gaussians"], settings["iterations"], settings["seed"]) == (50, 30, 3)
    assert gs.fit(image, 20, settings=str(file), backend=cpu).summary["settings"]["gaussians"] == 20
    with pytest.raises(ValueError, match="preset: the file of settings has all settings"):
        gs.fit(image, preset="quick", settings=file, backend=cpu)
    file.write_text("gaussains = 50\n")
    with pytest.raises(ValueError, match="settings.toml:1: unknown key `gaussains`"):
        gs.fit(image, settings=file, backend=cpu)
    with pytest.raises(OSError, match="nothing.toml"):
        gs.fit(image, settings=tmp_path / "nothing.toml", backend=cpu)


def test_settings_with_numbers_of_numpy(image: np.ndarray, cpu: gs.Backend) -> None:
    changes = {"seed": np.int64(7), "adam": {"mean": {"beta1": np.float32(0.5)}}}
    settings = gs.fit(image, 20, iterations=3, settings=changes, backend=cpu).summary["settings"]
    assert (settings["seed"], settings["adam"]["mean"]["beta1"]) == (7, 0.5)


def test_settings_without_a_value(image: np.ndarray, cpu: gs.Backend) -> None:
    with pytest.raises(ValueError, match=r"settings\.adam\.mean: a setting cannot be None"):
        gs.fit(image, 20, iterations=3, settings={"adam": {"mean": None}}, backend=cpu)


def test_backends_by_name(image: np.ndarray) -> None:
    named = gs.fit(image, 40, iterations=20, backend="cpu")
    assert same(named.scene, gs.fit(image, 40, iterations=20, backend=gs.Backend("cpu")).scene)
    with pytest.raises(ValueError, match='backend: "gpu" is not one of'):
        gs.fit(image, 40, backend="gpu")
    with pytest.raises(TypeError, match="backend: expected a Backend or a name, not int"):
        gs.fit(image, 40, backend=2)  # type: ignore[arg-type]


def test_a_checkpoint_of_a_run_with_other_settings(
    image: np.ndarray, cpu: gs.Backend, tmp_path: Path
) -> None:
    checkpoint = tmp_path / "checkpoint.safetensors"
    run = gs.FitRun(image, 50, iterations=100_000, backend=cpu, checkpoint=checkpoint)
    next(run)
    run.stop()
    with pytest.raises(RuntimeError, match="stopped"):
        run.result()
    assert checkpoint.is_file()
    others: list[dict[str, Any]] = [{"gaussians": 60}, {"settings": {"seed": 9}}]
    for other in others:
        arguments: Any = {"gaussians": 50, "iterations": 100_000, **other}
        with pytest.raises(ValueError, match="checkpoint: .* other settings"):
            gs.fit(image, **arguments, backend=cpu, checkpoint=checkpoint)
    with pytest.raises(ValueError, match="belongs to another target"):
        gs.fit(1 - image, 50, iterations=100_000, backend=cpu, checkpoint=checkpoint)
    checkpoint.write_bytes(b"no checkpoint")
    with pytest.raises(OSError, match=r"checkpoint\.safetensors"):
        gs.fit(image, 50, backend=cpu, checkpoint=checkpoint)


def test_checkpoints_where_none_can_be_written(image: np.ndarray, tmp_path: Path) -> None:
    for path, says in [(tmp_path, "is a folder"), (tmp_path / "no" / "file", "there is no folder")]:
        with pytest.raises(OSError, match=f"checkpoint: .*{says}"):
            gs.FitRun(image, 10, iterations=2, backend="cpu", checkpoint=path)


def test_impossible_threads() -> None:
    for threads in [0, 10**9]:
        with pytest.raises(ValueError, match=f"threads is {threads}, but must be 1 to 1024"):
            gs.Backend("cpu", threads=threads)


def test_progress_that_is_no_function(image: np.ndarray) -> None:
    with pytest.raises(TypeError, match="progress: expected a function of the state, not int"):
        gs.fit(image, 10, iterations=2, backend="cpu", progress=3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("wrong", "error", "says"),
    [
        (np.zeros((8, 8, 3)), TypeError, "image: .* float32 .*, not an array of float64"),
        (np.zeros((8, 8), np.float32), ValueError, r"image: expected shape \(H, W, 3\)"),
        (np.zeros((8, 8, 4), np.uint8), ValueError, r"image: expected shape \(H, W, 3\)"),
        (np.zeros((8, 8, 3), np.float32)[:, ::-1], ValueError, "image: .*ascontiguousarray"),
        (np.full((8, 8, 3), np.nan, np.float32), ValueError, r"image\[0, 0, 0\] is NaN"),
        (np.zeros((0, 8, 3), np.float32), ValueError, "image"),
        (7, TypeError, "image: expected a NumPy array"),
        ("nothing.png", OSError, "nothing.png"),
    ],
)
def test_wrong_images(wrong: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        gs.fit(wrong, 10, iterations=2, backend="cpu")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"gaussians": 0}, "number of Gaussians is 0"),
        ({"preset": "fast"}, "preset"),
        ({"policy": "abs"}, "policy"),
        ({"settings": {"adam": {"meen": 1}}}, "settings: .*`meen` in .adam.*mean"),
        ({"settings": {"seed": "a"}}, "settings: seed: "),
        ({"settings": {"seed": object()}}, "settings: not possible as settings"),
    ],
)
def test_wrong_arguments(image: np.ndarray, arguments: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        gs.fit(image, **arguments)  # type: ignore[arg-type]


def test_a_policy_that_is_no_policy(image: np.ndarray) -> None:
    with pytest.raises(TypeError, match="policy: expected a name or an object with a method plan"):
        gs.fit(image, 50, policy=3)  # type: ignore[arg-type]


def test_a_run_that_is_dropped_stops(image: np.ndarray, cpu: gs.Backend) -> None:
    run = gs.FitRun(image, 200, iterations=1_000_000, backend=cpu)
    next(iter(run))
    del run
    # The backend is free again.
    assert gs.fit(image, 20, iterations=5, backend=cpu).psnr > 5


def test_a_stopped_run_has_no_result(image: np.ndarray, cpu: gs.Backend) -> None:
    run = gs.FitRun(image, 200, iterations=1_000_000, backend=cpu)
    run.stop()
    with pytest.raises(RuntimeError, match="stopped"):
        run.result()
    with pytest.raises(RuntimeError, match="no result"):
        run.result()


def test_a_training(dataset: Path, cpu: gs.Backend) -> None:
    training = gs.train(
        dataset,
        400,
        iterations=60,
        start="random",
        settings={"init": {"random": 200}},
        backend=cpu,
    )
    assert training.psnr == training.summary["evaluation"]["psnr"]
    assert 0 < len(training.scene) <= 400
    assert training.history["step"].tolist() == list(range(1, 61))
    evaluation = gs.evaluate(training.scene, dataset, backend=cpu)
    assert evaluation["psnr"] == pytest.approx(training.psnr, abs=1e-6)
    assert len(evaluation["views"]) == 2
    again = gs.train(dataset, 400, iterations=3, start=training.scene, backend=cpu)
    assert again.psnr > training.psnr - 3
    shown = training._repr_png_()
    assert shown is not None and shown.startswith(b"\x89PNG")


def test_a_scene_to_start_from_keeps_its_antialiasing(
    dataset: Path, cpu: gs.Backend, tmp_path: Path
) -> None:
    def trained(start: Any, render: dict[str, Any]) -> gs.Scene3d:
        options: Any = {"iterations": 2, "settings": {"init": {"random": 50}, "render": render}}
        return gs.train(dataset, 200, start=start, backend=cpu, **options).scene

    def antialias(scene: gs.Scene3d) -> str:
        scene.save(tmp_path / "scene.ply")
        header = (tmp_path / "scene.ply").read_bytes().split(b"end_header")[0]
        return header.split(b"gs antialias: ")[1].split()[0].decode()

    assert antialias(trained("random", {})) == "mip", "the images are rendered"
    scene = trained("random", {"effects": {"antialias": "compensated"}})
    assert antialias(scene) == "compensated"
    assert antialias(trained(scene, {"background": [0.1, 0.2, 0.3]})) == "compensated"
    assert antialias(trained(scene, {"effects": {"antialias": "dilate"}})) == "dilate"


def test_a_policy_in_a_training(dataset: Path, cpu: gs.Backend) -> None:
    seen: list[tuple[int, ...]] = []

    class Watching:
        def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
            seen.append(observation.means.shape)
            most = np.argsort(-observation.signal, kind="stable")
            return gs.Plan(grow=most[:3])

    options: Any = {"iterations": 300, "start": "random", "settings": {"init": {"random": 100}}}
    gs.train(dataset, 200, policy=Watching(), backend=cpu, **options)
    assert seen and all(shape[1] == 3 for shape in seen)


def test_a_policy_follows_the_rounds_of_the_settings(dataset: Path, cpu: gs.Backend) -> None:
    def final_every(every: int) -> int:
        settings: Any = {"init": {"random": 50}, "rounds": {"every": every}}
        options: Any = {"iterations": 100, "start": "random", "settings": settings}
        training = gs.train(dataset, 60, policy="fastgs", backend=cpu, **options)
        return int(training.summary["settings"]["policy"]["final-every"])

    assert final_every(25) == 25
    assert final_every(50) == 50


def test_wrong_arguments_of_a_training(dataset: Path, cpu: gs.Backend, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="start"):
        gs.train(dataset, start="points", backend=cpu)
    with pytest.raises(TypeError, match="start: expected a name or a Scene3d, not int"):
        gs.train(dataset, start=3, backend=cpu)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="reading: .*`max_size`.*max-size"):
        gs.train(dataset, reading={"max_size": 3}, backend=cpu)
    with pytest.raises(OSError):
        gs.train(tmp_path / "nothing", backend=cpu)


def test_a_resumed_training(dataset: Path, cpu: gs.Backend, tmp_path: Path) -> None:
    checkpoint = tmp_path / "checkpoint.safetensors"
    options: Any = {"iterations": 60, "start": "random", "backend": cpu}
    run = gs.TrainRun(dataset, 200, checkpoint=checkpoint, **options)
    next(run)
    run.stop()
    with pytest.raises(RuntimeError, match="stopped"):
        run.result()
    assert checkpoint.is_file()
    with pytest.raises(ValueError, match="checkpoint: the file is of a run with other settings"):
        gs.train(dataset, 300, checkpoint=checkpoint, **options)
    rest = gs.TrainRun(dataset, 200, checkpoint=checkpoint, **options)
    assert 0 < len(rest) < 60
    resumed, whole = rest.result(), gs.train(dataset, 200, **options)
    assert np.array_equal(resumed.scene.means, whole.scene.means)
    assert not checkpoint.exists()
    # With the preset's number, which points may raise.
    run = gs.TrainRun(dataset, checkpoint=checkpoint, **options)
    next(run)
    run.stop()
    with pytest.raises(RuntimeError, match="stopped"):
        run.result()
    assert len(gs.train(dataset, checkpoint=checkpoint, **options).scene) > 0


@pytest.mark.parametrize("start", ["random", "scene"])
def test_a_resumed_training_whose_numbers_are_decided_at_its_start(
    dataset: Path, cpu: gs.Backend, tmp_path: Path, start: str
) -> None:
    checkpoint = tmp_path / "checkpoint.safetensors"
    changes: Any = {"lengthen-to": 120, "decide-gaussians": True}
    first: Any = start
    if start == "scene":
        short: Any = {"iterations": 5, "start": "random"}
        first = gs.train(dataset, 200, backend=cpu, **short).scene
    options: Any = {"iterations": 60, "settings": changes, "start": first, "backend": cpu}
    run = gs.TrainRun(dataset, checkpoint=checkpoint, **options)
    next(run)
    run.stop()
    with pytest.raises(RuntimeError, match="stopped"):
        run.result()
    resumed = gs.train(dataset, checkpoint=checkpoint, **options)
    whole = gs.train(dataset, **options)
    assert ("trial" in whole.summary) == (start == "random")
    assert np.array_equal(resumed.scene.means, whole.scene.means)


def test_a_number_of_steps_in_settings_is_not_lengthened(dataset: Path, cpu: gs.Backend) -> None:
    options: Any = {"settings": {"iterations": 30}, "start": "random", "backend": cpu}
    summary = gs.train(dataset, 200, **options).summary
    assert "trial" not in summary
    assert summary["settings"]["iterations"] == 30
