"""A decision that is not flown is counted, and warned of where it is many; NaN is an error."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from conftest import ROOT, run

import skysink
from skysink.environment import DataCollectionEnv

FAR = """
import skysink

class Far(skysink.Strategy):
    def plan(self, view):
        return skysink.Decision((view.uav[0] + 5000.0, 50.0))
"""


class Far(skysink.Strategy):
    """Decides for a waypoint out of reach in the first slots, and hovers after them."""

    def __init__(self, first: int = 10**9) -> None:
        self.first = first

    def plan(self, view: skysink.View) -> skysink.Decision:
        return skysink.Decision((view.uav[0] + 5000.0 * (view.slot <= self.first), view.uav[1]), serve=[])


class Deaf(skysink.Strategy):
    """Hovers, and wants to serve the farthest sensor node."""

    def plan(self, view: skysink.View) -> skysink.Decision:
        distances_m = np.linalg.norm(view.field.positions_m - view.uav[:2], axis=1)
        return skysink.Decision(view.uav[:2], serve=[int(distances_m.argmax())])


class Wrong(skysink.Strategy):
    """Decides for this waypoint in slot 3."""

    def __init__(self, *waypoint: float) -> None:
        self.waypoint = waypoint

    def plan(self, view: skysink.View) -> skysink.Decision:
        return skysink.Decision(self.waypoint if view.slot == 3 else view.uav[:2])


def said(work: Any) -> list[str]:
    """The warnings of some work."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        work()
    assert all(one.category is RuntimeWarning and one.filename == __file__ for one in caught)
    return [str(one.message) for one in caught]


@pytest.fixture
def far(tmp_path: Path) -> str:
    """The name of a strategy in a file, all of whose waypoints are out of reach."""
    (tmp_path / "far.py").write_text(FAR)
    return f"python:{tmp_path}/far.py:Far"


def test_a_mission_that_is_held_is_warned_of(smoke: skysink.Scenario) -> None:
    [line] = said(lambda: skysink.simulate(smoke, Far()))
    assert line.startswith("60 of 60 slots held, 60 requests refused: a UAV holds without a plan in time, and where")
    assert line.endswith("(docs/src/metrics.md#refusals)") and "\n" not in line


def test_the_counts_are_metrics(smoke: skysink.Scenario) -> None:
    with pytest.warns(RuntimeWarning):
        flown = skysink.simulate(smoke, Far(10))
    assert (flown.metrics["held_slots"], flown.metrics["refused"]) == (10, 10)
    assert (flown.summary["held_slots"], flown.summary["refused"]) == (10, 10)


def test_sensor_nodes_out_of_range_are_warned_of(smoke: skysink.Scenario) -> None:
    wide = smoke.replace({"area.side_m": 900.0})
    [line] = said(lambda: skysink.simulate(wide, Deaf()))
    assert line.startswith("0 of 60 slots held, 60 requests refused: ")


@pytest.mark.parametrize("strategy", ["uts", "gfs", "exact", "horizon", "tour", "max-weight"])
def test_strategies_that_decide_well_are_not(smoke: skysink.Scenario, strategy: str) -> None:
    assert said(lambda: skysink.simulate(smoke, strategy)) == []


def test_the_limit_is_one_slot_in_a_hundred(smoke: skysink.Scenario) -> None:
    long = smoke.replace({"slots": 500})
    assert said(lambda: skysink.simulate(long, Far(5))) == []
    [line] = said(lambda: skysink.simulate(long, Far(6)))
    assert line.startswith("6 of 500 slots held")


def test_a_fleet_counts_the_slots_of_all_uavs(smoke: skysink.Scenario) -> None:
    fleet = smoke.replace({"uav.count": 3})
    [line] = said(lambda: skysink.simulate(fleet, Far))
    assert line.startswith("180 of 180 slots held, 180 requests refused")


