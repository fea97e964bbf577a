"""Repeated visits without a mission: closed forms, bounds, and impossible arguments."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import skysink


def ages(plan: skysink.VisitPlan, places: int, slots: int) -> int:
    """The sum of the ages after all slots."""
    total = 0
    for place in range(places):
        last = 0
        visits = set(plan.slots[plan.visited == place].tolist())
        for slot in range(1, slots + 1):
            last = slot if slot in visits else last
            total += slot - last
    return total


def test_places_in_range_are_visited_in_turns() -> None:
    places = np.random.default_rng(1).uniform(0.0, 4.0, (6, 2))
    plan = skysink.plan_visits(places, 10.0, np.inf, reach_m=5.0, slots=30, objective="age", blocks=2, steps=20_000)
    # Three slots for a round: ages 1 and 2, and 1, 2, ... before the first visits.
    first = [(place // 2) + 1 for place in range(6)]
    least = sum(sum(slot if slot < one else (slot - one) % 3 for slot in range(1, 31)) for one in first)
    assert plan.cost == least == ages(plan, 6, 30)
    assert 0.0 < plan.bound <= plan.cost


def test_visits_are_possible_and_cost_what_they_say() -> None:
    random = np.random.default_rng(2)
    places, fills = random.uniform(0.0, 300.0, (12, 2)), random.uniform(20.0, 60.0, 12)
    weights = random.uniform(0.5, 3.0, 12)
    plan = skysink.plan_visits(places, 10.0, fills, weights, reach_m=30.0, slots=100, blocks=3, steps=50_000)
    assert (np.diff(plan.slots.astype(np.int64)) >= 0).all()
    away = np.linalg.norm(plan.positions_m - places[plan.visited], axis=1)
    assert away.max() <= 10.0 * (1.0 + 1e-9)
    start = (places.min(0) + places.max(0)) / 2.0
    at: dict[int, NDArray[np.float64]] = {}
    for slot, position in zip(plan.slots.tolist(), plan.positions_m, strict=True):
        assert np.array_equal(at.setdefault(slot, position), position)
    stops = [(0, start), *sorted(at.items(), key=lambda stop: stop[0])]
    for (begin, begun), (end, ended) in itertools.pairwise(stops):
        assert np.linalg.norm(ended - begun) <= 30.0 * (end - begin) * (1.0 + 1e-9)
    cost = 0.0
    for place in range(12):
        gaps = np.diff([0, *plan.slots[plan.visited == place].tolist(), 100])
        cost += weights[place] * np.maximum(gaps - np.round(fills[place], 3), 0.0).sum()
    assert plan.cost == pytest.approx(cost, rel=1e-6)
    assert plan.bound <= plan.cost
    again = skysink.plan_visits(places, 10.0, fills, weights, reach_m=30.0, slots=100, blocks=3, steps=50_000)
    assert np.array_equal(again.slots, plan.slots) and again.cost == plan.cost


def test_equal_weights_multiply_the_cost() -> None:
    places = [[0.0, 0.0], [90.0, 0.0], [0.0, 90.0]]
    one, two = (skysink.plan_visits(places, 5.0, 4.0, w, reach_m=30.0, slots=30, steps=500).cost for w in (1.0, 2.0))
    assert two == 2.0 * one > 0.0


def test_a_sum_counts_slots_of_loss_and_ages() -> None:
    places = [[0.0, 0.0], [500.0, 0.0]]
    arguments: dict[str, Any] = {"reach_m": 10.0, "slots": 20, "start_m": (0.0, 0.0), "steps": 2_000}
    plan = skysink.plan_visits(places, 5.0, 10.0, objective={"loss": 2.0, "age": 1.0}, **arguments)
    # The far one is never reached: full after 10 slots, so that 10 are lost, and ages 1 to 20. The near one is visited.
    assert plan.cost == pytest.approx(2.0 * 10.0 + 210.0)


@pytest.mark.parametrize("objective", [{"loss": 2.0}, {"loss": 2.0, "age": 0.0}])
def test_a_sum_of_losses_alone_is_a_multiple_of_the_loss(objective: dict[str, float]) -> None:
    places = [[0.0, 0.0], [500.0, 0.0]]
    arguments: dict[str, Any] = {"reach_m": 10.0, "slots": 20, "start_m": (0.0, 0.0), "steps": 500, "waited_slots": 3.0}
    loss = skysink.plan_visits(places, 5.0, 10.0, **arguments)
    plan = skysink.plan_visits(places, 5.0, 10.0, objective=objective, **arguments)
    assert (plan.cost, plan.bound) == (2.0 * loss.cost, 2.0 * loss.bound)
    assert loss.cost == pytest.approx(13.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions_m": [1.0, 2.0]}, "positions_m of shape"),
        ({"fill_slots": [1.0, 2.0]}, "fill_slots of shape"),
        ({"fill_slots": 0.0}, "fill_slots of shape"),
        ({"weights": [-1.0, 1.0, 1.0]}, "weights of shape"),
        ({"waited_slots": np.inf, "fill_slots": np.inf}, "waited_slots: expected finite"),
        ({"waited_slots": 3.0, "objective": "age"}, "waited_slots: expected 0"),
        ({"steps": -1}, "steps = -1: expected a whole number from 0"),
        ({"blocks": 65}, "blocks = 65"),
        ({"reach_m": "far"}, "reach_m = far: expected a number"),
        ({"weights": 1e13}, "weights: expected numbers"),
        ({"objective": "collect"}, "expected costs of the time"),
        ({"objective": "deadline"}, "deadline_slots = None"),
        ({"objective": "fast"}, "planner.objective"),
        ({"objective": {"loss": 1.0, "fast": 0.0}}, "planner.objective"),
        ({"objective": {"loss": np.inf}}, "planner.objective"),
        ({"radius_m": -1.0}, "radius_m = -1.0"),
        ({"slots": 0}, "slots"),
        ({"start_m": (np.nan, 0.0)}, "start_m"),
    ],
)
def test_impossible_arguments_are_refused(changes: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {
        "positions_m": [[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]],
        "radius_m": 2.0,
        "fill_slots": 10.0,
        "reach_m": 5.0,
        "slots": 20,
        "steps": 100,
    }
    with pytest.raises(skysink.InputError, match=message):
        skysink.plan_visits(**{**arguments, **changes})
