"""Sweeps have the same bytes as `skysink sweep`, on any executor."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import types
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import polars
import pytest
from conftest import ROOT, run, same_files

import skysink

FILES = ["results.csv", "summary.csv"]

SWEEP = f"""
scenario = "{ROOT}/scenarios/smoke.toml"
strategies = ["uts", "gfs"]
seeds = 30
[axes]
"sensors.sampling_bps" = [100.0, 400.0]
"""


@pytest.fixture
def by_command(tmp_path: Path) -> Path:
    """The results of `skysink sweep`."""
    (tmp_path / "sweep.toml").write_text(SWEEP)
    run("sweep", "sweep.toml", "--out", "by-command", cwd=tmp_path)
    return tmp_path / "by-command"


@pytest.fixture
def file(by_command: Path) -> Path:
    """The sweep file."""
    return by_command.with_name("sweep.toml")


def context() -> Any:
    """How processes are started: none of this one's threads are in them."""
    return multiprocessing.get_context("spawn")


@pytest.mark.parametrize("executor", [None, lambda: ThreadPoolExecutor(3), lambda: ProcessPoolExecutor(2, context())])
def test_a_sweep_has_the_bytes_of_the_command_line(by_command: Path, file: Path, tmp_path: Path, executor: Any) -> None:
    if executor is None:
        results = skysink.sweep(file, tmp_path / "mine")
    else:
        with executor() as workers:
            results = skysink.sweep(file, tmp_path / "mine", executor=workers)
    same_files(by_command, tmp_path / "mine", FILES)
    assert len(results) == 120
    assert polars.DataFrame(results).equals(polars.read_parquet(skysink.parquet(by_command)))


class Dying(Executor):
    """Runs some tasks, and then fails like a pool with a dead worker."""

    def __init__(self, tasks: int) -> None:
        self.tasks = tasks

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.tasks -= 1
        if self.tasks >= 0:
            future.set_result(function(*arguments))
        else:
            future.set_exception(BrokenProcessPool("a worker died"))
        return future


def test_results_before_the_failure_of_an_executor_are_kept(
    by_command: Path, file: Path, tmp_path: Path
) -> None:
    with pytest.raises(BrokenProcessPool):
        skysink.sweep(file, tmp_path / "mine", executor=Dying(60))
    flown = (tmp_path / "mine" / "journal.csv").read_bytes().count(b"\n")
    counting = Dying(120)
    skysink.sweep(file, tmp_path / "mine", executor=counting)
    assert 120 - counting.tasks == 120 - flown, "missions submitted, one a task"
    same_files(by_command, tmp_path / "mine", FILES)