def test_a_comparison_names_the_strategy(smoke: skysink.Scenario) -> None:
    found: list[skysink.Comparison] = []
    [line] = said(lambda: found.append(skysink.compare(smoke, {"gfs": "gfs", "far": Far}, seeds=3)))
    assert line.startswith("far: 60 of 60 slots held, 60 requests refused with seed 1, the worst of 3 such flights of 3: ")
    entries = {(entry["label"], entry["metric"]): entry["mean"] for entry in found[0]}
    assert [entries[label, metric] for label in ("gfs", "far") for metric in ("held_slots", "refused")] == [0, 0, 60, 60]
    missions = polars.DataFrame(found[0].missions)
    assert missions["held_slots"].dtype == polars.UInt64 and missions["refused"].to_list() == [0] * 3 + [60] * 3


def test_a_sweep_names_the_point_in_python_and_in_merge(far: str, tmp_path: Path) -> None:
    text = f'scenario = "{ROOT}/scenarios/smoke.toml"\nstrategies = ["gfs", "{far}"]\nseeds = 2\n[axes]\n"slots" = [40, 60]\n'
    (tmp_path / "sweep.toml").write_text(text)
    [line] = said(lambda: skysink.sweep(tmp_path / "sweep.toml", tmp_path / "flown"))
    assert f"{far} at slots = 40: 40 of 40 slots held" in line and f"{far} at slots = 60: 60 of 60 slots held" in line
    results = polars.read_csv(tmp_path / "flown" / "results.csv")
    assert results.filter(polars.col("strategy") == far)["held_slots"].to_list() == [40, 40, 60, 60]
    assert f"warning: {line}" in run("merge", "flown", "--out", "merged", cwd=tmp_path).stderr


def test_the_command_line_says_it_of_a_saved_run(smoke: skysink.Scenario, tmp_path: Path) -> None:
    with pytest.warns(RuntimeWarning):
        skysink.simulate(smoke, Far(), label="far").save(tmp_path / "far")
    skysink.simulate(smoke, "gfs").save(tmp_path / "good")
    line = "warning: 60 of 60 slots held, 60 requests refused: "
    assert line in run("report", "far", cwd=tmp_path).stderr
    with_json = run("report", "far", "--json", cwd=tmp_path)
    assert line in with_json.stderr and json.loads(with_json.stdout)["held_slots"] == 60
    assert "warning" not in run("report", "good", cwd=tmp_path).stderr
    compared = run("compare", "good", "far", "--no-record", "--out", "compared", cwd=tmp_path)
    assert "warning: far: 60 of 60 slots held, 60 requests refused: " in compared.stderr
    standings = json.loads((tmp_path / "compared" / "comparison.json").read_text())
    assert [one["mean"] for one in standings if one["metric"] == "held_slots"] == [0, 60]


@pytest.mark.parametrize("waypoint", [(np.nan, 5.0), (5.0, np.nan), (5.0, 5.0, np.nan), (np.inf, 5.0), (5.0, -np.inf)])
def test_nan_is_an_error_that_names_the_slot_and_the_waypoint(smoke: skysink.Scenario, waypoint: tuple[float, ...]) -> None:
    for fly in (
        lambda: skysink.simulate(smoke, Wrong(*waypoint)),
        lambda: skysink.compare(smoke, {"gfs": "gfs", "wrong": lambda: Wrong(*waypoint)}, seeds=1),
    ):
        with pytest.raises(skysink.InputError, match=r"waypoint \[.*(NaN|inf).*\]: expected finite coordinates \[m\]") as raised:
            fly()
        assert raised.value.__notes__ == ["while planning slot 3"]
    with pytest.raises(skysink.InputError, match="expected finite coordinates"):
        skysink.Decision(np.array(waypoint))


def test_nan_in_the_step_of_an_environment_is_an_error() -> None:
    env = DataCollectionEnv(ROOT / "scenarios" / "smoke.toml")
    env.reset(seed=1)
    with pytest.raises(skysink.InputError, match="expected finite coordinates"):
        env.fly(skysink.Decision((np.nan, 1.0)))
