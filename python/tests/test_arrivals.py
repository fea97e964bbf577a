"""Arrivals of one's own."""

from __future__ import annotations

import copy
import functools
import pickle
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skysink
from skysink.models import version

SMALL = skysink.Scenario.letter().replace({"slots": 40, "sensors.count": 30, "sensors.sampling_bps": [100.0, 900.0]})


class Bursts(skysink.Arrivals):
    """All SNs sample five slots' worth in every fifth slot, with a random beginning."""

    dispersion_bits = 1000.0

    def __init__(self) -> None:
        self.phase: int | None = None

    def bits(self, slot: int, mean_bits: Any, random: np.random.Generator) -> Any:
        if self.phase is None:
            self.phase = int(random.integers(5))
        return np.floor(mean_bits * 5) * (slot % 5 == self.phase)


class Constant(skysink.Arrivals):
    """What the built-in model samples."""

    def bits(self, slot: int, mean_bits: Any, random: np.random.Generator) -> Any:
        return np.floor(mean_bits * slot + 1e-9) - np.floor(mean_bits * (slot - 1) + 1e-9)


@pytest.mark.parametrize("strategy", ["uts", "gfs", "edf"])
def test_arrivals_equal_to_the_built_in_ones_give_the_same_loss(strategy: str) -> None:
    for seed in (1, 2):
        own = skysink.simulate(SMALL, strategy, seed=seed, arrivals=Constant)
        built_in = skysink.simulate(SMALL, strategy, seed=seed)
        assert np.array_equal(own.queues, built_in.queues)


def test_objects_are_copied_and_classes_instantiated_per_mission() -> None:
    held = Bursts()
    runs = [skysink.simulate(SMALL, "gfs", seed=3, arrivals=model) for model in (Bursts, held, held, lambda: Bursts())]
    assert held.phase is None
    assert all(np.array_equal(run.queues, runs[0].queues) for run in runs)
    other = skysink.simulate(SMALL, "gfs", arrivals=Bursts)
    assert not np.array_equal(other.queues, runs[0].queues)


def test_the_planner_knows_the_dispersion_but_not_the_draws() -> None:
    run = skysink.simulate(SMALL, "gfs", arrivals=Bursts)
    assert run.scenario["sensors.arrivals.dispersion_bits"] == 1000.0
    assert run.scenario["sensors.arrivals.model"] == "trace"


def test_a_saved_run_flies_again_without_python(tmp_path: Path) -> None:
    run = skysink.simulate(SMALL, "uts", arrivals=Bursts)
    run.save(tmp_path / "run")
    assert (tmp_path / "run" / "arrivals.csv").is_file()
    again = skysink.simulate(tmp_path / "run" / "scenario.toml")
    assert np.array_equal(run.queues, again.queues)
    copied = pickle.loads(pickle.dumps(run.scenario))
    assert copied == run.scenario
    assert np.array_equal(skysink.simulate(copied).queues, run.queues)


def plain(entries: Any) -> list[Any]:
    """Without metrics of time."""
    return [entry for entry in entries if not entry["metric"].startswith("plan_")]


def test_comparisons_and_sweeps_draw_arrivals_per_seed(tmp_path: Path) -> None:
    entries = skysink.compare(SMALL, ["uts", "gfs"], seeds=3, arrivals=Bursts)
    by_seed = [skysink.simulate(SMALL, "gfs", seed=seed, arrivals=Bursts).loss_rate for seed in (1, 2, 3)]
    assert [entry["mean"] for entry in entries if (entry["label"], entry["metric"]) == ("gfs", "loss_rate")] == [
        pytest.approx(np.mean(by_seed), rel=1e-12)
    ]
    with ProcessPoolExecutor(1) as pool:
        elsewhere = skysink.compare(SMALL, ["uts", "gfs"], seeds=3, arrivals=Bursts, executor=pool)
    assert plain(elsewhere) == plain(entries)
    (tmp_path / "base.toml").write_text("name = 'x'\n[sensors]\ncount = 30\nsampling_bps = 500.0\n")
    sweep = tmp_path / "sweep.toml"
    sweep.write_text("scenario = 'base.toml'\nstrategies = ['gfs']\nseeds = 2\n[axes]\nslots = [20, 40]\n")
    flown = skysink.sweep(sweep, tmp_path / "out", arrivals=Bursts)
    assert len(set(flown["delivered_bits"].tolist())) == 4
    again = skysink.sweep(tmp_path / "out", tmp_path / "again", arrivals=Bursts)
    assert again["delivered_bits"].tolist() == flown["delivered_bits"].tolist()
    with pytest.raises(skysink.InputError, match="it was flown with arrivals in Python"):
        skysink.sweep(tmp_path / "out", tmp_path / "other")
    with pytest.raises(skysink.InputError, match="other arrivals|expected the same"):
        skysink.sweep(tmp_path / "out", tmp_path / "other", arrivals=Constant)


@pytest.mark.parametrize(
    ("bits", "message"),
    [
        (lambda mean_bits: mean_bits[:-1], "in slot 1 of shape"),
        (lambda mean_bits: mean_bits * 0 - 1, "of SN 0: -1.0: expected whole bits"),
        (lambda mean_bits: mean_bits * 0 + 0.5, "of SN 0: 0.5: expected whole bits"),
        (lambda mean_bits: mean_bits * np.nan, "of SN 0: nan: expected whole bits"),
        (lambda mean_bits: mean_bits * 0 + 2.0**32, "expected whole bits below"),
    ],
)
def test_impossible_bits_are_refused(bits: Any, message: str) -> None:
    class Bad(skysink.Arrivals):
        def bits(self, slot: int, mean_bits: Any, random: np.random.Generator) -> Any:
            return bits(mean_bits)

    with pytest.raises(skysink.InputError, match=message):
        skysink.simulate(SMALL, "gfs", arrivals=Bad)


def test_another_kind_of_object_is_refused() -> None:
    others: list[Any] = [3, "poisson", lambda: 3]
    for model in others:
        with pytest.raises(skysink.InputError, match="expected"):
            skysink.simulate(SMALL, "gfs", arrivals=model)


class Held(skysink.Arrivals):
    """As many bits as it holds."""

    def __init__(self, held: Any = 1) -> None:
        self.held = held

    def bits(self, slot: int, mean_bits: Any, random: Any) -> Any:
        return np.full(len(mean_bits), int(np.sum(self.held)))


def test_models_with_different_attributes_have_different_versions() -> None:
    def maker(held: int) -> Any:
        return lambda: Held(held)

    changed = np.zeros(5000)
    changed[2000] = 9
    pairs: list[tuple[Any, Any]] = [
        (Held(1), Held(2)),
        (functools.partial(Held, held=1), functools.partial(Held, held=2)),
        (maker(1), maker(2)),
        (Held(np.zeros(5000)), Held(changed)),
    ]
    for one, other in pairs:
        assert version(one) != version(other)
    for same in (Held, Held(3), functools.partial(Held, held=1), maker(1)):
        assert version(same) == version(copy.deepcopy(same) if isinstance(same, Held) else same)
