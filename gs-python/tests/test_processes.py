"""Signals, forks, and the end of the interpreter."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import gaussian_splats as gs
import numpy as np
import pytest
from conftest import same

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
    assert not checkpoint.exists()
    whole = gs.fit(tmp_path / "image.png", 60, iterations=3000, backend=cpu)
    resumed = gs.load(result)
    assert isinstance(resumed, gs.Scene2d)
    assert same(resumed, whole.scene)


def fitted_psnr() -> float:
    """A fit that is large enough for its seeding to use threads."""
    y, x = np.mgrid[0:256, 0:256].astype(np.float32) / 256
    image = np.ascontiguousarray(np.stack([x, y, np.abs(np.sin(9 * x * y))], axis=2))
    return gs.fit(image, 2000, iterations=4, backend="cpu").psnr


PARENTS = gs.Backend("cpu", threads=1)


def use_parents_backend() -> None:
    gs.fit(np.zeros((8, 8, 3), np.float32), 4, iterations=3, backend=PARENTS)


def use_parents_run() -> None:
    RUNS[0].result()


RUNS: list[gs.FitRun] = []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
def test_a_child_process_opens_its_own_backend(image: np.ndarray) -> None:
    expected = fitted_psnr()
    RUNS.append(gs.FitRun(image, 10, iterations=1_000_000, backend=PARENTS))
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(fitted_psnr).get(60) == expected
        with pytest.raises(RuntimeError, match="forked"):
            pool.apply_async(use_parents_backend).get(60)
        with pytest.raises(RuntimeError, match="forked"):
            pool.apply_async(use_parents_run).get(60)
    RUNS.pop().stop()


LOOP = """
import sys
import gaussian_splats as gs
run = gs.FitRun(sys.argv[1], 60, iterations=1_000_000, backend="cpu", checkpoint=sys.argv[2])
for state in run:
    print(state.step, flush=True)
    if state.step > 100 and len(sys.argv) > 3:
        raise KeyError("my own mistake")
"""


@pytest.mark.parametrize("is_interrupted", [True, False])
def test_a_loop_that_ends_with_an_exception_leaves_a_checkpoint(
    image: np.ndarray, tmp_path: Path, is_interrupted: bool
) -> None:
    gs.write_png(tmp_path / "image.png", image)
    checkpoint = tmp_path / "checkpoint.safetensors"
    command = [sys.executable, "-c", LOOP, str(tmp_path / "image.png"), str(checkpoint)]
    command += [] if is_interrupted else ["fail"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        if is_interrupted:
            process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == (-signal.SIGINT if is_interrupted else 1)
    assert ("KeyboardInterrupt" if is_interrupted else "my own mistake") in errors
    assert checkpoint.is_file()


EXIT = """
import numpy as np
import gaussian_splats as gs

class Policy:
    def plan(self, observation, rng):
        return gs.Plan()

image = np.full((32, 32, 3), 0.5, np.float32)
options = {"policy": Policy(), "settings": {"initial": {"fixed": 20}}, "backend": "cpu"}
runs = [gs.FitRun(image, 60, preset="paper", iterations=10**6, **options) for _ in range(3)]
next(runs[0])
print("the interpreter ends")
"""


def test_the_interpreter_ends_while_policies_are_called() -> None:
    command = [sys.executable, "-X", "dev", "-c", EXIT]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, ended.stdout) == (0, "the interpreter ends\n"), ended.stderr
    assert ended.stderr == ""


def test_a_panic_is_an_exception(capfd: pytest.CaptureFixture[str]) -> None:
    from gaussian_splats import _native

    panic = getattr(_native, "_panic", None)
    if panic is None:
        pytest.skip("only builds for tests can be made to panic")
    with pytest.raises(RuntimeError, match=r"the engine failed \(on request\)"):
        panic()
    assert "on request" in capfd.readouterr().err
