"""Gaussian splatting with NumPy arrays.

Fit an image, train a 3D scene, render, differentiate, and write density-control policies::

    import gaussian_splats as gs

    fit = gs.fit("photo.jpg", gaussians=9000)
    print(fit.psnr, fit.scene.means.shape)

Everything computes without holding the interpreter's lock. Results are the same, bit for bit, for
every number of threads.
"""

from __future__ import annotations

import atexit as _atexit

from . import _native
from ._dlpack import shared
from ._native import (
    Backend,
    Camera,
    Encoded,
    Fit,
    FitRun,
    ForwardPass,
    Observation,
    Plan,
    Progress,
    Scene2d,
    Scene3d,
    Training,
    TrainRun,
    compare,
    decode,
    decode_image,
    encode,
    evaluate,
    forward,
    load,
    poses,
    read_image,
    render,
    write_png,
)
from ._runs import fit, train
from ._study import Arm, Study
from ._types import Policy

__all__ = [
    "Arm",
    "Backend",
    "Camera",
    "Encoded",
    "Fit",
    "FitRun",
    "ForwardPass",
    "Observation",
    "Plan",
    "Policy",
    "Progress",
    "Scene2d",
    "Scene3d",
    "Study",
    "TrainRun",
    "Training",
    "compare",
    "decode",
    "decode_image",
    "encode",
    "evaluate",
    "fit",
    "forward",
    "load",
    "poses",
    "read_image",
    "render",
    "shared",
    "train",
    "write_png",
]

# Runs call policies from threads of their own, which must not outlive the interpreter.
_atexit.register(_native.stop_runs)
