"""Several UAVs in Python: whole missions; those of Gymnasium are for one."""

from __future__ import annotations

import pickle

import pytest

import skysink
from skysink.environment import DataCollectionEnv

FLEET = """name = "fleet"
slots = 40
[area]
side_m = 200.0
[sensors]
count = 40
sampling_bps = [100.0, 900.0]
[uav]
count = 3
coordination = "partition"
"""


@pytest.fixture
def scenario() -> skysink.Scenario:
    return skysink.Scenario.parse(FLEET)


def test_a_fleet_run_has_a_row_per_uav_and_can_be_repeated(scenario: skysink.Scenario) -> None:
    run = skysink.simulate(scenario, "tour")
    table = run.slots
    assert list(table["uav"][:4]) == [0, 1, 2, 0] and len(table["uav"]) == 3 * 40 and len(run) == 40
    assert run.summary["fleet"]["uavs"] == 3 and run.summary["fleet"]["contended"] == 0
    restored = pickle.loads(pickle.dumps(run))
    assert restored.summary == run.summary
    assert (restored.queues == run.queues).all()


def test_more_uavs_lose_less(scenario: skysink.Scenario) -> None:
    alone = skysink.simulate(scenario.replace({"uav.count": 1}), "edf")
    assert skysink.simulate(scenario, "edf").loss_rate < alone.loss_rate


def test_an_environment_of_one_uav_refuses_several(scenario: skysink.Scenario) -> None:
    with pytest.raises(ValueError, match="uav.count = 3: expected 1"):
        DataCollectionEnv(scenario)
