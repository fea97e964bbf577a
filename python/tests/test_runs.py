"""Saved runs of strategies in Python: they name what flew, hold its source, and fly the same again or refuse."""

from __future__ import annotations

import importlib
import json
import pickle
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from conftest import GFS, run, same_files

import skysink
from skysink.environment import DataCollectionEnv

NEAR = """
from neighbour import nearest
import skysink

class Near(skysink.Strategy):
    def plan(self, view):
        return nearest(view)
"""

NEIGHBOUR = """
import skysink

def nearest(view):
    return skysink.Decision(view.field.toward(view.uav, view.field.positions_m[view.slot % len(view.field)]))
"""


class Stay(skysink.Strategy):
    """Stays where it is."""

    def plan(self, view: skysink.View) -> skysink.Decision:
        return skysink.Decision(view.uav[:2])


@pytest.fixture
def near(tmp_path: Path) -> Path:
    """A file with a strategy that imports its neighbour."""
    (tmp_path / "neighbour.py").write_text(NEIGHBOUR)
    (tmp_path / "near.py").write_text(NEAR)
    return tmp_path / "near.py"


def test_a_saved_run_contains_the_name_and_source_of_its_strategy(smoke: skysink.Scenario, gfs: Path) -> None:
    flown = skysink.simulate(smoke, f"python:{gfs}:GFS", label="mine")
    assert flown.scenario.strategy == f"python:{gfs}:GFS"
    folder = flown.save(gfs.parent / "run")
    scenario = tomllib.loads((folder / "scenario.toml").read_text())
    assert scenario["planner"]["strategy"] == "python:strategy.py:GFS"
    assert (folder / "strategy.py").read_text() == GFS
    origin = tomllib.loads((folder / "run.toml").read_text())
    assert origin["outside_planner"] == "mine" and origin["external"] == ["planner"]
    assert [name for name, _ in origin["sources"]] == ["strategy.py"]
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["strategy"], summary["external"]) == ("mine", ["planner"])


def test_a_saved_strategy_flies_the_same_with_its_imported_files(smoke: skysink.Scenario, near: Path) -> None:
    place = near.parent
    flown = skysink.simulate(smoke, f"python:{near}:Near")
    flown.save(place / "run")
    assert (place / "run" / "strategy.neighbour.py").read_text() == NEIGHBOUR
    near.unlink()
    (place / "neighbour.py").unlink()
    again = skysink.simulate(place / "run" / "scenario.toml")
    assert again.summary["trace_hash"] == flown.summary["trace_hash"]
    again.save(place / "again")
    files = ["slots.csv", "sensors.csv", "scenario.toml", "run.toml", "strategy.py", "strategy.neighbour.py"]
    same_files(place / "run", place / "again", files)
    for loaded in (skysink.Run.load(place / "run"), pickle.loads(pickle.dumps(flown))):
        loaded.save(place / "again", force=True)
        same_files(place / "run", place / "again", files)


def test_a_changed_source_is_refused(smoke: skysink.Scenario, near: Path) -> None:
    folder = skysink.simulate(smoke, f"python:{near}:Near").save(near.parent / "run")
    source = folder / "strategy.neighbour.py"
    source.write_text(source.read_text() + "\n")
    with pytest.raises(skysink.InputError, match=r"strategy\.neighbour\.py: it was modified"):
        skysink.Run.load(folder)
    with pytest.raises(skysink.InputError, match=r"strategy\.neighbour\.py: it was modified"):
        skysink.simulate(folder / "scenario.toml")
    refused = run("report", folder, "--sensors", cwd=near.parent, code=2)
    assert "strategy.neighbour.py: it was modified" in refused.stderr


def test_runs_of_objects_and_episodes_are_labelled_and_cannot_be_repeated(
    smoke: skysink.Scenario, tmp_path: Path
) -> None:
    env = DataCollectionEnv(smoke)
    env.reset()
    env.step(env.action_space.sample())
    for flown, name in [(skysink.simulate(smoke, Stay()), "Stay"), (env.run("policy"), "policy")]:
        folder = flown.save(tmp_path / name)
        scenario = skysink.Scenario.load(folder / "scenario.toml")
        assert scenario.strategy == flown.scenario.strategy == f"python:{name}"
        with pytest.raises(skysink.InputError, match=f"expected an object of the program.*{name}"):
            skysink.simulate(scenario)
    assert (tmp_path / "Stay" / "strategy.py").read_bytes() == Path(__file__).read_bytes()
    again = skysink.simulate(skysink.Scenario.load(tmp_path / "Stay" / "scenario.toml"), Stay)
    assert again.summary["trace_hash"] == skysink.Run.load(tmp_path / "Stay").summary["trace_hash"]


