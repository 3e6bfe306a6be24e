"""Policies in Python."""

from __future__ import annotations

from collections.abc import Callable

import gaussian_splats as gs
import numpy as np
import pytest


class Policy:
    """A policy of a function."""

    def __init__(self, plan: Callable[[gs.Observation], gs.Plan]) -> None:
        self.function = plan

    def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
        return self.function(observation)


def fitted(image: np.ndarray, cpu: gs.Backend, policy: gs.Policy) -> gs.Fit:
    settings = {"initial": {"fixed": 20}}
    return gs.fit(
        image,
        60,
        preset="paper",
        iterations=300,
        policy=policy,
        settings=settings,
        backend=cpu,
    )


def test_what_a_policy_sees(image: np.ndarray, cpu: gs.Backend) -> None:
    seen: list[gs.Observation] = []

    class Watching:
        needs_residual = True
        statistics = "pixel-error"

        def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
            seen.append(observation)
            return gs.Plan()

    fit = fitted(image, cpu, Watching())
    assert len(fit.scene) == 20
    assert seen
    first, last = seen[0], seen[-1]
    assert first.means.shape == (20, 2) and first.signal.shape == (20,)
    assert first.signal.max() > 0 and first.visible.max() > 0
    assert 0 < first.progress < last.progress == 1
    assert first.budget == 60 and first.extent == 64
    assert first.target is not None and first.rendered is not None
    assert np.array_equal(first.target, image)
    assert first.weights is None

    seen.clear()
    settings = {"tune": "ssim", "loss": "l2"}
    policy = Watching()
    gs.fit(image, 60, preset="paper", iterations=300, policy=policy, settings=settings, backend=cpu)
    weights = seen[0].weights
    assert weights is not None and weights.shape == image.shape[:2]
    assert abs(weights.mean() - 1) < 1e-3 and weights.max() > weights.min()


def test_random_numbers_are_those_of_the_seed_and_the_round(
    image: np.ndarray, cpu: gs.Backend
) -> None:
    class Drawing:
        def __init__(self) -> None:
            self.numbers: list[float] = []

        def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
            self.numbers.append(float(rng.random()))
            return gs.Plan()

    def drawn() -> list[float]:
        policy = Drawing()
        fitted(image, cpu, policy)
        return policy.numbers

    first = drawn()
    assert len(set(first)) == len(first) > 1
    assert drawn() == first


def test_every_edit(image: np.ndarray, cpu: gs.Backend) -> None:
    counts: list[int] = []

    def plan(observation: gs.Observation) -> gs.Plan:
        counts.append(len(observation))
        new = np.array([[5.0, 5.0]], np.float32)
        one = gs.Scene2d(
            new,
            np.ones((1, 2), np.float32),
            np.zeros(1, np.float32),
            np.full((1, 3), 0.3, np.float32),
        )
        if len(counts) > 1:
            return gs.Plan()
        return gs.Plan(
            grow=np.array([0]),
            clone=np.array([1, 2]),
            split=np.array([3]),
            prune=np.array([4]),
            relocate=(np.array([5]), np.array([6])),
            add=one,
        )

    edits: list[tuple[int, int, int, int]] = []
    gs.fit(
        image,
        60,
        preset="paper",
        iterations=300,
        policy=Policy(plan),
        settings={"initial": {"fixed": 20}},
        backend=cpu,
        progress=lambda state: edits.append(state.edits) if state.edits else None,
    )
    # Of the pruned, none was due to the default actions.
    assert counts[1] == 20 + 1 + 2 + 1 - 1 + 1
    cloned, split, seeded, pruned = edits[0]
    assert (cloned + split, seeded, pruned) == (4, 1, 1)
    assert split >= 1 and cloned >= 2


