"""What Python costs: fits against the program, calls against Rust, policies, import.

Run it with the Python of an environment that has the wheel of `cargo xtask python`, beside a
release build of the program:

    cargo build --release
    python gs-python/benches/overhead.py [IMAGE]
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Callable

import gaussian_splats as gs
import numpy as np

ROOT = Path(__file__).parents[2]
TURNS = 7


def picture() -> np.ndarray:
    """An image of 768x512 px, drawn with 3,000 Gaussians."""
    rng = np.random.default_rng(0)
    n = 3000
    scene = gs.Scene2d(
        (rng.uniform(0, 1, (n, 2)) * [768, 512]).astype(np.float32),
        rng.uniform(0.5, 3.0, (n, 2)).astype(np.float32),
        rng.uniform(0, 3, n).astype(np.float32),
        rng.uniform(0, 0.2, (n, 3)).astype(np.float32),
    )
    return np.clip(gs.render(scene, size=(768, 512), backend="cpu"), 0, 1)


def fits(image: Path, folder: Path) -> None:
    """The same fit by the program and from Python, in turns."""
    program, own, gaps = [], [], []
    command = [ROOT / "target/release/gs", "fit", image, "-o", folder / "out", "--backend", "cpu"]
    for _ in range(TURNS):
        subprocess.run([*command, "--no-report", "--overwrite"], check=True, capture_output=True)
        program.append(json.loads((folder / "out/summary.json").read_text())["seconds"])
        started = time.perf_counter()
        fit = gs.fit(image, backend="cpu")
        gaps.append(time.perf_counter() - started - fit.summary["seconds"])
        own.append(fit.summary["seconds"])
    theirs = gs.load(folder / "out")
    same = all(
        np.array_equal(array, theirs.arrays[name]) for name, array in fit.scene.arrays.items()
    )
    ratio = median(a / b for a, b in zip(own, program))
    print(f"fit: {len(fit.scene)} Gaussians, same bits: {same}")
    print(f"  training time: gs fit {median(program):.3f} s, Python {median(own):.3f} s")
    print(f"  median of the ratios of {TURNS} turns {ratio:.3f}")
    print(f"  reading, quality and last rendering, from Python: {median(gaps):.3f} s")


def call(folder: Path) -> None:
    """One rendering of 100 Gaussians at 64x64 px, against the same from Rust."""
    rng = np.random.default_rng(1)
    scene = gs.Scene2d(
        rng.uniform(0, 64, (100, 2)).astype(np.float32),
        rng.uniform(0.3, 1.5, (100, 2)).astype(np.float32),
        rng.uniform(0, 3, 100).astype(np.float32),
        rng.uniform(0, 0.4, (100, 3)).astype(np.float32),
    )
    file = folder / "scene.gs2d.safetensors"
    scene.save(file, size=(64, 64))
    scene = gs.load(file)
    bench = ["cargo", "bench", "-q", "-p", "gs-lab", "--bench", "render_call", "--"]
    bench += [str(file), "64", "64"]
    own, rust = [], []
    for _ in range(TURNS):
        done = subprocess.run(bench, check=True, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        rust.append(float(done.stdout))
        times = []
        for number in range(5500):
            started = time.perf_counter()
            gs.render(scene, backend="cpu")
            if number >= 500:
                times.append((time.perf_counter() - started) * 1e6)
        own.append(median(times))
    difference = median(a - b for a, b in zip(own, rust))
    print(
        f"render: Rust {median(rust):.1f} us, Python {median(own):.1f} us, more {difference:.1f} us"
    )


class AbsGs:
    """The rule of the engine's `abs-gs`, whose own time is counted."""

    statistics = "absolute-gradient"
    actions = {"densify": {"split-above": {"extent-fraction": 0.001}}}

    def __init__(self, rule: Callable[[gs.Observation], gs.Plan]) -> None:
        self.rule = rule
        self.seconds: list[float] = []

    def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
        started = time.perf_counter()
        plan = self.rule(observation)
        self.seconds.append(time.perf_counter() - started)
        return plan


def grow(observation: gs.Observation) -> gs.Plan:
    signal = observation.signal
    chosen = np.flatnonzero(signal >= np.float32(4e-6))
    return gs.Plan(grow=chosen[np.argsort(-signal[chosen], kind="stable")])


def policies(image: np.ndarray) -> None:
    """Rounds of density control with 100,000 Gaussians, in Python and in the engine."""
    n, first = 100_000, 10
    settings = {
        "initial": {"fixed": n},
        "init": {"kind": "random", "scale-px": 2.0, "colors": "random", "opacity": 0.7},
        "rounds": {"every": 4, "from": first, "until": 60},
        "policy": {"threshold": 4e-6},
    }

    def rounds(policy: str | AbsGs, over: dict[str, object]) -> tuple[list[float], int]:
        """Time of each round, s: that of a step with one beyond the steps around it."""
        options = {"preset": "paper", "iterations": 60, "settings": {**settings, **over}}
        run = gs.FitRun(image, n + 100, policy=policy, backend="cpu", **options)  # type: ignore[arg-type]
        edits = {state.step: state.edits for state in run}
        spent = np.diff(run.result().history["seconds"], prepend=0.0)
        at = [step for step, counts in edits.items() if counts is not None and first < step < 58]
        grown = sum(sum(edits[step][:2]) for step in at)  # type: ignore[index]
        return [
            spent[s - 1] - median([spent[s - 3], spent[s - 2], spent[s], spent[s + 1]]) for s in at
        ], grown

    rows = []
    for _ in range(TURNS):
        engine, _ = rounds("abs-gs", {})
        policy = AbsGs(grow)
        own, _ = rounds(policy, {})
        idle = AbsGs(lambda observation: gs.Plan())
        empty, _ = rounds(idle, {})
        rows.append(
            [
                median(engine),
                median(own),
                median(policy.seconds),
                median(empty),
                median(idle.seconds),
            ]
        )
    engine_s, own_s, body, empty_s, idle_s = (1e3 * median(column) for column in zip(*rows))
    print(f"policy with {n} Gaussians: a round of the engine's abs-gs takes {engine_s:.1f} ms,")
    print(f"  of the same in Python {own_s:.1f} ms, {body:.1f} ms of it inside plan;")
    print(
        f"  of a policy in Python that does nothing {empty_s:.1f} ms, {idle_s:.2f} ms inside plan"
    )


def imports() -> None:
    """Time of the import in a process of its own."""

    def seconds(code: str) -> float:
        timed = f"import time; t = time.perf_counter(); {code}; print(time.perf_counter() - t)"
        runs = [
            subprocess.run([sys.executable, "-c", timed], stdout=subprocess.PIPE) for _ in range(15)
        ]
        return 1e3 * median(float(run.stdout) for run in runs)

    whole, numpy = seconds("import gaussian_splats"), seconds("import numpy")
    after = seconds("import numpy; t = time.perf_counter(); import gaussian_splats")
    print(f"import: {whole:.0f} ms with NumPy ({numpy:.0f} ms), {after:.0f} ms after NumPy")


def main() -> None:
    folder = Path(tempfile.mkdtemp())
    image = picture()
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else folder / "image.png"
    if len(sys.argv) < 2:
        gs.write_png(file, image)
    imports()
    call(folder)
    policies(image)
    fits(file, folder)
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
