"""Scenarios: read, changed, refused, pickled."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import skysink


def test_keys_are_replaced_like_an_axis_of_a_sweep() -> None:
    letter = skysink.Scenario.letter()
    wide = letter.replace({"area.side_m": 500.0, "seed": 7, "sensors.sampling_bps": [50, 150]})
    assert (wide["area.side_m"], wide.seed, wide["sensors.sampling_bps"]) == (500.0, 7, [50.0, 150.0])
    assert wide["uav.start_m"] == [250.0, 250.0], "the centre of the new area"
    assert (letter["area.side_m"], letter.seed) == (100.0, 1), "the first one stays as it was"
    assert wide.replace({"area.side_m": 100.0, "seed": 1, "sensors.sampling_bps": 100.0}) == letter
    both = wide.replace({"area.width_m": 300.0, "area.height_m": 200.0})
    assert (both["area.width_m"], both.seed, both["uav.start_m"]) == (300.0, 7, [150.0, 100.0])
    flown = skysink.simulate(letter.replace({"slots": 1})).scenario
    assert flown.replace({"area.side_m": 500.0})["uav.start_m"] == [250.0, 250.0]
    assert letter.replace({"area.side_m": np.float64(80.0), "slots": np.int64(5)}).slots == 5


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"area.side": 5.0}, "area.side"),
        ({"link.noise_dbm": 12.0}, "replace link.noise_dbm=12.0: expected a finite level below 0 dBm"),
        ({"slots": 0}, "replace slots=0"),
        ({"seed": -1}, "replace seed=-1"),
        ({"planner.strategy": "nobody"}, "nobody"),
    ],
)
def test_a_bad_value_is_refused_in_one_line(changes: dict[str, object], said: str) -> None:
    with pytest.raises(skysink.InputError) as refusal:
        skysink.Scenario.letter().replace(changes)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_an_invalid_file_is_refused_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(skysink.InputError, match="missing.toml"):
        skysink.Scenario.load(tmp_path / "missing.toml")
    with pytest.raises(TypeError):
        skysink.Scenario.letter().replace({"seed": object()})
    with pytest.raises(KeyError):
        skysink.Scenario.letter()["area.colour"]


def test_pickles_and_copies_of_a_scenario_keep_replaced_keys() -> None:
    scenario = skysink.Scenario.load(ROOT / "scenarios" / "sparse.toml").replace({"area.side_m": 400.0})
    for other in (pickle.loads(pickle.dumps(scenario)), copy.deepcopy(scenario)):
        assert other == scenario
        assert hash(other) == hash(scenario)
        assert other["uav.start_m"] == [200.0, 200.0]
    assert scenario != scenario.replace({"seed": 2})


def test_sensor_nodes_equal_those_of_the_command_line() -> None:
    scenario = skysink.Scenario.letter()
    sensors, field = scenario.sensors(), scenario.field()
    assert sensors.columns == ["x_m", "y_m", "queue_bits", "gain_db", "sampling_bps", "capacity_bits", "weight"]
    assert len(sensors) == len(field) == 200
    assert np.array_equal(np.column_stack((sensors["x_m"], sensors["y_m"])), field.positions_m)
    assert (field.reach_m, field.comm_radius_m, field.resource_blocks, field.slots) == (30.0, 10.0, 4, 600)
    assert np.allclose(field.gains, 10 ** (sensors["gain_db"] / 10))


def test_distances_of_a_field_have_the_slack_of_the_model() -> None:
    field = skysink.Scenario.letter().replace({"sensors.count": 30}).field()
    point = field.positions_m[3] + [field.comm_radius_m, 0.0]
    assert 3 in field.within(point, field.comm_radius_m)
    assert 3 not in field.within(point + [1e-3, 0.0], field.comm_radius_m)
    toward = field.toward((0.0, 0.0), (60.0, 80.0))
    assert np.allclose(toward, [18.0, 24.0])  # 30 m of 100 m
    queues = np.arange(30, dtype=np.uint32)
    with pytest.raises(skysink.InputError, match="3 sensor nodes: expected 30"):
        field.fullest((0.0, 0.0), np.zeros(3, np.uint32))
    served = field.fullest(field.positions_m[3], queues)
    near = field.within(field.positions_m[3], field.comm_radius_m)
    assert list(served) == sorted(near)[-field.resource_blocks :], "ids are as full as they are high"
