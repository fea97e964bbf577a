"""Strategies in Python, in a mission and in comparisons."""

from __future__ import annotations

import json
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from conftest import GFS, ROOT

import skysink

SCENARIOS = ["smoke.toml", "sparse.toml", "plos-suburban.toml"]


def made() -> type[skysink.Strategy]:
    """The class of `GFS`."""
    names: dict[str, Any] = {}
    exec(GFS, names)
    found: type[skysink.Strategy] = names["GFS"]
    return found


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("knowledge", ["oracle", "estimated"])
def test_gfs_in_ten_lines_has_the_bytes_of_gfs(tmp_path: Path, name: str, knowledge: str) -> None:
    scenario = skysink.Scenario.load(ROOT / "scenarios" / name)
    scenario = scenario.replace({"planner.knowledge": knowledge})
    assert len(GFS.strip().splitlines()) <= 10
    mine, theirs = skysink.simulate(scenario, made()), skysink.simulate(scenario, "gfs")
    assert mine.summary["trace_hash"] == theirs.summary["trace_hash"]
    assert (mine.strategy, theirs.strategy) == ("GFS", "gfs")
    assert skysink.simulate(scenario, made()(), label="mine").strategy == "mine"


ANSWERING = '''
import skysink

class GFS(skysink.Strategy):
    def plan(self, view):
        near = view.field.within(view.uav, view.field.reach_m)
        sending = near[view.answers[near] == 0]
        assert set(sending) == set(view.reachable) and view.servable[sending].all()
        if not len(sending):
            return None
        return skysink.Decision(view.field.positions_m[sending[view.values[sending].argmax()]])
'''
"""The rule of `gfs` where sensor nodes may be silent or dead."""


@pytest.mark.parametrize("knowledge", ["oracle", "estimated"])
@pytest.mark.parametrize(
    ("keys", "answer"),
    [
        ({"sensors.energy.capacity_j": 5.0, "sensors.energy.sleep_w": 0.1}, "dead"),
        ({"link.duty_cycle": 0.00002, "link.duty_window_s": 40.0, "link.bandwidth_hz": 2e3}, "silent"),
    ],
)
def test_gfs_leaves_out_the_sensor_nodes_that_gfs_leaves_out(
    keys: dict[str, float], answer: str, knowledge: str
) -> None:
    names: dict[str, Any] = {}
    exec(ANSWERING, names)
    seen = set()

    class Named(names["GFS"]):  # type: ignore[misc, valid-type]
        def plan(self, view: skysink.View) -> skysink.Decision | None:
            told = [view.answer(node) for node in range(len(view.field))]
            assert told == [("queue", "silent", "dead")[number] for number in view.answers]
            assert not view.values[view.answers != 0].any()
            seen.update(told)
            with pytest.raises(skysink.InputError, match="below"):
                view.answer(len(view.field))
            decision: skysink.Decision | None = super().plan(view)
            return decision

    scenario = skysink.Scenario.load(ROOT / "scenarios" / "smoke.toml")
    scenario = scenario.replace({"planner.knowledge": knowledge, **keys})
    mine, theirs = skysink.simulate(scenario, Named), skysink.simulate(scenario, "gfs")
    assert mine.summary["trace_hash"] == theirs.summary["trace_hash"]
    assert seen == {"queue", answer}


class Watch(skysink.Strategy):
    """Stays where it is and keeps what it saw."""

    def __init__(self) -> None:
        self.seen: list[np.ndarray[Any, Any]] = []
        self.copies: list[np.ndarray[Any, Any]] = []
        self.keeps = False

    def plan(self, view: skysink.View) -> skysink.Decision:
        queues = view.queues_bits
        self.copies.append(queues.copy())
        if self.keeps:
            self.seen.append(queues)
        with pytest.raises(ValueError):
            queues[0] = 1
        assert view.uav.shape == (3,) and not view.uav.flags.writeable
        return skysink.Decision(view.uav[:2])


def test_a_kept_view_does_not_change(smoke: skysink.Scenario) -> None:
    watch = Watch()
    watch.keeps = True
    flown = skysink.simulate(smoke, watch)
    assert np.array_equal(np.array(watch.seen), flown.queues[:-1])
    assert np.array_equal(np.array(watch.copies), flown.queues[:-1])


class Fails(skysink.Strategy):
    def plan(self, view: skysink.View) -> skysink.Decision | None:
        if view.slot == 4:
            raise ZeroDivisionError("no such slot")
        return None


