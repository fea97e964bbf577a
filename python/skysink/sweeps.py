"""Sweeps on any executor: threads, processes, Dask, MPI, Ray."""

from __future__ import annotations

import json
import os
import sys
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from os import PathLike, cpu_count
from pathlib import Path
from typing import Any

from skysink._skysink import InputError, Scenario, SweepPlan, Table
from skysink.models import Arrivals, Channel, Model, Models
from skysink.strategy import MAIN, PREFIX, PythonStrategy, Sources, Strategy, maker, named

Key = tuple[int, int, int]
"""A mission: point of the grid, index of the strategy, seed."""

Row = tuple[Key, list[float]]
"""A mission with its metrics."""

Makers = dict[str, Callable[[], Strategy]]
"""Factories of Python strategies, by name."""

Progress = Callable[[int, int], object] | bool
"""What is called with the number of finished and of all missions, or whether to show a bar."""

MAX_MISSIONS_PER_TASK = 32

MAX_THREADS = 1024

TASKS = 64
"""Minimum number of tasks of a sweep, so that workers finish at about the same time."""


@dataclass(frozen=True)
class FileSource:
    """A sweep by its file or folder, which every worker reads."""

    path: str
    models: Models


@dataclass(frozen=True)
class ComparisonSource:
    """A comparison of strategies over one scenario, in a form that can be sent to workers."""

    scenario: Scenario
    names: tuple[str, ...]
    seeds: tuple[int, ...]
    external: tuple[tuple[str, str, Sources], ...]
    specs: tuple[tuple[str, str | Callable[[], Strategy]], ...]
    models: Models


Source = FileSource | ComparisonSource


def sweep(
    file: str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    executor: Executor | Any | None = None,
    threads: int = 0,
    arrivals: Model[Arrivals] | None = None,
    channel: Model[Channel] | None = None,
    progress: Progress | None = None,
) -> Table:
    """Runs a sweep file and returns its results, one row per mission. The folder equals that of ``skysink sweep``.

    ``file`` may be the folder of a sweep, which is repeated: its Python strategies are those saved there.

    ``out`` is the folder, by default ``runs/<name of the file>``, or the folder ``file``. Without an ``executor``,
    missions run in this process on ``threads`` threads (0: one per core); Python strategies (``"python:FILE:CLASS"``,
    the file relative to the sweep file) run one mission at a time. An ``executor`` is an object with
    ``submit(function, *arguments)`` that returns a ``concurrent.futures.Future``; its workers need this package and the
    same file system.

    ``arrivals`` and ``channel`` are models as in :func:`skysink.simulate`; a folder that was flown with them is extended
    or repeated with the same. ``progress`` is called with the number of finished and of all missions, or says whether to
    show a bar on standard error, by default where that is a terminal; lines where it is none, or one with ``TERM=dumb``.

    Every mission is written as soon as it is finished. After an interruption, or if workers died and the executor
    gave up, calling ``sweep`` again continues. More seeds, or more strategies behind those of the sweep in the folder,
    extend it. Raises :class:`skysink.InputError` for a bad file or folder.
    """
    if not 0 <= threads <= MAX_THREADS:
        raise InputError(f"threads = {threads}: expected 0 to {MAX_THREADS}")
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise InputError(f"executor {executor!r}: expected an object with submit, such as a ProcessPoolExecutor")
    path = Path(file).absolute()
    folder = Path(out) if out is not None else path if path.is_dir() else Path("runs") / path.stem
    source = FileSource(str(path), Models(arrivals, channel))
    plan, makers = load(source)
    if executor is None and not makers and not source.models:
        return plan.fly_all(folder, threads, teller(progress))
    with closing(plan.open(folder)) as record:
        for row in told(fly_all(plan, makers, record.missing, source, executor), plan, record.missing, progress):
            record.add(row)
        return plan.finish(record, None)[1]


class Bar:
    """A bar on standard error, with the time that is left, without escape sequences; a line for each tenth of the missions
    where no terminal draws over what it has shown.
    """

    def __init__(self) -> None:
        self.begin: tuple[float, int] | None = None
        self.shown = ""
        self.tenths = 0

    def __call__(self, done: int, count: int) -> None:
        """Draws the bar, or writes the line."""
        now = time.monotonic()
        begin_s, before = self.begin = self.begin or (now, done)
        left = f", {(now - begin_s) / (done - before) * (count - done):.0f} s left" if before < done < count else ""
        line = f"{done} of {count} missions{left}"
        if redraws():
            bar = f"[{'#' * (20 * done // max(count, 1)):<20}] {line}"
            print(f"\r{bar:<{len(self.shown)}}", end="\n" if done == count else "", file=sys.stderr, flush=True)
            self.shown = bar
            return
        tenths = 10 * done // max(count, 1)
        if tenths > self.tenths or done == count:
            self.tenths = tenths
            print(line, file=sys.stderr, flush=True)


