"""Fleets whose UAVs differ: their keys, their strategies and their agents."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import skysink
from skysink import FleetBatch

EACH = [{"max_speed_mps": 10.0, "count": 2}, {"max_speed_mps": 20.0, "altitude_m": 40.0, "resource_blocks": 1}]


@pytest.fixture
def scenario() -> skysink.Scenario:
    return skysink.Scenario.letter().replace({"slots": 30, "uav.each": EACH})


def test_each_uav_has_its_keys(scenario: skysink.Scenario) -> None:
    uavs = scenario.uavs
    assert [uav["max_speed_mps"] for uav in uavs] == [10.0, 10.0, 20.0]
    assert [uav["altitude_m"] for uav in uavs] == [20.0, 20.0, 40.0]
    assert [uav["resource_blocks"] for uav in uavs] == [4, 4, 1]
    assert scenario["uav.max_speed_mps"] == 30.0
    again = pickle.loads(pickle.dumps(scenario))
    assert again == scenario and hash(again) == hash(scenario) and again.uavs == uavs
    assert len(skysink.Scenario.letter().uavs) == 1


def test_tables_that_repeat_that_of_all_fly_like_equal_uavs() -> None:
    letter = skysink.Scenario.letter().replace({"slots": 30})
    equal = skysink.simulate(letter.replace({"uav.count": 3}), "horizon")
    listed = skysink.simulate(letter.replace({"uav.each": [{"count": 2}, {"max_speed_mps": 30.0}]}), "horizon")
    assert equal.summary["trace_hash"] == listed.summary["trace_hash"]


class Recorder(skysink.Strategy):
    """Serves nobody, and notes the limits of its UAV."""

    def begin(self, field: skysink.Field) -> None:
        LIMITS.append((field.reach_m, field.altitudes_m[0], field.resource_blocks))

    def plan(self, view: skysink.View) -> None:
        return None


LIMITS: list[tuple[float, float, int]] = []


def test_views_have_the_limits_of_their_uav(scenario: skysink.Scenario) -> None:
    LIMITS.clear()
    skysink.simulate(scenario, Recorder)
    assert LIMITS == [(10.0, 20.0, 4), (10.0, 20.0, 4), (20.0, 40.0, 1)]


def test_an_action_moves_each_agent_by_its_own_reach(scenario: skysink.Scenario) -> None:
    batch = FleetBatch(1, scenario, observation=("uav",))
    actions, observed, rewards, terminated, truncated = batch.arrays()
    batch.reset_into(observed, seed=3)
    before = observed.copy()
    actions[...] = 0.0
    actions[..., 0] = 1.0
    batch.step_into(actions, observed, rewards, terminated, truncated)
    moved_m = (observed - before)[0, :, 0] * 100.0
    assert np.allclose(moved_m, [10.0, 10.0, 20.0], atol=1e-3)


def test_agents_with_other_spaces_are_refused() -> None:
    each = [{"altitude": "free"}, {}]
    scenario = skysink.Scenario.letter().replace({"uav.each": each, "link.model": "probabilistic-los"})
    with pytest.raises(skysink.InputError, match="free altitude of all agents or of none"):
        FleetBatch(1, scenario)