def test_an_exception_of_a_strategy_keeps_its_traceback(smoke: skysink.Scenario) -> None:
    with pytest.raises(ZeroDivisionError, match="no such slot") as raised:
        skysink.simulate(smoke, Fails())
    assert raised.value.__notes__ == ["while planning slot 4"]
    assert raised.traceback[-1].name == "plan"


@pytest.mark.parametrize("decided", [7, "here", (1.0, 2.0)])
def test_an_invalid_decision_is_refused(smoke: skysink.Scenario, decided: object) -> None:
    class Wrong(skysink.Strategy):
        def plan(self, view: skysink.View) -> Any:
            return decided

    with pytest.raises(skysink.InputError, match=r"expected a skysink\.Decision"):
        skysink.simulate(smoke, Wrong())


@pytest.mark.parametrize("waypoint", [(1.0,), (1.0, 2.0, 3.0, 4.0), ()])
def test_a_waypoint_of_another_shape_is_refused(waypoint: tuple[float, ...]) -> None:
    with pytest.raises(skysink.InputError, match="waypoint"):
        skysink.Decision(waypoint)


def test_an_infeasible_plan_is_refused_and_counted(smoke: skysink.Scenario) -> None:
    class Away(skysink.Strategy):
        def plan(self, view: skysink.View) -> skysink.Decision:
            return skysink.Decision((1e6, 1e6), serve=[0, 0])

    flown = skysink.simulate(smoke, Away())
    assert flown.summary["refused"] == flown.summary["held_slots"] == 60


def test_a_comparison_equals_that_of_the_command_line(smoke: skysink.Scenario, gfs: Path) -> None:
    standings = skysink.compare(smoke, ["gfs", made(), f"python:{gfs}:GFS", "uts"], seeds=4)
    losses = {entry["label"]: entry for entry in standings if entry["metric"] == "loss_rate"}
    assert list(losses) == ["gfs", "GFS", f"python:{gfs}:GFS", "uts"]
    for label in ["GFS", f"python:{gfs}:GFS"]:
        assert losses[label]["mean"] == losses["gfs"]["mean"]
        assert losses[label]["difference"] == 0.0
    assert losses["uts"]["n"] == 4 and losses["uts"]["difference"] != 0.0


def test_a_comparison_has_a_row_for_each_mission(smoke: skysink.Scenario) -> None:
    compared = skysink.compare(smoke, ["gfs", made(), "uts"], seeds=[4, 2])
    missions = compared.missions.to_polars()
    assert missions["strategy"].to_list() == ["gfs", "gfs", "GFS", "GFS", "uts", "uts"]
    assert missions["seed"].to_list() == [2, 4] * 3
    for (strategy, seed), rows in missions.group_by("strategy", "seed"):
        alone = skysink.simulate(smoke, "gfs" if strategy == "GFS" else str(strategy), seed=int(seed))
        assert rows["loss_rate"].item() == alone.loss_rate
    means = {entry["label"]: entry["mean"] for entry in compared if entry["metric"] == "loss_rate"}
    assert means["uts"] == missions.filter(polars.col("strategy") == "uts")["loss_rate"].mean()
    again = pickle.loads(pickle.dumps(compared))
    assert again == compared and len(again.missions) == 6


def test_a_comparison_in_a_folder_is_resumed_and_extended(smoke: skysink.Scenario, tmp_path: Path) -> None:
    out = tmp_path / "both"
    mine = tmp_path / "mine.py"
    mine.write_text(GFS)
    two = ["gfs", f"python:{mine}:GFS"]
    first = skysink.compare(smoke, two, seeds=2, out=out)
    assert json.loads((out / "comparison.json").read_text()) == list(first)
    assert (out / "strategy-1" / "strategy.py").read_text() == GFS
    again = skysink.compare(smoke, two, seeds=2, out=out)
    assert first.missions.to_polars().equals(again.missions.to_polars())
    more = skysink.compare(smoke, [*two, "uts"], seeds=3, out=out)
    whole = skysink.compare(smoke, [*two, "uts"], seeds=3)
    losses = [[entry for entry in each if entry["metric"] == "loss_rate"] for each in (more, whole)]
    assert losses[0] == losses[1] and len(more.missions) == 9
    with pytest.raises(skysink.InputError, match="describes another sweep"):
        skysink.compare(smoke, two, seeds=3, out=out)
    assert (out / "comparison.json").exists()
    mine.write_text(GFS + "\n")
    with pytest.raises(skysink.InputError, match="describes another sweep"):
        skysink.compare(smoke, [*two, "uts"], seeds=3, out=out)
    with pytest.raises(skysink.InputError, match="expected python:FILE:CLASS with out"):
        skysink.compare(smoke, ["gfs", made()], seeds=1, out=out)


