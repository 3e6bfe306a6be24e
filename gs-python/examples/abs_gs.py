"""The density policy of AbsGS in a few lines, compared with the engine's own.

Run: python examples/abs_gs.py
"""

from __future__ import annotations

import gaussian_splats as gs
import numpy as np


class AbsGs:
    """Gaussians whose mean absolute gradient is at least 0.0004 grow (Ye et al. 2024).

    In a large Gaussian that is pulled to two sides, the gradients of the pixels cancel. Their
    absolute values do not, so it is found and split.
    """

    # What training collects in each step, for `observation.signal`.
    statistics = "absolute-gradient"
    # AbsGS splits nearly all that grow: those larger than a thousandth of the image.
    actions = {"densify": {"split-above": {"extent-fraction": 0.001}}}

    def __init__(self, threshold: float = 0.0004) -> None:
        self.threshold = threshold

    def plan(self, observation: gs.Observation) -> gs.Plan:
        """The Gaussians above the threshold, the most urgent first."""
        signal = observation.signal
        chosen = np.flatnonzero(signal >= np.float32(self.threshold))
        return gs.Plan(grow=chosen[np.argsort(-signal[chosen], kind="stable")])


def disc(side: int = 96) -> gs.Scene2d:
    """A target that is drawn instead of read: one large Gaussian and many small ones."""
    rng = np.random.default_rng(0)
    n = 40
    means = rng.uniform(0, side, (n, 2)).astype(np.float32)
    log_scales = np.log(rng.uniform(1, side / 8, (n, 2))).astype(np.float32)
    rotations = rng.uniform(0, np.pi, n).astype(np.float32)
    colors = rng.uniform(0, 0.4, (n, 3)).astype(np.float32)
    return gs.Scene2d(means, log_scales, rotations, colors)


def main() -> None:
    """Fit one image under both policies."""
    side = 96
    image = np.clip(gs.render(disc(side), size=(side, side)), 0, 1)
    backend = gs.Backend("cpu")

    def fitted(policy: str | AbsGs) -> gs.Fit:
        # The first Gaussians, so that both have the same.
        start = {"initial": {"fixed": 40}}
        return gs.fit(
            image,
            300,
            preset="paper",
            iterations=600,
            policy=policy,
            settings=start,
            backend=backend,
        )

    own, engines = fitted(AbsGs()), fitted("abs-gs")
    for name, fit in [("in Python", own), ("the engine's", engines)]:
        print(f"{name}: {fit.psnr:.3f} dB with {len(fit.scene)} Gaussians")
    for array in ["means", "log_scales", "rotations", "colors"]:
        assert np.array_equal(getattr(own.scene, array), getattr(engines.scene, array)), array
    assert len(own.scene) > 40, "the policy did nothing"
    print("The scenes are equal, bit for bit.")


if __name__ == "__main__":
    main()
