"""Simulates missions in this process, and compares strategies over the same fields."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from os import PathLike
from typing import Any

from skysink import _skysink
from skysink._skysink import Run, Scenario
from skysink.strategy import PythonStrategy, Strategy, labelled, make, named
from skysink.sweeps import ComparisonSource, fly_all, load


def scenario_of(scenario: Scenario | str | PathLike[str]) -> Scenario:
    """Returns the scenario, or loads it from a file."""
    return scenario if isinstance(scenario, Scenario) else Scenario.load(scenario)


def simulate(
    scenario: Scenario | str | PathLike[str],
    strategy: Strategy | type[Strategy] | str | None = None,
    *,
    seed: int | None = None,
    label: str | None = None,
) -> Run:
    """Simulates a mission in this process and returns it.

    ``strategy`` is the name of a built-in strategy (:data:`skysink.STRATEGIES`), a Python strategy, or
    ``"python:FILE:CLASS"``; by default the scenario's. ``seed`` overrides the scenario's. ``label`` is the name of a
    Python strategy in the results, by default that of its class. Built-in strategies release the interpreter lock.

    Raises :class:`skysink.InputError` for bad input. Exceptions of a Python strategy are propagated with a note that
    names the slot.
    """
    flown = None if strategy is None else make(strategy)
    return _skysink.simulate(scenario_of(scenario), flown, seed=seed, label=label)


def compare(
    scenario: Scenario | str | PathLike[str],
    strategies: Sequence[str | type[Strategy] | Callable[[], Strategy]] | Mapping[str, Callable[[], Strategy] | str],
    *,
    seeds: int | Sequence[int] = 20,
    executor: Executor | Any | None = None,
) -> list[dict[str, Any]]:
    """Compares strategies over the same fields. Returns an entry per strategy and metric.

    A mapping labels the strategies and may contain factories: ``{"uts": "uts", "near": lambda: Mine(2.0)}``.

    ``seeds`` is the number of missions per strategy, with consecutive seeds starting at the scenario's, or a list of
    seeds. An entry has ``label``, ``metric`` (as in ``docs/src/metrics.md``), ``n``, ``mean``, ``ci95`` (limits of the
    95 % confidence interval), and ``difference`` and ``difference_ci95`` relative to the first strategy, paired by
    seed. ``pandas.DataFrame`` accepts the list. ``executor`` as in :func:`skysink.sweep`.
    """
    base = scenario_of(scenario)
    if isinstance(strategies, Mapping):
        found = [labelled(label, strategy) for label, strategy in strategies.items()]
    else:
        found = [named(strategy) for strategy in strategies]
    in_python = [strategy for strategy in found if isinstance(strategy, PythonStrategy)]
    chosen = [int(seed) for seed in seeds] if isinstance(seeds, Sequence) else range(base.seed, base.seed + int(seeds))
    source = ComparisonSource(
        scenario=base,
        names=tuple(strategy if isinstance(strategy, str) else strategy.name for strategy in found),
        seeds=tuple(chosen),
        versions=tuple((strategy.name, strategy.version) for strategy in in_python),
        specs=tuple((strategy.name, strategy.spec) for strategy in in_python),
    )
    plan, makers = load(source)
    standings: list[dict[str, Any]] = plan.standings(list(fly_all(plan, makers, plan.missions, source, executor)))
    return standings