def test_a_comparison_is_a_table_for_latex(smoke: skysink.Scenario) -> None:
    compared = skysink.compare(smoke, ["gfs", "max-weight"], seeds=3)
    mean = {(entry["label"], entry["metric"]): entry for entry in compared}
    cells = [f"{mean['gfs', name]['mean']:.4g}" for name in ("loss_rate", "aoi_mean_s")]
    lines = compared.to_latex("loss_rate", "aoi_mean_s").splitlines()
    assert lines[:4] == [r"\begin{tabular}{lrr}", r"  \toprule", r"  strategy & loss\_rate & aoi\_mean\_s \\", r"  \midrule"]
    assert lines[4] == rf"  gfs & {cells[0]} & {cells[1]} \\" and len(lines) == 8
    low, high = mean["gfs", "loss_rate"]["ci95"]
    assert rf"  gfs & {cells[0]} {{[}}{low:.4g}, {high:.4g}] \\" in compared.to_latex(intervals=True)
    with pytest.raises(skysink.InputError, match="metric 'loss': expected one of the comparison"):
        compared.to_latex("loss")


def test_strategies_with_parameters_have_distinct_names(smoke: skysink.Scenario) -> None:
    class Within(skysink.Strategy):
        def __init__(self, radius_m: float) -> None:
            self.radius_m = radius_m

        def plan(self, view: skysink.View) -> skysink.Decision | None:
            near = view.field.within(view.uav, self.radius_m)
            if not len(near):
                return None
            return skysink.Decision(view.field.positions_m[near[view.queues_bits[near].argmax()]])

    named: dict[str, Any] = {"gfs": "gfs", "far": lambda: Within(20.0), "near": lambda: Within(8.0)}
    standings = skysink.compare(smoke, named, seeds=3)
    losses = {entry["label"]: entry["mean"] for entry in standings if entry["metric"] == "loss_rate"}
    assert list(losses) == list(named)
    assert losses["far"] == losses["gfs"] != losses["near"], "a slot reaches 20 m"
    refused: list[dict[str, Any]] = [{"mine": "gfs"}, {"gfs": lambda: Within(8.0)}]
    for wrong in refused:
        with pytest.raises(skysink.InputError, match="expected"):
            skysink.compare(smoke, wrong, seeds=1)


def test_a_comparison_on_processes_is_the_same(smoke: skysink.Scenario, gfs: Path) -> None:
    strategies = ["uts", f"python:{gfs}:GFS"]
    alone = skysink.compare(smoke, strategies, seeds=3)
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as workers:
        together = skysink.compare(smoke, strategies, seeds=[3, 1, 2], executor=workers)
    untimed = [[entry for entry in all_ if not entry["metric"].startswith("plan_")] for all_ in (alone, together)]
    assert untimed[0] == untimed[1]
    with pytest.raises(skysink.InputError, match="expected a class"):
        skysink.compare(smoke, ["uts", made()()], seeds=1)  # type: ignore[list-item]


def test_a_strategy_file_may_import_files_beside_it(smoke: skysink.Scenario, tmp_path: Path) -> None:
    (tmp_path / "neighbour.py").write_text("HEIGHT = 3.0\n")
    (tmp_path / "mine.py").write_text(
        "from __future__ import annotations\nimport skysink, neighbour\nfrom dataclasses import dataclass\n"
        "@dataclass\nclass Stay(skysink.Strategy):\n    height: float = neighbour.HEIGHT\n"
        "    def plan(self, view):\n        return skysink.Decision(view.uav[:2])\n"
    )
    assert skysink.simulate(smoke, f"python:{tmp_path}/mine.py:Stay").summary["held_slots"] == 0


@pytest.mark.parametrize(
    "name", ["python:mine.py", "python:missing.py:GFS", "python:mine.py:Other", "python::GFS", "nobody"]
)
def test_a_missing_strategy_is_refused(
    smoke: skysink.Scenario, gfs: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(gfs.parent)
    with pytest.raises(skysink.InputError, match=name.rpartition(":")[2]):
        skysink.compare(smoke, ["uts", name], seeds=1)
