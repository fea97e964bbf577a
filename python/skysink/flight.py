"""Missions in this process: one, or several strategies over the same fields."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from os import PathLike
from typing import Any

from skysink import _skysink
from skysink._skysink import Run, Scenario
from skysink.strategy import Outside, Strategy, make, named
from skysink.sweeps import fly_all


def scenario_of(scenario: Scenario | str | PathLike[str]) -> Scenario:
    """The scenario, or that of a file."""
    return scenario if isinstance(scenario, Scenario) else Scenario.load(scenario)


def simulate(
    scenario: Scenario | str | PathLike[str],
    strategy: Strategy | type[Strategy] | str | None = None,
    *,
    seed: int | None = None,
    label: str | None = None,
) -> Run:
    """Flies a mission in this process and returns it.

    ``strategy`` is the name of one of Skysink's (:data:`skysink.STRATEGIES`), one in Python, or
    ``"python:FILE:CLASS"``; by default the scenario's. ``seed`` replaces the scenario's. ``label`` names a strategy in
    Python in the results; by default its class does. The interpreter is released while a strategy of Skysink flies.

    Raises :class:`skysink.InputError` for bad input. What a strategy in Python raises comes through, with a note of
    the slot.
    """
    flown = None if strategy is None else make(strategy)
    return _skysink.simulate(scenario_of(scenario), flown, seed=seed, label=label)


def compare(
    scenario: Scenario | str | PathLike[str],
    strategies: Sequence[str | type[Strategy] | Callable[[], Strategy]],
    *,
    seeds: int | Sequence[int] = 20,
    executor: Executor | Any | None = None,
) -> list[dict[str, Any]]:
    """How strategies stand over the same fields: an entry for each strategy and metric.

    ``seeds`` is how many missions each flies, from the scenario's seed on, or a list of seeds. An entry has ``label``,
    ``metric`` (as in ``docs/metrics.md``), ``n``, ``mean``, ``ci95`` (limits of the 95 % confidence interval), and
    ``difference`` and ``difference_ci95`` from the first strategy, paired by seed. ``pandas.DataFrame`` takes the list
    as it is. ``executor`` as in :func:`skysink.sweep`.
    """
    base = scenario_of(scenario)
    found = [named(strategy) for strategy in strategies]
    outside = [strategy for strategy in found if isinstance(strategy, Outside)]
    names = [strategy if isinstance(strategy, str) else strategy.name for strategy in found]
    chosen = list(range(base.seed, base.seed + seeds)) if isinstance(seeds, int) else list(seeds)
    versions = [(strategy.name, strategy.version) for strategy in outside]
    plan = _skysink.SweepPlan.compare(base, names, chosen, versions)
    makers = {strategy.name: strategy.make for strategy in outside}
    rows = list(fly_all(plan, makers, plan.missions, (base, names, chosen, strategies), executor))
    standings: list[dict[str, Any]] = plan.standings(rows)
    return standings