def test_the_command_line_reads_a_saved_run_and_refuses_to_fly_it(smoke: skysink.Scenario, gfs: Path) -> None:
    place = gfs.parent
    skysink.simulate(smoke, f"python:{gfs}:GFS").save(place / "run")
    skysink.simulate(smoke, "gfs").save(place / "other")
    run("report", "run", "--sensors", cwd=place)
    run("compare", "run", "other", cwd=place)
    run("export", "run", "--format", "csv", "--out", "run.csv", "--origin", "47,8", "--north", "true", cwd=place)
    run("replay", "run", "--no-viewer", cwd=place)
    run("check", "run/scenario.toml", cwd=place)
    for words in (["simulate"], ["run", "--no-viewer"]):
        refused = run(*words, "run/scenario.toml", "--out", "new", cwd=place, code=2)
        assert 'planner.strategy = "python:strategy.py:GFS": expected a built-in strategy' in refused.stderr
        assert refused.stderr.count("\n") == 1 and "skysink.simulate()" in refused.stderr
        assert not (place / "new").exists()
    run("simulate", "run/scenario.toml", "--strategy", "gfs", "--out", "new", cwd=place)
    same_files(place / "run", place / "new", ["slots.csv"])


def test_a_scenario_file_may_name_a_strategy_beside_it(smoke: skysink.Scenario, gfs: Path) -> None:
    scenario = smoke.replace({"planner.strategy": f"python:{gfs.name}:GFS"})
    (gfs.parent / "mine.toml").write_text(scenario.to_toml())
    flown = skysink.simulate(gfs.parent / "mine.toml")
    assert flown.summary["trace_hash"] == skysink.simulate(smoke, "gfs").summary["trace_hash"]
    assert flown.strategy == "GFS"


def test_replacing_a_run_removes_its_source(smoke: skysink.Scenario, near: Path) -> None:
    folder = skysink.simulate(smoke, f"python:{near}:Near").save(near.parent / "run")
    (folder / "notes.py").write_text("mine")
    skysink.simulate(smoke, "gfs").save(folder, force=True)
    assert sorted(path.name for path in folder.glob("*.py")) == ["notes.py"]


def test_a_saved_strategy_flies_again_with_packages_and_late_imports(tmp_path: Path, smoke: skysink.Scenario) -> None:
    home = tmp_path / "home"
    (home / "pkg" / "deep").mkdir(parents=True)
    (home / "spaces").mkdir()
    (home / "pkg" / "__init__.py").write_text("from .deep import NUMBER\n")
    (home / "pkg" / "deep" / "__init__.py").write_text("from ..part import NUMBER\n")
    (home / "pkg" / "part.py").write_text("NUMBER = 1\n")
    (home / "spaces" / "near.py").write_text("NUMBER = 2\n")
    (home / "late_neighbour.py").write_text("def target(view): return view.field.positions_m[3]\n")
    (home / "mine.py").write_text(
        "import skysink\nimport pkg\nimport spaces.near\n"
        "class Mine(skysink.Strategy):\n"
        "    def plan(self, view):\n"
        "        import late_neighbour\n"
        "        assert (pkg.NUMBER, spaces.near.NUMBER) == (1, 2)\n"
        "        return skysink.Decision(view.field.toward(view.uav, late_neighbour.target(view)))\n"
    )
    flown = skysink.simulate(smoke, f"python:{home / 'mine.py'}:Mine")
    (home / "late_neighbour.py").write_text("raise ValueError\n")  # after the flight: what flew is saved
    flown.save(tmp_path / "run")
    names = sorted(path.name for path in (tmp_path / "run").glob("strategy*.py"))
    modules = ["late_neighbour", "pkg.__init__", "pkg.deep.__init__", "pkg.part", "spaces.near"]
    assert names == sorted(["strategy.py", *[f"strategy.{module}.py" for module in modules]])
    shutil.rmtree(home)
    code = f"import skysink; print(skysink.simulate({str(tmp_path / 'run' / 'scenario.toml')!r}).summary['trace_hash'])"
    again = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert again.stdout.strip() == str(flown.summary["trace_hash"])


def test_the_source_of_an_object_is_its_class_definition(
    tmp_path: Path, smoke: skysink.Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    slots = "from dataclasses import dataclass\n@dataclass(slots=True)\n"  # makes the class twice
    text = f"import skysink, beside_it\n{slots}class Stays(skysink.Strategy):\n    def plan(self, view):\n        return None\n"
    (tmp_path / "defined_here.py").write_text(text)
    (tmp_path / "beside_it.py").write_text("ONE = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    stays = importlib.import_module("defined_here").Stays()
    (tmp_path / "defined_here.py").write_text(text.replace("None", "1 / 0"))
    (tmp_path / "beside_it.py").write_text("ONE = 2\n")
    skysink.simulate(smoke, stays).save(tmp_path / "run")
    assert (tmp_path / "run" / "strategy.py").read_text() == text
    assert (tmp_path / "run" / "strategy.beside_it.py").read_text() == "ONE = 1\n"
