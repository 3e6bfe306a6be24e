"""Types of arguments."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol, Union

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from ._native import Backend, Observation, Plan

Floats = npt.NDArray[np.float32]
Path = Union[str, "os.PathLike[str]"]
#: A file, or an array of shape (H, W, 3): float32 with 0 to 1, or uint8.
ImageSource = Union[Path, npt.NDArray[np.float32], npt.NDArray[np.uint8]]
#: Settings with the names of the settings files of ``gs``, such as ``{"adam": {"beta1": 0.8}}``.
Settings = Mapping[str, Any]
#: A backend, its name ("auto", "cpu" or "wgpu"), or None for "auto".
BackendChoice = Union["Backend", str, None]


class Policy(Protocol):
    """A density-control policy: any object with this method.

    Optional attributes:

    - ``statistics``: what training collects for ``observation.signal``: ``"mean-gradient"`` (the
      default), ``"absolute-gradient"``, ``"pixel-gradient"``, ``"pixel-error"`` or ``"none"``.
    - ``actions``: changes to how Gaussians are pruned, cloned and split, as in the table
      ``policy.actions`` of settings files. Without it, transparent Gaussians are pruned as in 3DGS.
    - ``needs_residual``: whether ``observation.target`` and ``observation.rendered`` are wanted.
      Only fits of images have them.
    """

    def plan(self, observation: Observation, rng: np.random.Generator, /) -> Plan:
        """The edits of one round of density control.

        ``rng`` gives the same numbers whenever a run is repeated or resumed.
        """
        ...
