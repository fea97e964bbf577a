"""What a strategy knows of the sensor nodes is what the UAV knows, in every key of its view and its field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skysink
from skysink.environment import DataCollectionEnv

VIEW = {
    "slot", "uav", "queues_bits", "sampling_bps", "belief", "field", "energy_j", "is_charging", "energy_left_home_j",
    "slots_left_home", "neighbours", "values", "reachable", "servable", "answers", "links",
}  # fmt: skip

VIEW_METHODS = {"answer", "route_to"}

BELIEF = {"queue_bits", "queue_sd_bits", "rate_bps", "rate_sd_bps", "age_slots"}

FIELD_VALUES = {
    "positions_m", "gains", "sampling_bps", "capacity_bits", "capacities_bits", "weights", "area_m",
    "reach_m", "comm_radius_m", "resource_blocks",
    "altitudes_m", "climb_m", "slots", "slot_s", "comm_s", "servable", "base", "move_slots",
}  # fmt: skip

FIELD_METHODS = {"within", "fullest", "toward", "route"}

SCENARIO = """
name = "known"
slots = 12
[sensors]
file = "LIST"
sampling_bps = [50.0, 150.0]
initial_queue_mean_bits = [0.0, 1000.0]
"""

LISTS = {
    "one": "x_m,y_m,queue_bits,gain_db,sampling_bps\n50,50,700,-52,60\n52,50,100,-52,140\n90,90,5,-52,75\n",
    "other": "x_m,y_m,queue_bits,gain_db,sampling_bps\n50,50,20,-52,130\n52,50,900,-52,55\n90,90,300,-52,115\n",
}
"""The same places and links, with other queues and rates."""

TRUE_BPS = [60.0, 140.0, 75.0]

KNOWLEDGE = {
    "oracle": {},
    "estimated": {"planner.knowledge": "estimated"},
    "learnt": {"planner.knowledge": "estimated", "planner.rates": "learnt"},
}


@pytest.fixture
def scenarios(tmp_path: Path) -> dict[str, skysink.Scenario]:
    """Missions that differ in queues and rates alone."""
    for name, text in LISTS.items():
        (tmp_path / f"{name}.csv").write_text(text)
    texts = {name: SCENARIO.replace("LIST", f"{name}.csv") for name in LISTS}
    return {name: skysink.Scenario.parse(text, tmp_path / "known.toml") for name, text in texts.items()}


def keys(kind: type) -> set[str]:
    """The public names of a class."""
    return {name for name in dir(kind) if not name.startswith("_")}


def content(view: skysink.View) -> dict[str, Any]:
    """All that can be got from a view, as plain values."""
    field, queues_bits = view.field, view.queues_bits
    called = {
        "within": field.within(view.uav, 30.0),
        "fullest": field.fullest(view.uav, queues_bits),
        "toward": field.toward(view.uav, (1.0, 2.0)),
        "route": repr(field.route(view.uav, 1)),
    }
    assert called.keys() == FIELD_METHODS
    found = {name: getattr(view, name) for name in VIEW - {"belief", "field"}}
    found["route_to"] = repr(view.route_to(0))
    found |= {f"belief.{name}": getattr(view.belief, name) for name in BELIEF}
    found |= {f"field.{name}": getattr(field, name) for name in FIELD_VALUES} | called
    found |= {"len": len(field), "repr": repr(field), "pickle": field.__reduce__()[1:]}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in found.items()}


class Noting(skysink.Strategy):
    """Stays at the middle, serves SN 0 in every second slot, and notes all that it gets."""

    def __init__(self) -> None:
        self.seen: list[dict[str, Any]] = []

    def begin(self, field: skysink.Field) -> None:
        self.begun = field.sampling_bps.tolist()

    def plan(self, view: skysink.View) -> skysink.Decision:
        self.seen.append(content(view))
        return skysink.Decision(view.uav[:2], serve=[0] if view.slot % 2 else [])


def noted(scenario: skysink.Scenario, knowledge: str) -> Noting:
    """What a strategy got in a mission."""
    strategy = Noting()
    skysink.simulate(scenario.replace(KNOWLEDGE[knowledge]), strategy)
    return strategy


def test_views_beliefs_and_fields_have_the_listed_keys() -> None:
    assert keys(skysink.View) == VIEW | VIEW_METHODS, "a new key of View: is it what the UAV knows?"
    assert keys(skysink.Belief) == BELIEF, "a new key of Belief: is it what the UAV knows?"
    assert keys(skysink.Field) == FIELD_VALUES | FIELD_METHODS, "a new key of Field: is it what the UAV knows?"


@pytest.mark.parametrize(
    ("knowledge", "told"),
    [
        ("oracle", {"queues_bits", "values", "belief.queue_bits", "sampling_bps", "belief.rate_bps", "field.sampling_bps", "pickle"}),
        ("estimated", {"sampling_bps", "belief.rate_bps", "field.sampling_bps", "pickle"}),
        ("learnt", set()),
    ],
)
def test_beliefs_before_a_contact_depend_only_on_known_values(
    scenarios: dict[str, skysink.Scenario], knowledge: str, told: set[str]
) -> None:
    one, other = (noted(scenario, knowledge).seen[0] for scenario in scenarios.values())
    assert {name for name in one if one[name] != other[name]} == told


def test_learnt_rates_equal_the_prior_mean_before_contacts(scenarios: dict[str, skysink.Scenario]) -> None:
    learning = noted(scenarios["one"], "learnt")
    # Slots 1 and 3 empty SN 0: what it has sampled in slot 2 is known from slot 4 on.
    expected = [[100.0] * 3] * 3 + [[60.0, 100.0, 100.0]] * 9
    assert [seen["sampling_bps"] for seen in learning.seen] == expected
    assert all(seen["field.sampling_bps"] == learning.begun == [100.0] * 3 for seen in learning.seen)
    for knowledge in ("oracle", "estimated"):
        knowing = noted(scenarios["one"], knowledge)
        assert all(seen["sampling_bps"] == knowing.begun == TRUE_BPS for seen in knowing.seen)


def test_rates_are_read_only_and_do_not_change_later(scenarios: dict[str, skysink.Scenario]) -> None:
    kept = []

    class Keeping(Noting):
        def plan(self, view: skysink.View) -> skysink.Decision:
            kept.append(view.sampling_bps)
            with pytest.raises(ValueError):
                view.sampling_bps[0] = 1.0
            return super().plan(view)

    skysink.simulate(scenarios["one"].replace(KNOWLEDGE["learnt"]), Keeping())
    assert [rates[0] for rates in kept] == [100.0] * 3 + [60.0] * 9


def test_an_environment_has_the_same_belief(scenarios: dict[str, skysink.Scenario]) -> None:
    learning = noted(scenarios["one"], "learnt")
    env = DataCollectionEnv(scenarios["one"].replace(KNOWLEDGE["learnt"]))
    env.reset()
    for slot, seen in enumerate(learning.seen, 1):
        assert env.sampling_bps.tolist() == seen["sampling_bps"]
        assert env.queues_bits.tolist() == seen["queues_bits"]
        assert {name: getattr(env.belief, name).tolist() for name in BELIEF} == {
            name: seen[f"belief.{name}"] for name in BELIEF
        }
        assert env.field.sampling_bps.tolist() == learning.begun
        env.fly(skysink.Decision(env.uav[:2], serve=[0] if slot % 2 else []))
    knowing = DataCollectionEnv(scenarios["one"])
    knowing.reset()
    assert knowing.sampling_bps.tolist() == TRUE_BPS


def test_the_results_of_a_mission_have_the_true_queues(scenarios: dict[str, skysink.Scenario]) -> None:
    scenario = scenarios["one"].replace(KNOWLEDGE["learnt"])
    flown = skysink.simulate(scenario, Noting())
    assert flown.field.sampling_bps.tolist() == scenario.field().sampling_bps.tolist() == TRUE_BPS


def test_known_queues_have_zero_deviation_and_the_age_of_the_last_service(scenarios: dict[str, skysink.Scenario]) -> None:
    scenario = scenarios["one"]
    knowing = noted(scenario, "oracle")
    queues = skysink.simulate(scenario, Noting()).queues
    ages = []
    for slot, seen in enumerate(knowing.seen, 1):
        assert seen["belief.queue_bits"] == seen["queues_bits"] == queues[slot - 1].tolist()
        assert seen["belief.rate_bps"] == TRUE_BPS
        assert seen["belief.queue_sd_bits"] == seen["belief.rate_sd_bps"] == [0.0] * 3
        ages.append(seen["belief.age_slots"])
    # SN 0 is served in slots 1, 3, 5, ...: before slot 2 and 4 that was the last slot.
    expected = [[0, 0, 0], *([slot % 2, slot + 1, slot + 1] for slot in range(11))]
    assert ages == expected


def test_the_deviation_of_an_estimate_is_that_of_its_distribution(scenarios: dict[str, skysink.Scenario]) -> None:
    learning = noted(scenarios["one"], "learnt")
    queues = skysink.simulate(scenarios["one"].replace(KNOWLEDGE["learnt"]), Noting()).queues
    root = np.sqrt(3.0)
    # Before slot 1: a Poisson variable whose mean is uniform on 0 to 1000 has the variance 1000^2/12 + 500; its uniform
    # distribution is capped at 0. The rates are uniform on 50 to 150 bit/s.
    half = np.sqrt(500.0**2 + 3.0 * 500.0)
    draws = np.maximum(500.0 + half * np.linspace(-1.0, 1.0, 1_000_001), 0.0)
    assert np.allclose(learning.seen[0]["belief.queue_sd_bits"], draws.std(), rtol=1e-5)
    assert np.allclose(learning.seen[0]["belief.rate_sd_bps"], 50.0 / root)
    for slot, seen in enumerate(learning.seen[1:], 2):
        assert seen["belief.age_slots"] == [(slot - 1 - (slot - 2) // 2 * 2 - 1), slot - 1, slot - 1]
        # A rate that is not known yet counts since the contact in slot 1.
        first = 50.0 * (slot - 2) / root if slot < 4 else 0.0
        assert seen["belief.queue_sd_bits"][0] == pytest.approx(first)
        assert seen["belief.rate_sd_bps"][0] == pytest.approx(50.0 / root if slot < 4 else 0.0)
        unserved = np.hypot(half, 50.0 * (slot - 1)) / root
        assert np.allclose(seen["belief.queue_sd_bits"][1:], unserved), "both independent, and neither bound is near"
        gaps = np.abs(np.array(seen["belief.queue_bits"]) - queues[slot - 1])[1:]
        assert (gaps <= half + 50.0 * (slot - 1)).all(), "the truth is possible"


def test_beliefs_are_read_only_and_do_not_change_later(scenarios: dict[str, skysink.Scenario]) -> None:
    for knowledge in KNOWLEDGE:
        kept: list[skysink.Belief] = []

        class Keeping(Noting):
            def plan(self, view: skysink.View) -> skysink.Decision:
                assert view.belief is not None
                kept.append(view.belief)  # noqa: B023
                with pytest.raises(ValueError):
                    view.belief.age_slots[0] = 1
                return super().plan(view)

        keeping = Keeping()
        skysink.simulate(scenarios["one"].replace(KNOWLEDGE[knowledge]), keeping)
        for belief, seen in zip(kept, keeping.seen, strict=True):
            assert all(getattr(belief, name).tolist() == seen[f"belief.{name}"] for name in BELIEF)
