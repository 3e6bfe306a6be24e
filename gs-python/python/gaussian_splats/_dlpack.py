"""Arrays for other libraries, without a copy."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt


class Shared:
    """An array that PyTorch, JAX and other libraries take over DLPack without a copy."""

    def __init__(self, array: npt.NDArray[Any]) -> None:
        self._array = array
        # A view of the same memory that is not marked read-only, which libraries without DLPack 1.0
        # refuse. It holds this object, which holds the array and through it the scene.
        interface = dict(array.__array_interface__)
        interface["data"] = (interface["data"][0], False)
        self.__array_interface__ = interface

    def __dlpack__(self, **options: Any) -> Any:
        import numpy as np

        return np.asarray(self).__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        device: tuple[int, int] = self._array.__dlpack_device__()
        return device


def shared(array: npt.NDArray[Any]) -> Shared:
    """An array of a scene or an observation for ``from_dlpack`` of another library, without a copy.

    >>> means = torch.from_dlpack(gs.shared(scene.means))
    >>> means = jax.numpy.from_dlpack(gs.shared(scene.means))

    The memory stays the scene's and lives as long as the result. Do not write to it: scenes never
    change. Copy it where it is to be trained: ``torch.tensor(scene.means)``.

    :raises TypeError: for anything but an array.
    """
    if not hasattr(array, "__array_interface__"):
        raise TypeError(f"array: expected a NumPy array, not {type(array).__name__}")
    return Shared(array)
