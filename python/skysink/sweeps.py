"""Sweeps on any executor: threads, processes, Dask, MPI, Ray."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

from skysink._skysink import InputError, Scenario, SweepPlan, Table
from skysink.strategy import PREFIX, Outside, Strategy, named

Key = tuple[int, int, int]
"""A mission: point of the grid, index of the strategy, seed."""

Row = tuple[Key, list[float]]
"""A mission with its metrics."""

Readied = tuple[SweepPlan, dict[str, Callable[[], Strategy]]]
"""A sweep, and what makes its strategies in Python, by name."""

Source = str | tuple[Scenario, list[str], list[int], Sequence[Any]]
"""What a worker makes the same sweep of: a file, or scenario, names, seeds and strategies."""

MOST_AT_ONCE = 32
"""Most missions of one task."""

TASKS = 64
"""Tasks of a sweep that is not long: enough for its workers to end together."""


def sweep(
    file: str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    executor: Executor | Any | None = None,
    threads: int = 0,
) -> Table:
    """Flies a sweep file and returns its results, a row per mission; the folder has the bytes of ``skysink sweep``.

    ``out`` is the folder, by default ``runs/<file's name>``. Without an ``executor`` the missions are flown in this
    process, on ``threads`` threads (0: one per core); strategies in Python (``"python:FILE:CLASS"``, the file relative
    to the sweep file) on one. An ``executor`` is anything with ``submit(function, *arguments)`` that returns a
    ``concurrent.futures.Future``; its workers need this package and the same file system.

    Every mission is on record as soon as it arrives here: after an interruption, or when workers died and the executor
    gave up, the same call flies the rest. Raises :class:`skysink.InputError` for a bad file or folder.
    """
    path = Path(file).absolute()
    folder = Path("runs") / path.stem if out is None else Path(out)
    plan, outside = read(str(path))
    if executor is None and not outside:
        return plan.fly_all(folder, threads)
    record = plan.open(folder)
    try:
        for row in fly_all(plan, outside, record.missing, str(path), executor):
            record.add(row)
        return plan.finish(record)
    finally:
        record.close()


def read(path: str) -> Readied:
    """The sweep of a file, and what makes its strategies in Python, by name."""
    try:
        names = tomllib.loads(Path(path).read_text()).get("strategies", [])
    except (OSError, ValueError):
        names = []  # refused below, with the reason
    outside = [named(name, Path(path).parent) for name in names if isinstance(name, str) and name.startswith(PREFIX)]
    found = [strategy for strategy in outside if isinstance(strategy, Outside)]
    plan = SweepPlan.read(path, [(strategy.name, strategy.version) for strategy in found])
    return plan, {strategy.name: strategy.make for strategy in found}


def again(source: Source, identity: str) -> Readied:
    """The sweep of a source, which must have this identity: what it was where the task was made."""
    plan, outside = read(source) if isinstance(source, str) else of_scenario(*source)
    if plan.identity != identity:
        raise InputError(f"{source}: here it is another sweep, or another version of Skysink: expected the same")
    return plan, outside


again_from_file = lru_cache(maxsize=8)(again)


def of_scenario(scenario: Scenario, names: list[str], seeds: list[int], strategies: Sequence[Any]) -> Readied:
    """The sweep of strategies over the fields of a scenario."""
    found = [strategy for strategy in map(named, strategies) if isinstance(strategy, Outside)]
    plan = SweepPlan.compare(scenario, names, seeds, [(strategy.name, strategy.version) for strategy in found])
    return plan, {strategy.name: strategy.make for strategy in found}


def fly(source: Source, identity: str, missions: list[Key]) -> list[Row]:
    """Flies missions of a sweep: what an executor's workers do."""
    plan, outside = again_from_file(source, identity) if isinstance(source, str) else again(source, identity)
    return plan.fly(missions, outside)


def fly_all(
    plan: SweepPlan,
    outside: dict[str, Callable[[], Strategy]],
    missions: list[Key],
    source: Source,
    executor: Executor | Any | None,
) -> Iterator[Row]:
    """Flies missions, here or by an executor, and yields them as they are done, in any order."""
    size = max(1, min(MOST_AT_ONCE, len(missions) // TASKS))
    tasks = [missions[first : first + size] for first in range(0, len(missions), size)]
    if executor is None:
        for task in tasks:
            yield from plan.fly(task, outside)
        return
    futures: list[Future[list[Row]]] = [executor.submit(fly, source, plan.identity, task) for task in tasks]
    try:
        for future in as_completed(futures):
            yield from future.result()
    finally:
        for future in futures:
            future.cancel()


__all__ = ["Key", "Row", "sweep"]
