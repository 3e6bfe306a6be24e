"""Studies with policies in Python beside the engine's own."""

from __future__ import annotations

import inspect
import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Callable

from . import _native
from ._types import Path, Policy


@dataclass(frozen=True)
class Arm:
    """An arm of a study.

    :param name: a short name, for tables.
    :param policy: a name, as for ``gs fit --policy``, or an object with a method ``plan``.
    :param about: one sentence, for the report.
    """

    name: str
    policy: str | Policy
    about: str = ""

    @property
    def fingerprint(self) -> str:
        """What tells one policy in Python from another: its source and its attributes.

        It is part of each run's address, so that results of another version of the policy are
        never taken for those of this one. Functions that the policy calls are not part of it.
        """
        if isinstance(self.policy, str):
            return self.policy
        cls = type(self.policy)
        try:
            source = textwrap.dedent(inspect.getsource(cls))
        except (OSError, TypeError) as error:
            message = (
                f"policy of arm {self.name!r}: the source of {cls.__qualname__} is not known, so "
                "that results of two versions could not be told apart; define the class in a file"
            )
            raise ValueError(message) from error
        attributes = sorted(vars(self.policy).items())
        for name, value in attributes:
            if " at 0x" in repr(value):
                message = (
                    f"policy of arm {self.name!r}: its attribute {name} is a function or another "
                    "object without a value that can be written down, so that results of two "
                    "versions could not be told apart; use numbers, strings, or dataclasses of them"
                )
                raise ValueError(message)
        return f"{cls.__qualname__}\n{source}\n{attributes!r}"


class Study:
    """A study: arms x images or scenes x budgets x seeds, with intervals and exact replay.

    :param definition: a study's file, its text, or the name of one of the built-in studies.
    :param arms: arms beside those of the definition.
    :param data: the folder with the images or data sets.
    """

    def __init__(
        self, definition: Path, arms: Sequence[Arm] = (), *, data: Path | None = None
    ) -> None:
        text, beside = os.fspath(definition), None
        if "\n" not in text and text.endswith(".toml"):
            beside = os.path.dirname(os.path.abspath(text))
            with open(text, encoding="utf-8") as file:
                text = file.read()
        own = [(arm.name, arm.fingerprint, arm.policy, arm.about) for arm in arms]
        self._study = _native.Study(text, own, data, beside)

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self._study.runs

    def run(
        self,
        output: Path,
        *,
        jobs: int = 1,
        resume: bool = False,
        progress: Callable[[int, int], object] | None = None,
    ) -> list[str]:
        """Do all runs, write tables and report into a folder, and return the headlines.

        :param jobs: runs side by side; the threads of the machine are shared among them.
        :param resume: whether the folder may have runs of this study already.
        :param progress: called with the number of runs done by this call, and of all.
        """
        return self._study.run(output, jobs=jobs, resume=resume, progress=progress)

    def work(
        self,
        output: Path,
        *,
        jobs: int = 1,
        shard: tuple[int, int] | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> None:
        """Claim runs of a folder that several processes share, until none is left.

        Every process makes the same study and calls this with the same folder, as ``gs study work``
        does.

        :param shard: (index, count): the part to begin with. By default that of the Slurm array
            task, if there is one.
        """
        if shard is None and "SLURM_ARRAY_TASK_ID" in os.environ:
            first = int(os.environ.get("SLURM_ARRAY_TASK_MIN", "0"))
            index = int(os.environ["SLURM_ARRAY_TASK_ID"]) - first
            shard = (index, int(os.environ["SLURM_ARRAY_TASK_COUNT"]))
        self._study.work(output, jobs=jobs, shard=shard, progress=progress)

    def report(self, output: Path) -> list[str]:
        """Write tables and report of the runs that have ended so far; return the headlines."""
        return self._study.report(output)
