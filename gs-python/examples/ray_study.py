"""A study whose runs are spread over a cluster by Ray: python ray_study.py FOLDER."""

import sys

import gaussian_splats as gs
import numpy as np
import ray

STUDY = """
name = "largest"
question = "Is it enough to let the largest Gaussians grow?"
images = ["paper-64px"]
budgets = [60, 120]
seeds = [0, 1, 2]
preset = "paper"
iterations = 300

[[arm]]
name = "3dgs"
about = "The threshold of 3DGS."
policy = "absolute"
"""


class Largest:
    """The largest tenth of the Gaussians grows."""

    def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
        """The edits of a round."""
        size = observation.log_scales.sum(axis=1)
        return gs.Plan(grow=np.argsort(-size, kind="stable")[: max(1, len(size) // 10)])


def study() -> gs.Study:
    """The study, which every process makes for itself."""
    return gs.Study(STUDY, [gs.Arm("largest", Largest(), "The largest tenth grows.")])


@ray.remote(num_cpus=1)
def work(folder: str) -> None:
    """Do runs until none is left."""
    study().work(folder)


if __name__ == "__main__":
    folder = sys.argv[1]
    ray.init()
    ray.get([work.remote(folder) for _ in range(int(ray.cluster_resources()["CPU"]))])
    print(*study().report(folder), sep="\n")