@pytest.mark.parametrize(
    ("plan", "error", "says"),
    [
        (lambda o: 5, TypeError, "expected a Plan, not int"),
        (lambda o: gs.Plan(grow=[1]), TypeError, "grow"),  # type: ignore[arg-type]
        (lambda o: gs.Plan(grow=np.array([0.5])), TypeError, "grow"),
        (lambda o: gs.Plan(grow=np.array([-1])), ValueError, "grow: -1 is not an index"),
        (lambda o: gs.Plan(prune=np.array([20])), ValueError, "20 is not an index of one of 20"),
        (lambda o: gs.Plan(grow=np.array([3]), prune=np.array([3])), ValueError, "in grow"),
        (lambda o: gs.Plan(clone=np.array([3, 3])), ValueError, "twice"),
        (
            lambda o: gs.Plan(relocate=(np.array([1, 2]), np.array([3]))),
            ValueError,
            "relocate: expected two arrays of one length",
        ),
        (
            lambda o: gs.Plan(relocate=(np.array([1, 2]), np.array([2, 3]))),
            ValueError,
            r"relocate\[1\]: Gaussian 2 is named here and in relocate\[0\]",
        ),
        (
            lambda o: gs.Plan(relocate=(np.array([1]), np.array([2])), prune=np.array([2])),
            ValueError,
            r"relocate\[1\]: Gaussian 2 is named here and in prune",
        ),
        (lambda o: gs.Plan(add=3), TypeError, "add: expected Scene2d, not int"),  # type: ignore[arg-type]
        (lambda o: 1 / 0, ZeroDivisionError, "division"),
    ],
)
def test_plans_that_are_not_possible(
    image: np.ndarray,
    cpu: gs.Backend,
    plan: Callable[[gs.Observation], gs.Plan],
    error: type[Exception],
    says: str,
) -> None:
    with pytest.raises(error, match=says):
        fitted(image, cpu, Policy(plan))


def test_observations_outlive_their_round(image: np.ndarray, cpu: gs.Backend) -> None:
    kept: list[gs.Observation] = []

    def plan(observation: gs.Observation) -> gs.Plan:
        kept.append(observation)
        with pytest.raises(ValueError, match="read-only"):
            observation.means[0, 0] = 3.0
        return gs.Plan(grow=np.arange(5))

    fit = fitted(image, cpu, Policy(plan))
    assert len(kept[0]) == 20 and len(kept[-1]) > 20
    assert np.isfinite(kept[0].means).all()
    assert not np.array_equal(kept[-1].means[:5], fit.scene.means[:5])


def test_a_policy_that_uses_the_engine(image: np.ndarray, cpu: gs.Backend) -> None:
    class Nested:
        def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
            gs.fit(image, 10, iterations=3, backend=cpu)
            return gs.Plan()

    assert len(fitted(image, cpu, Nested()).scene) == 20


def test_a_policy_with_another_signature(image: np.ndarray, cpu: gs.Backend) -> None:
    class Old:
        def plan(self, observation: gs.Observation) -> gs.Plan:
            return gs.Plan()

    with pytest.raises(TypeError, match="positional argument"):
        fitted(image, cpu, Old())  # type: ignore[arg-type]


def test_more_than_the_budget(image: np.ndarray, cpu: gs.Backend) -> None:
    def plan(observation: gs.Observation) -> gs.Plan:
        return gs.Plan(clone=np.arange(len(observation)))

    with pytest.raises(ValueError, match="budget of 60"):
        fitted(image, cpu, Policy(plan))


def test_a_wrong_attribute(image: np.ndarray, cpu: gs.Backend) -> None:
    class Wrong:
        statistics = "gradient"

        def plan(self, observation: gs.Observation, rng: np.random.Generator) -> gs.Plan:
            return gs.Plan()

    with pytest.raises(ValueError, match="statistics"):
        fitted(image, cpu, Wrong())
    Wrong.statistics = 3  # type: ignore[assignment]
    with pytest.raises(TypeError, match=r"policy\.statistics: expected a name .*, not 3"):
        fitted(image, cpu, Wrong())
