"""Simulates missions in this process, and compares strategies over the same fields."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from os import PathLike
from typing import Any

from skysink import _skysink
from skysink._skysink import InputError, Run, Scenario, Table
from skysink.models import Arrivals, Channel, Model, Models
from skysink.strategy import PREFIX, PythonStrategy, Strategy, labelled, named
from skysink.sweeps import ComparisonSource, Progress, fly_all, load, told


class Comparison(list[dict[str, Any]]):
    """The result of :func:`skysink.compare`: a list with an entry per strategy and metric.

    ``missions`` is a table with a row per strategy and seed, with all metrics.
    """

    missions: Table

    @classmethod
    def of(cls, entries: list[dict[str, Any]], missions: Table) -> Comparison:
        """The comparison with these entries and missions."""
        comparison = cls(entries)
        comparison.missions = missions
        return comparison

    def to_latex(self, *metrics: str, intervals: bool = False) -> str:
        """A ``tabular`` for LaTeX with the package booktabs: a row for each strategy, and the means of these metrics, by
        default of ``loss_rate``; with their 95 % confidence intervals if ``intervals``.
        """
        columns = metrics or ("loss_rate",)
        found = {(entry["label"], entry["metric"]): entry for entry in self}
        if unknown := [name for name in columns if name not in {metric for _, metric in found}]:
            raise InputError(f"metric {unknown[0]!r}: expected one of the comparison, as in docs/src/metrics.md")

        def cell(entry: dict[str, Any] | None) -> str:
            if entry is None:
                return "--"
            limits = entry["ci95"] if intervals else None
            return f"{entry['mean']:.4g}" + (f" {{[}}{limits[0]:.4g}, {limits[1]:.4g}]" if limits else "")

        labels = list(dict.fromkeys(entry["label"] for entry in self))
        rows = [["strategy", *map(_skysink.latex, columns)]]
        rows += [[_skysink.latex(label), *(cell(found.get((label, name))) for name in columns)] for label in labels]
        head, *lines = [f"  {' & '.join(row)} \\\\\n" for row in rows]
        begin = f"\\begin{{tabular}}{{l{'r' * len(columns)}}}\n  \\toprule\n{head}  \\midrule\n"
        return begin + "".join(lines) + "  \\bottomrule\n\\end{tabular}\n"


def scenario_of(scenario: Scenario | str | PathLike[str]) -> Scenario:
    """Returns the scenario, or loads it from a file."""
    if isinstance(scenario, Scenario):
        return scenario
    if not isinstance(scenario, str | PathLike):
        raise InputError(f"scenario = {scenario!r}: expected a skysink.Scenario or the path of its file")
    return Scenario.load(scenario)


def simulate(
    scenario: Scenario | str | PathLike[str],
    strategy: Strategy | Callable[[], Strategy] | str | None = None,
    *,
    seed: int | None = None,
    label: str | None = None,
    arrivals: Model[Arrivals] | None = None,
    channel: Model[Channel] | None = None,
) -> Run:
    """Simulates a mission in this process and returns it.

    ``strategy`` is the name of a built-in strategy (:data:`skysink.STRATEGIES`), a Python strategy, as a class or for one
    UAV as an object, or ``"python:FILE:CLASS"``; by default the scenario's, whose FILE is relative to its folder. ``seed`` overrides the
    scenario's. ``label`` is the name of a Python strategy in the results, by default that of its class. ``arrivals``
    is what the SNs sample, a subclass of :class:`skysink.Arrivals`, ``channel`` the rates of their links, of
    :class:`skysink.Channel`. Built-in strategies release the interpreter lock.

    ``run.scenario`` names what flew, and :meth:`skysink.Run.save` writes the source of a Python strategy into the
    folder, as ``strategy.py``. The saved ``scenario.toml`` flies the same again, if the strategy was given as
    ``"python:FILE:CLASS"``; an object may have parameters that no file holds, so its mission is refused.

    Raises :class:`skysink.InputError` for bad input. Exceptions of a Python strategy are propagated with a note that
    names the slot. Warns with a ``RuntimeWarning`` of a mission that has held or refused more than 1 % of its slots
    (``docs/src/metrics.md``), as do ``compare`` and ``sweep``.
    """
    base = scenario_of(scenario)
    models = Models(arrivals, channel)
    if models:
        base = models.prepare(base if seed is None else base.replace({"seed": seed}))
    if strategy is None and base.strategy.startswith(PREFIX) and (base.path.parent / "run.toml").is_file():
        Run._check(base.path.parent)
    if strategy is None or isinstance(strategy, str):
        found = named(strategy or base.strategy, None if strategy else base.path.parent)
        if isinstance(found, str):
            return _skysink.simulate(base, found, seed=seed, label=label)
        return _skysink.simulate(base, found.make, seed=seed, label=label, origin=(str(found.spec), found.sources))
    return _skysink.simulate(base, strategy, seed=seed, label=label)


def compare(
    scenario: Scenario | str | PathLike[str],
    strategies: Sequence[str | type[Strategy] | Callable[[], Strategy]] | Mapping[str, Callable[[], Strategy] | str],
    *,
    seeds: int | Sequence[int] = 20,
    out: str | PathLike[str] | None = None,
    executor: Executor | Any | None = None,
    arrivals: Model[Arrivals] | None = None,
    channel: Model[Channel] | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Compares strategies over the same fields. Returns an entry per strategy and metric, and a row per mission.

    A mapping labels the strategies and may contain factories: ``{"uts": "uts", "near": lambda: Mine(2.0)}``.

    ``seeds`` is the number of missions per strategy, with consecutive seeds starting at the scenario's, or a list of
    seeds. An entry has ``label``, ``metric`` (as in ``docs/src/metrics.md``), ``n``, ``mean``, ``ci95`` (limits of the
    95 % confidence interval), and ``difference`` and ``difference_ci95`` relative to the first strategy, paired by
    seed. ``pandas.DataFrame`` accepts the list. Its attribute ``missions`` is a table with a row per strategy and seed.
    ``out`` is a folder as of ``skysink compare``: a comparison in it is resumed, or extended by seeds and strategies.
    It holds the scenario and the sources of Python strategies, which must be given as ``"python:FILE:CLASS"``.
    ``executor`` and ``progress`` as in :func:`skysink.sweep`, ``arrivals`` and ``channel`` as in :func:`skysink.simulate`,
    for each seed.
    """
    base = scenario_of(scenario)
    if isinstance(strategies, Mapping):
        found = [labelled(label, strategy) for label, strategy in strategies.items()]
    else:
        found = [named(strategy) for strategy in strategies]
    in_python = [strategy for strategy in found if isinstance(strategy, PythonStrategy)]
    unsaved = [strategy.name for strategy in in_python if not strategy.sources]
    if out is not None and unsaved:
        raise InputError(f"strategy {unsaved[0]}: expected {PREFIX}FILE:CLASS with out, so that the folder can hold it")
    chosen = [int(seed) for seed in seeds] if isinstance(seeds, Sequence) else range(base.seed, base.seed + int(seeds))
    source = ComparisonSource(
        scenario=base,
        names=tuple(strategy if isinstance(strategy, str) else strategy.name for strategy in found),
        seeds=tuple(chosen),
        external=tuple((strategy.name, strategy.version, strategy.sources) for strategy in in_python),
        specs=tuple((strategy.name, strategy.spec) for strategy in in_python),
        models=Models(arrivals, channel),
    )
    plan, makers = load(source)
    if out is None:
        flown = fly_all(plan, makers, plan.missions, source, executor)
        rows = list(told(flown, plan, plan.missions, progress))
        return Comparison.of(plan.standings(rows), plan.rows(rows))
    with closing(plan.open(out)) as record:
        for row in told(fly_all(plan, makers, record.missing, source, executor), plan, record.missing, progress):
            record.add(row)
        return Comparison.of(*plan.finish(record, out))
