"""Studies with arms whose policies are written in Python."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gaussian_splats as gs
import numpy as np
import pytest

STUDY = """
name = "python"
question = "Does a policy in Python grow?"
images = ["paper"]
budgets = [60]
seeds = [0, 1]
preset = "paper"
iterations = 120

[[arm]]
name = "absolute"
about = "The threshold of 3DGS."
policy = "absolute"
"""


class Largest:
    """The largest tenth grows."""

    def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
        size = observation.log_scales.sum(axis=1)
        return gs.Plan(grow=np.argsort(-size, kind="stable")[: max(1, len(size) // 10)])


def test_a_study(tmp_path: Path) -> None:
    study = gs.Study(STUDY, [gs.Arm("largest", Largest(), "The largest tenth grows.")])
    assert study.runs == 4
    done: list[tuple[int, int]] = []
    headlines = study.run(tmp_path / "a", progress=lambda *state: done.append(state))
    assert headlines and (tmp_path / "a" / "report.html").is_file()
    again = gs.Study(STUDY, [gs.Arm("largest", Largest(), "The largest tenth grows.")])
    again.work(tmp_path / "b", jobs=2, shard=(1, 2))
    reported = again.report(tmp_path / "b")
    # What depends on the clock may differ.
    assert [line for line in reported if "equal time" not in line] == [
        line for line in headlines if "equal time" not in line
    ]
    for table in ["runs.csv", "quality.csv", "differences.csv"]:
        first, second = (tmp_path / folder / table for folder in "ab")
        assert first.read_bytes() == second.read_bytes(), table
    with pytest.raises((ValueError, OSError)):
        study.run(tmp_path / "a")
    assert study.run(tmp_path / "a", resume=True) == headlines


def test_a_study_whose_policy_is_elsewhere(tmp_path: Path) -> None:
    study = gs.Study(STUDY, [gs.Arm("largest", Largest())])
    study.run(tmp_path / "study")
    alone = gs.Study(tmp_path / "study" / "study.toml")
    with pytest.raises(ValueError, match="largest.*: its policy is code"):
        alone.work(tmp_path / "other")
    # The tables need no policy.
    assert alone.report(tmp_path / "study") == study.report(tmp_path / "study")


def test_fingerprints_follow_source_and_attributes() -> None:
    assert "np.argsort" in gs.Arm("a", Largest()).fingerprint
    first, second = Largest(), Largest()
    first.choose = lambda: 3  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="its attribute choose is a function"):
        _ = gs.Arm("a", first).fingerprint
    first = Largest()
    second.share = 3  # type: ignore[attr-defined]
    assert gs.Arm("a", first).fingerprint != gs.Arm("a", second).fingerprint


SOURCE = """
import gaussian_splats as gs

class {name}:
    threshold = {threshold}

    def plan(self, observation, rng):
        return gs.Plan()
"""


def test_fingerprints_of_classes_in_notebooks() -> None:
    """As in a notebook, where the source of a class is not known but that of its functions."""
    import linecache

    def fingerprint(threshold: float) -> str:
        source = SOURCE.format(name="Mine", threshold=threshold)
        file = f"<cell {threshold}>"
        linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
        space: dict[str, Any] = {"__name__": "__main__"}
        exec(compile(source, file, "exec"), space)
        return gs.Arm("mine", space["Mine"]()).fingerprint

    assert "return gs.Plan()" in fingerprint(0.5)
    assert fingerprint(0.5) != fingerprint(0.25)
    assert fingerprint(0.5) == fingerprint(0.5)


@dataclass
class Configured:
    """A policy with settings of its own."""

    share: float = 0.1

    @property
    def half(self) -> float:
        return self.share / 2

    def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
        return gs.Plan()


def test_fingerprints_of_dataclasses() -> None:
    first, second = (gs.Arm("a", Configured(share)).fingerprint for share in [0.1, 0.2])
    assert first != second
    assert "return self.share / 2" in first


def test_fingerprints_follow_base_classes_and_all_elements_of_arrays() -> None:
    class Smallest(Largest):
        pass

    assert "np.argsort" in gs.Arm("a", Smallest()).fingerprint
    first, second = Largest(), Largest()
    first.weights = np.zeros(5000)  # type: ignore[attr-defined]
    second.weights = np.zeros(5000)  # type: ignore[attr-defined]
    assert gs.Arm("a", first).fingerprint == gs.Arm("a", second).fingerprint
    second.weights[2500] = 1e-12  # type: ignore[attr-defined]
    assert gs.Arm("a", first).fingerprint != gs.Arm("a", second).fingerprint


def test_a_policy_that_raises_in_every_run(tmp_path: Path) -> None:
    class Failing:
        def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
            raise LookupError("my own mistake")

    definition = STUDY.split("[[arm]]")[0]
    study = gs.Study(definition, [gs.Arm("failing", Failing())])
    with pytest.raises(LookupError, match="my own mistake"):
        study.run(tmp_path / "study")


WORKER = """
import sys
sys.path.insert(0, {tests!r})
from test_studies import STUDY, Largest
import gaussian_splats as gs
gs.Study(STUDY, [gs.Arm("largest", Largest(), "The largest tenth grows.")]).work(sys.argv[1])
"""


def test_processes_share_a_study(tmp_path: Path) -> None:
    arms = [gs.Arm("largest", Largest(), "The largest tenth grows.")]
    gs.Study(STUDY, arms).run(tmp_path / "one")
    script = WORKER.format(tests=str(Path(__file__).parent))
    command = [sys.executable, "-c", script, str(tmp_path / "many")]
    workers = [subprocess.Popen(command) for _ in range(3)]
    assert [worker.wait(120) for worker in workers] == [0, 0, 0]
    gs.Study(STUDY, arms).report(tmp_path / "many")
    for table in ["runs.csv", "quality.csv", "differences.csv"]:
        one, many = (tmp_path / folder / table for folder in ["one", "many"])
        assert one.read_bytes() == many.read_bytes(), table