def kill_once(flag: str) -> None:
    """Kills this process, the first time."""
    try:
        os.close(os.open(flag, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return
    os.kill(os.getpid(), signal.SIGKILL)


class Killing:
    """An executor, one of whose workers is killed during the sweep."""

    def __init__(self, executor: Any, flag: Path) -> None:
        self.executor, self.flag, self.tasks = executor, str(flag), 0

    def submit(self, function: Any, *arguments: Any) -> Any:
        self.tasks += 1
        if self.tasks == 30:
            return self.executor.submit(kill_and_fly, self.flag, function, *arguments)
        return self.executor.submit(function, *arguments)


def kill_and_fly(flag: str, function: Any, *arguments: Any) -> Any:
    """A task that kills its worker, the first time."""
    kill_once(flag)
    return function(*arguments)


def test_dask_gives_the_same_bytes_after_a_worker_is_killed(
    by_command: Path, file: Path, tmp_path: Path
) -> None:
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, protocol="tcp://")
    with cluster, distributed.Client(cluster) as client:
        killing = Killing(client.get_executor(), tmp_path / "killed")
        skysink.sweep(file, tmp_path / "mine", executor=killing)
    assert (tmp_path / "killed").exists()
    same_files(by_command, tmp_path / "mine", FILES)


def test_ray_gives_the_same_bytes_after_a_worker_is_killed(by_command: Path, file: Path, tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    here = {"env_vars": {"PYTHONPATH": os.path.dirname(__file__)}}
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, runtime_env=here)
    try:
        executor = types.SimpleNamespace(submit=lambda task, *arguments: ray.remote(task).remote(*arguments).future())
        skysink.sweep(file, tmp_path / "mine", executor=Killing(executor, tmp_path / "killed"))
    finally:
        ray.shutdown()
    assert (tmp_path / "killed").exists()
    same_files(by_command, tmp_path / "mine", FILES)


def test_a_python_strategy_runs_in_a_sweep(tmp_path: Path, gfs: Path) -> None:
    text = SWEEP.replace('["uts", "gfs"]', '["gfs", "python:mine.py:GFS"]').replace("seeds = 30", "seeds = 3")
    (tmp_path / "sweep.toml").write_text(text)
    results = polars.DataFrame(skysink.sweep(tmp_path / "sweep.toml", tmp_path / "alone"))
    columns = [name for name in results.columns if name != "strategy"]
    mine = results.filter(polars.col("strategy") == "python:mine.py:GFS")
    assert mine[columns].equals(results.filter(polars.col("strategy") == "gfs")[columns])
    with ProcessPoolExecutor(2, context()) as workers:
        skysink.sweep(tmp_path / "sweep.toml", tmp_path / "many", executor=workers)
    same_files(tmp_path / "alone", tmp_path / "many", FILES)
    run("plot", "alone", "--x", "sensors.sampling_bps", cwd=tmp_path)
    refused = run("sweep", "sweep.toml", cwd=tmp_path, code=2)
    assert "skysink.sweep()" in refused.stderr


def test_a_changed_strategy_makes_another_sweep(tmp_path: Path, gfs: Path) -> None:
    text = SWEEP.replace('["uts", "gfs"]', '["python:mine.py:GFS"]').replace("seeds = 30", "seeds = 1")
    (tmp_path / "sweep.toml").write_text(text)
    skysink.sweep(tmp_path / "sweep.toml", tmp_path / "mine")
    gfs.write_text(gfs.read_text() + "\n# changed\n")
    with pytest.raises(skysink.InputError, match="another sweep"):
        skysink.sweep(tmp_path / "sweep.toml", tmp_path / "mine")


def test_a_folder_alone_repeats_a_sweep_of_strategies_in_python(tmp_path: Path, gfs: Path) -> None:
    near, far = tmp_path / "near", tmp_path / "far"
    for folder, factor in [(near, 0.5), (far, 1.0)]:
        folder.mkdir()
        text = gfs.read_text().replace("view.field.reach_m)", "view.field.reach_m * factor())")
        (folder / "mine.py").write_text(f"from rule import factor\n{text}")
        (folder / "rule.py").write_text(f"def factor():\n    return {factor}\n")
    names = '["gfs", "python:near/mine.py:GFS", "python:far/mine.py:GFS"]'
    text = SWEEP.replace('["uts", "gfs"]', names).replace("seeds = 30", "seeds = [2, 3]")
    (tmp_path / "sweep.toml").write_text(text)
    skysink.sweep(tmp_path / "sweep.toml", tmp_path / "first")
    shutil.rmtree(near)
    shutil.rmtree(far)
    (tmp_path / "sweep.toml").unlink()
    gfs.unlink()
    saved = sorted(str(file.relative_to(tmp_path / "first")) for file in (tmp_path / "first").glob("strategy-*/*"))
    assert saved == [f"strategy-{index}/{name}" for index in (1, 2) for name in ("strategy.py", "strategy.rule.py")]
    results = polars.DataFrame(skysink.sweep(tmp_path / "first", tmp_path / "second"))
    with ProcessPoolExecutor(2, context()) as workers:
        skysink.sweep(tmp_path / "first", tmp_path / "third", executor=workers)
    skysink.sweep(tmp_path / "second")  # complete
    for other in ("second", "third"):
        same_files(tmp_path / "first", tmp_path / other, [*FILES, "sweep.json", "sweep.toml", "scenario.toml", *saved])
    losses = {name: list(part["loss_rate"]) for (name,), part in results.group_by("strategy")}
    assert losses["python:far/mine.py:GFS"] == losses["gfs"] != losses["python:near/mine.py:GFS"]
    assert "skysink.sweep()" in run("sweep", "first", "--out", "fourth", cwd=tmp_path, code=2).stderr
    run("merge", "first", "--out", "merged", cwd=tmp_path)
    same_files(tmp_path / "first", tmp_path / "merged", [*FILES, *saved])
    rule = tmp_path / "first" / "strategy-2" / "strategy.rule.py"
    rule.write_text(rule.read_text().replace("1.0", "0.9"))
    with pytest.raises(skysink.InputError, match="the source of a strategy was modified"):
        skysink.sweep(tmp_path / "first", tmp_path / "fourth")


def test_a_python_strategy_extends_a_sweep(by_command: Path, tmp_path: Path, gfs: Path) -> None:
    text = SWEEP.replace('["uts", "gfs"]', '["uts", "gfs", "python:mine.py:GFS"]')
    (tmp_path / "larger.toml").write_text(text)
    skysink.sweep(tmp_path / "larger.toml", tmp_path / "whole")
    flown = (by_command / "journal.csv").read_bytes()
    skysink.sweep(tmp_path / "larger.toml", by_command)
    assert (by_command / "journal.csv").read_bytes().startswith(flown)
    same_files(tmp_path / "whole", by_command, FILES)


@pytest.mark.parametrize("text", ["", "seeds = 3", "not toml", SWEEP.replace("uts", "python:none.py:X")])
def test_a_bad_file_is_refused_and_nothing_written(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.toml").write_text(text)
    for executor in (None, ThreadPoolExecutor(1)):
        with pytest.raises(skysink.InputError):
            skysink.sweep(tmp_path / "bad.toml", tmp_path / "out", executor=executor)
    assert not (tmp_path / "out").exists()


def test_a_sweep_tells_its_progress(file: Path, tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as workers:
        for name, executor in (("here", None), ("there", workers)):
            said: list[tuple[int, int]] = []
            skysink.sweep(file, tmp_path / name, executor=executor, progress=lambda done, of, to=said: to.append((done, of)))
            assert (min(said), max(said)) == ((0, 120), (120, 120)) and len(said) == 121
    skysink.compare(ROOT / "scenarios" / "smoke.toml", ["gfs", "uts"], seeds=2, progress=lambda *done: said.append(done))
    assert said[-5:] == [(done, 4) for done in range(5)]

    def fail(_done: int, _of: int) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        skysink.sweep(file, tmp_path / "failed", progress=fail)
    assert len(skysink.sweep(file, tmp_path / "failed")) == 120  # continues


def test_a_bar_is_shown_on_a_terminal_alone(file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    skysink.sweep(file, tmp_path / "silent")
    assert capfd.readouterr() == ("", "")
    skysink.sweep(file, tmp_path / "shown", progress=True)
    shown = capfd.readouterr()
    lines = shown.err.splitlines()
    assert shown.out == "" and "\r" not in shown.err and "\x1b" not in shown.err
    assert len(lines) == 10 and " of 120 missions, " in lines[4] and 60 <= int(lines[4].split()[0]) < 72 and lines[-1] == "120 of 120 missions"
    assert b"\r[####################] 4 of 4 missions" in on_terminal("", "xterm")
    assert b"\x1b" not in on_terminal("", "xterm")


@pytest.mark.parametrize("term", ["dumb", "unknown", "", None])
def test_a_terminal_that_does_not_redraw_gets_no_bar(term: str | None) -> None:
    assert on_terminal("", term) == b""
    lines = on_terminal(", progress=True", term)
    assert lines.endswith(b"4 of 4 missions\r\n") and b"\x1b" not in lines and b"[#" not in lines
    assert lines.count(b"\r") == lines.count(b"\n") == 4, "those of the ends of lines"


def on_terminal(arguments: str, term: str | None) -> bytes:
    """What a comparison of four missions writes to a terminal as its standard error."""
    terminal, other = os.openpty()
    smoke = str(ROOT / "scenarios" / "smoke.toml")
    code = f"import skysink; skysink.compare({smoke!r}, ['gfs', 'uts'], seeds=2{arguments})"
    variables = {name: value for name, value in os.environ.items() if name != "TERM"} | ({} if term is None else {"TERM": term})
    subprocess.run([sys.executable, "-P", "-c", code], stderr=other, env=variables, check=True)
    os.set_blocking(terminal, False)
    try:
        return os.read(terminal, 100_000)
    except BlockingIOError:
        return b""
    finally:
        os.close(other)
        os.close(terminal)
