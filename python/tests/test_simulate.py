"""Missions in this process: the bytes of the command line, and results without copies."""

from __future__ import annotations

import gc
import json
import multiprocessing
import pickle
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import polars
import pyarrow
import pytest
from conftest import ROOT, run, same_files

import skysink

AS_FLOWN = ["slots.csv", "scenario.toml", "sensors.csv"]


@pytest.mark.parametrize("strategy", ["uts", "horizon", "rfs"])
def test_a_saved_run_has_the_bytes_of_the_command_line(tmp_path: Path, strategy: str) -> None:
    scenario = ROOT / "scenarios" / "smoke.toml"
    run("simulate", scenario, "--strategy", strategy, "--seed", "3", "--out", "by-command", cwd=tmp_path)
    flown = skysink.simulate(scenario, strategy, seed=3)
    flown.save(tmp_path / "by-python")
    same_files(tmp_path / "by-command", tmp_path / "by-python", [*AS_FLOWN, "run.toml"])
    written = json.loads((tmp_path / "by-command" / "summary.json").read_text())
    del written["check"]
    assert {**written, "timing": None} == {**flown.summary, "timing": None}
    run("report", "by-python", "--sensors", cwd=tmp_path)


def test_a_run_folder_is_read_again(tmp_path: Path, smoke: skysink.Scenario) -> None:
    flown = skysink.simulate(smoke, "gfs")
    flown.save(tmp_path / "run")
    read = skysink.Run.load(tmp_path / "run")
    assert read.summary == flown.summary
    assert polars.DataFrame(read.slots).equals(polars.DataFrame(flown.slots))
    assert np.array_equal(read.queues, flown.queues)
    text = (tmp_path / "run" / "slots.csv").read_text()
    (tmp_path / "run" / "slots.csv").write_text(text.replace(",serve,", ",hold,", 1))
    with pytest.raises(skysink.InputError):
        skysink.Run.load(tmp_path / "run")


def test_a_folder_is_replaced_only_with_force(tmp_path: Path, smoke: skysink.Scenario) -> None:
    flown = skysink.simulate(smoke, "gfs")
    flown.save(tmp_path / "run")
    with pytest.raises(skysink.InputError, match="exists"):
        flown.save(tmp_path / "run")
    flown.save(tmp_path / "run", force=True)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("mine")
    with pytest.raises(skysink.InputError):
        flown.save(tmp_path / "other", force=True)


def test_every_bit_of_the_queues_is_accounted_for(smoke: skysink.Scenario) -> None:
    flown = skysink.simulate(smoke, "uts")
    slots, queues = flown.slots, flown.queues.astype(np.int64)
    assert queues.shape == (61, 40)
    assert np.array_equal(queues[1:].sum(axis=1), slots["queued_bits"])
    gone = slots["delivered_bits"].astype(np.int64) + slots["lost_bits"].astype(np.int64)
    sampled = np.diff(queues.sum(axis=1)) + gone
    assert (sampled == 40 * 100).all()  # 100 bit/s, slots of a second
    assert flown.loss_rate == flown.metrics["loss_rate"] == slots["lost_bits"].sum() / sampled.sum()


def test_sensor_results_equal_those_of_the_report(tmp_path: Path, smoke: skysink.Scenario) -> None:
    flown = skysink.simulate(smoke.replace({"sensors.sampling_bps": [0.0, 900.0]}), "uts")
    flown.save(tmp_path / "run")
    run("report", "run", "--sensors", cwd=tmp_path)
    sensors = polars.DataFrame(flown.sensors)
    reported = polars.read_csv(tmp_path / "run" / "sensors_out.csv")
    assert sensors.columns == reported.columns and len(sensors) == 40
    for name in sensors.columns:
        assert sensors[name].cast(polars.Float64).equals(reported[name].cast(polars.Float64)), name
    assert sensors["first_loss_slot"].null_count() > 0 < sensors["lost_bits"].sum() == flown.summary["lost_bits"]


def test_columns_are_shared_with_other_libraries_and_not_copied(smoke: skysink.Scenario) -> None:
    slots = skysink.simulate(smoke, "uts").slots
    mine = slots["x_m"]
    assert not mine.flags.writeable and not mine.flags.owndata
    address = mine.__array_interface__["data"][0]
    arrow = pyarrow.table(slots)
    assert arrow["x_m"].chunk(0).buffers()[1].address == address
    frame = polars.DataFrame(slots)
    assert frame["x_m"].to_numpy(allow_copy=False).__array_interface__["data"][0] == address
    pandas_frame = slots.to_pandas()
    assert pandas_frame["x_m"].to_numpy().__array_interface__["data"][0] == address
    assert list(pandas_frame.columns) == slots.columns == list(frame.columns)
    served = slots["scheduled"]
    assert [list(ids) for ids in frame["scheduled"]] == served
    with pytest.raises(KeyError, match="lost_bits"):
        slots["lost"]
    copy = mine.copy()
    del slots, arrow, frame, pandas_frame
    gc.collect()
    [np.full(len(copy), 7.0) for _ in range(100)]
    assert np.array_equal(mine, copy), "the memory lives as long as the array"


def test_values_passed_between_processes_can_be_pickled(smoke: skysink.Scenario) -> None:
    flown = skysink.simulate(smoke, "uts")
    for value in (flown, flown.slots, flown.field, skysink.Decision((1.0, 2.0), serve=[3]), flown.scenario):
        assert repr(pickle.loads(pickle.dumps(value))) == repr(value)
    again = pickle.loads(pickle.dumps(flown))
    assert again.summary == flown.summary and np.array_equal(again.queues, flown.queues)
    assert polars.DataFrame(pickle.loads(pickle.dumps(flown.slots))).equals(polars.DataFrame(flown.slots))
    assert np.array_equal(pickle.loads(pickle.dumps(flown.field)).positions_m, flown.field.positions_m)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as workers:
        elsewhere = workers.submit(skysink.simulate, smoke, "uts").result()
    assert elsewhere.summary["trace_hash"] == flown.summary["trace_hash"]


@pytest.mark.parametrize("label", ["uts", "a/b", "", "x" * 65])
def test_an_invalid_label_is_refused(smoke: skysink.Scenario, label: str) -> None:
    with pytest.raises(skysink.InputError, match="label"):
        skysink.simulate(smoke, "uts", label=label)


def test_a_mission_can_be_interrupted() -> None:
    import _thread

    sparse = skysink.Scenario.load(ROOT / "scenarios" / "sparse.toml")
    scenario = sparse.replace({"area.side_m": 1000.0, "planner.offline.steps": 10**12})
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    timer = threading.Timer(0.5, _thread.interrupt_main)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        skysink.simulate(scenario, "offline")  # which would take days
    timer.join()
    signal.signal(signal.SIGINT, before)


def test_other_threads_run_during_a_mission() -> None:
    counted = 0
    done = threading.Event()

    def count() -> None:
        nonlocal counted
        while not done.is_set():
            counted += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    sparse = skysink.Scenario.load(ROOT / "scenarios" / "sparse.toml")
    skysink.simulate(sparse.replace({"area.side_m": 1000.0, "planner.offline.steps": 300_000}), "offline")
    done.set()
    thread.join()
    assert counted > 10


def test_the_command_line_of_the_package_is_that_of_skysink(tmp_path: Path) -> None:
    assert run("--version", cwd=tmp_path).stdout == f"skysink {skysink.__version__} ({skysink.__build__})\n"
    refused = run("simulate", "missing.toml", cwd=tmp_path, code=2)
    assert "missing.toml" in refused.stderr