def redraws() -> bool:
    """Whether standard error is a terminal that draws over what it has shown: those of Emacs and of some CI say by
    ``TERM=dumb`` that they do not.
    """
    return sys.stderr.isatty() and os.environ.get("TERM", "") not in ("", "dumb", "unknown")


def teller(progress: Progress | None) -> Callable[[int, int], object] | None:
    """What is told the progress, if anything."""
    if callable(progress):
        return progress
    return Bar() if progress or progress is None and redraws() else None


def told(rows: Iterable[Row], plan: SweepPlan, missing: Sequence[Key], progress: Progress | None) -> Iterator[Row]:
    """The same missions, which are told to ``progress``."""
    tell = teller(progress)
    if tell is None:
        yield from rows
        return
    count = len(plan.missions)
    before = count - len(missing)
    tell(before, count)
    for done, row in enumerate(rows, before + 1):
        yield row
        tell(done, count)


def load(source: Source) -> tuple[SweepPlan, Makers]:
    """Loads the sweep of a source. Raises :class:`skysink.InputError` if it is refused."""
    if isinstance(source, ComparisonSource):
        plan = SweepPlan.compare(source.scenario, source.names, source.seeds, source.external, source.models.versions)
        return plan, {name: maker(spec) for name, spec in source.specs}
    path = Path(source.path)
    try:
        held = json.loads((path / "sweep.json").read_text()) if path.is_dir() else tomllib.loads(path.read_text())
        names = [(index, name) for index, name in enumerate(held.get("strategies", [])) if isinstance(name, str)]
    except (OSError, ValueError, AttributeError):
        names = []  # refused below, with the reason
    in_python = {name: in_file(path, index, name) for index, name in names if name.startswith(PREFIX)}
    found = {name: strategy for name, strategy in in_python.items() if isinstance(strategy, PythonStrategy)}
    external = [(name, strategy.version, strategy.sources) for name, strategy in found.items()]
    return SweepPlan.read(source.path, external, source.models.versions), {name: strategy.make for name, strategy in found.items()}


def in_file(path: Path, index: int, name: str) -> str | PythonStrategy:
    """The Python strategy of this place and name in a sweep file, or in the folder of a sweep."""
    if path.is_dir():
        return named(f"{PREFIX}strategy-{index}/{MAIN}:{name.rpartition(':')[2]}", path)
    return named(name, path.parent)


@lru_cache(maxsize=8)
def load_once(source: FileSource, identity: str) -> tuple[SweepPlan, Makers]:
    """The sweep of a file, read once per worker and identity."""
    plan, makers = load(source)
    if plan.identity != identity:
        other = "a worker has another file or version of Skysink: expected the same"
        raise InputError(f"sweep {source.path}: {other}")
    return plan, makers


def fly(source: Source, identity: str, missions: list[Key]) -> list[Row]:
    """Runs missions of a sweep, in a worker of an executor."""
    plan, makers = load_once(source, identity) if isinstance(source, FileSource) else load(source)
    return plan.fly(missions, makers, prepare(source))


def prepare(source: Source) -> Callable[[Scenario], Scenario] | None:
    """What turns the scenario of a mission into the one that is flown; ``None`` if they are the same."""
    return source.models.prepare if source.models else None


def fly_all(
    plan: SweepPlan, makers: Makers, missions: list[Key], source: Source, executor: Executor | Any | None
) -> Iterator[Row]:
    """Runs missions, here or on an executor, and yields their results in any order."""
    if executor is None and (makers or source.models):
        for mission in missions:
            yield from plan.fly([mission], makers, prepare(source))
        return
    if executor is None:
        with ThreadPoolExecutor(cpu_count() or 1) as threads:
            yield from fly_all(plan, makers, missions, source, threads)
        return
    size = max(1, min(MAX_MISSIONS_PER_TASK, len(missions) // TASKS))
    tasks = [missions[first : first + size] for first in range(0, len(missions), size)]
    futures: list[Future[list[Row]]] = [executor.submit(fly, source, plan.identity, task) for task in tasks]
    if not all(isinstance(future, Future) for future in futures):
        raise InputError("executor: expected futures of concurrent.futures from submit (Dask: client.get_executor())")
    try:
        task_of = dict(zip(futures, tasks, strict=True))
        for future in as_completed(futures):
            rows = future.result()
            if sorted(key for key, _ in rows) != sorted(task_of[future]):
                raise InputError(f"executor: {len(rows)} missions of a task: expected the missions of that task")
            yield from rows
    finally:
        for future in futures:
            future.cancel()


__all__ = ["Key", "Row", "sweep"]
