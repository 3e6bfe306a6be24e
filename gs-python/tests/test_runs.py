"""Fits and trainings."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import gaussian_splats as gs
import numpy as np
import pytest


def same(a: gs.Scene2d, b: gs.Scene2d) -> bool:
    names = ["means", "log_scales", "rotations", "colors"]
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)


def test_a_fit(image: np.ndarray, cpu: gs.Backend) -> None:
    seen: list[gs.Progress] = []
    fit = gs.fit(image, 200, preset="quick", backend=cpu, progress=seen.append)
    assert fit.psnr > 25
    assert fit.psnr == pytest.approx(gs.compare(fit.image, image)["psnr"], abs=1e-9)
    # The scene is rendered in other coordinates than it was trained in, which rounds otherwise.
    assert np.abs(gs.render(fit.scene, backend=cpu) - fit.image).max() < 1e-4
    assert fit.summary["gaussians"] == len(fit.scene)
    assert seen[-1].step == seen[-1].iterations == fit.summary["iterations"]
    assert fit._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]


def test_a_fit_is_the_same_for_every_number_of_threads(image: np.ndarray) -> None:
    fits = [gs.fit(image, 100, iterations=60, backend=gs.Backend("cpu", threads=n)) for n in [1, 2]]
    assert same(fits[0].scene, fits[1].scene)


def test_iterating_over_a_run(image: np.ndarray, cpu: gs.Backend) -> None:
    from tqdm import tqdm  # type: ignore[import-untyped,unused-ignore]

    run = gs.FitRun(image, 100, iterations=80, backend=cpu)
    assert len(run) == 80
    steps = [state.step for state in tqdm(run, disable=True)]
    assert steps == sorted(set(steps))
    assert steps[-1] == 80
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


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"gaussians": 0}, "number of Gaussians is 0"),
        ({"preset": "fast"}, "preset"),
        ({"policy": "abs"}, "policy"),
        ({"settings": {"adam": {"meen": 1}}}, r"settings\.adam\.meen: .*mean"),
        ({"settings": {"seed": "a"}}, r"settings\.seed: "),
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
    next(run)
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


INTERRUPTED = """
import sys
import gaussian_splats as gs
image, checkpoint = gs.read_image(sys.argv[1]), sys.argv[2]
cpu = gs.Backend("cpu", threads=1)
begun = lambda state: print(state.step, flush=True)
try:
    fit = gs.fit(image, 60, iterations=3000, backend=cpu, checkpoint=checkpoint, progress=begun)
except KeyboardInterrupt:
    sys.exit(9)
fit.scene.save(sys.argv[3])
"""


def test_ctrl_c_writes_a_checkpoint_from_which_the_fit_goes_on(
    image: np.ndarray, cpu: gs.Backend, tmp_path: Path
) -> None:
    gs.write_png(tmp_path / "image.png", image)
    checkpoint, result = tmp_path / "checkpoint.safetensors", tmp_path / "scene.gs2d.safetensors"
    command = [
        sys.executable,
        "-c",
        INTERRUPTED,
        str(tmp_path / "image.png"),
        str(checkpoint),
        str(result),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 9
    assert checkpoint.is_file()
    assert not result.exists()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    whole = gs.fit(tmp_path / "image.png", 60, iterations=3000, backend=cpu)
    resumed = gs.load(result)
    assert isinstance(resumed, gs.Scene2d)
    assert same(resumed, whole.scene)


def in_a_child(scene: gs.Scene2d | None) -> float:
    y = np.full((8, 8, 3), 0.5, np.float32)
    return gs.fit(y, 4, iterations=3).psnr


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_child_process_opens_its_own_backend(cpu: gs.Backend) -> None:
    in_a_child(None)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply(in_a_child, (None,)) > 5
        with pytest.raises(RuntimeError, match="forked"):
            pool.apply(use_parents, ())


PARENTS = gs.Backend("cpu", threads=1)


def use_parents() -> None:
    gs.fit(np.zeros((8, 8, 3), np.float32), 4, iterations=3, backend=PARENTS)


def blender(folder: Path, backend: gs.Backend, scene: gs.Scene3d) -> Path:
    """A small data set in Blender's form, of renderings of a scene."""
    import json

    splits = {"train": np.linspace(0, 5.5, 8), "test": np.array([0.3, 2.1])}
    for split, angles in splits.items():
        frames = []
        for number, angle in enumerate(angles):
            position = np.array([4 * np.sin(angle), 0.0, 5 - 4 * np.cos(angle)])
            camera = gs.Camera(48, 48, fx=48.0).looking_at(position.tolist(), [0, 0, 5])
            name = f"{split}_{number}"
            picture = np.clip(gs.render(scene, camera, backend=backend), 0, 1)
            gs.write_png(folder / f"{name}.png", picture)
            # Camera to world; Blender's world has z up, its cameras look along -z with y up.
            forward = np.array([0, 0, 5]) - position
            forward = forward / np.linalg.norm(forward)
            down = np.array([0.0, 1.0, 0.0])
            right = np.cross(down, forward)
            to_world = np.eye(4)
            to_world[:3, 0], to_world[:3, 1], to_world[:3, 2] = right, -down, -forward
            to_world[:3, 3] = position
            swap = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
            frames.append(
                {"file_path": f"./{name}", "transform_matrix": (swap @ to_world).tolist()}
            )
        content = {"camera_angle_x": float(2 * np.arctan(0.5)), "frames": frames}
        (folder / f"transforms_{split}.json").write_text(json.dumps(content))
    return folder


def test_a_training(scene_3d: gs.Scene3d, cpu: gs.Backend, tmp_path: Path) -> None:
    dataset = blender(tmp_path, cpu, scene_3d)
    seen: list[int] = []
    training = gs.train(
        dataset,
        400,
        iterations=60,
        start="random",
        settings={"init": {"random": 200}},
        backend=cpu,
        progress=lambda state: seen.append(state.step),
    )
    assert training.psnr == training.summary["evaluation"]["psnr"]
    assert 0 < len(training.scene) <= 400
    assert seen[-1] == 60
    with pytest.raises(ValueError, match="start"):
        gs.train(dataset, start="points", backend=cpu)
    with pytest.raises(OSError):
        gs.train(tmp_path / "nothing", backend=cpu)
