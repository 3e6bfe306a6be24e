"""Studies with policies in Python beside the engine's own."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass
from typing import Callable

import numpy as np

from . import _native
from ._runs import _check
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

        :raises ValueError: where two versions of the policy could not be told apart.
        """
        if isinstance(self.policy, str):
            return self.policy
        try:
            sources = [_source(cls) for cls in type(self.policy).__mro__ if cls is not object]
        except (OSError, TypeError) as error:
            message = (
                f"policy of arm {self.name!r}: the source of {type(self.policy).__qualname__} is "
                "not known, so that results of two versions could not be told apart; define the "
                "class in a file or in a notebook"
            )
            raise ValueError(message) from error
        attributes = {
            name: _written(value)
            for name, value in sorted(getattr(self.policy, "__dict__", {}).items())
        }
        for name, value in attributes.items():
            if " at 0x" in value:
                message = (
                    f"policy of arm {self.name!r}: its attribute {name} is a function or another "
                    "object without a value that can be written down, so that results of two "
                    "versions could not be told apart; use numbers, strings, or dataclasses of them"
                )
                raise ValueError(message)
        return "\n".join([type(self.policy).__qualname__, *sources, repr(attributes)])


def _written(value: object) -> str:
    """A value with all its digits, arrays with all their elements."""
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        return repr(value)


def _source(cls: type) -> str:
    """The sources of the functions of a class, and the values of its other attributes.

    The source of the class as a whole is not known everywhere: not in a notebook before Python
    3.13, and not in a process that got the class from Ray.
    """
    import inspect
    import textwrap

    parts = []
    for name, value in sorted(vars(cls).items()):
        inner = [value, getattr(value, "__func__", None), getattr(value, "fget", None)]
        function = next((each for each in inner if inspect.isfunction(each)), None)
        if function is None:
            if not name.startswith("__"):
                parts.append(f"{name} = {_written(value)}")
            continue
        # What a dataclass adds follows from its fields, which are attributes.
        code = inspect.unwrap(function).__code__
        is_generated = code.co_filename == "<string>" and name.startswith("__")
        if not (is_generated and is_dataclass(cls)):
            parts.append(textwrap.dedent(inspect.getsource(function)))
    return "\n".join(parts)


class Study:
    """A study: arms x images or scenes x budgets x seeds, with intervals.

    :param definition: a study's file, its text, or the name of one of the built-in studies.
    :param arms: arms beside those of the definition.
    :param data: the folder with the images or data sets; by default that of the study's file, or
        the one that the variable ``GS_DATA`` names.
    :param backend: the name of what computes, "cpu", "wgpu" or "auto", the same for all processes.
    :raises ValueError: for a definition that is not possible, and for policies in Python whose
        versions could not be told apart.
    """

    def __init__(
        self,
        definition: Path,
        arms: Sequence[Arm] = (),
        *,
        data: Path | None = None,
        backend: str = "cpu",
    ) -> None:
        for arm in arms:
            if not isinstance(arm, Arm):
                raise TypeError(f"arms: expected objects of Arm, not {type(arm).__name__}")
        text, beside = os.fspath(definition), None
        if "\n" not in text and text.endswith(".toml"):
            beside = os.path.dirname(os.path.abspath(text))
            with open(text, encoding="utf-8") as file:
                text = file.read()
        own = [(arm.name, arm.fingerprint, arm.policy, arm.about) for arm in arms]
        data = os.environ.get("GS_DATA") if data is None else data
        self._study = _native.Study(text, own, data, beside, backend)

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
        :raises RuntimeError: if all runs fail; what a policy has raised, where one has.
        :raises OSError: for images or data sets that are not there.
        """
        _check(progress)
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
        _check(progress)
        self._study.work(output, jobs=jobs, shard=shard, progress=progress)

    def report(self, output: Path) -> list[str]:
        """Write tables and report of the runs that have ended so far; return the headlines.

        :raises ValueError: for a folder without a study.
        :raises RuntimeError: if all runs have failed.
        """
        return self._study.report(output)
