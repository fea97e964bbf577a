"""A channel of one's own."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skysink
from skysink.environment import DataCollectionEnv

NARROW = skysink.Scenario.letter().replace(
    {"slots": 60, "sensors.count": 40, "area.side_m": 120.0, "sensors.sampling_bps": 500.0, "link.bandwidth_hz": 3e3}
)


class FreeSpace(skysink.Channel):
    """The paper's link with the gain of -52.5 dB, as the built-in model has it."""

    distances_m = np.linspace(0.0, 10.0, 200)
    probabilities = (0.5,)

    def rate_bps(self, distance_m: Any, altitude_m: Any, u: Any) -> Any:
        snr = 10**-5.25 * 0.05 / (1e-13 * (distance_m**2 + altitude_m**2))
        return 3e3 * np.log2(1.0 + snr) + 0.0 * u


class Shadowed(skysink.Channel):
    """Half the time there is no link."""

    def rate_bps(self, distance_m: Any, altitude_m: Any, u: Any) -> Any:
        return np.where(u < 0.5, 0.0, 6e4) + 0.0 * distance_m + 0.0 * altitude_m


def test_a_table_of_the_built_in_channel_gives_the_same_mission() -> None:
    built_in = NARROW.replace({"link.gain_db": -52.5})
    for strategy in ("uts-wide", "tour", "horizon"):
        own, same = skysink.simulate(NARROW, strategy, channel=FreeSpace), skysink.simulate(built_in, strategy)
        assert own.loss_rate == pytest.approx(same.loss_rate, abs=0.005)


def test_a_shadowed_channel_delivers_less() -> None:
    run = skysink.simulate(NARROW, "tour", channel=Shadowed)
    delivered = np.asarray(run.slots["delivered_bits"])
    steady = np.asarray(skysink.simulate(NARROW, "tour").slots["delivered_bits"])
    assert 0.3 * steady.sum() < delivered.sum() < steady.sum()


def test_a_saved_run_flies_again_without_python(tmp_path: Path) -> None:
    run = skysink.simulate(NARROW, "uts", seed=4, channel=Shadowed)
    run.save(tmp_path / "run")
    assert (tmp_path / "run" / "channel.csv").is_file()
    again = skysink.simulate(tmp_path / "run" / "scenario.toml")
    assert np.array_equal(run.queues, again.queues)
    copied = pickle.loads(pickle.dumps(run.scenario))
    assert copied == run.scenario
    assert np.array_equal(skysink.simulate(copied).queues, run.queues)


def test_comparisons_and_environments_use_the_channel() -> None:
    entries = skysink.compare(NARROW, ["uts", "tour"], seeds=2, channel=Shadowed)
    by_seed = [skysink.simulate(NARROW, "tour", seed=seed, channel=Shadowed).loss_rate for seed in (1, 2)]
    assert [entry["mean"] for entry in entries if (entry["label"], entry["metric"]) == ("tour", "loss_rate")] == [
        pytest.approx(np.mean(by_seed), rel=1e-12)
    ]
    env = DataCollectionEnv(NARROW, fields=1, channel=Shadowed, reward="loss_fraction")
    half = flown(env)
    assert flown(env) == half
    assert flown(DataCollectionEnv(NARROW, fields=1, reward="loss_fraction")) > half


def flown(env: DataCollectionEnv) -> float:
    """The rewards of a flight to and fro."""
    env.reset()
    actions = [np.array([(-1) ** (slot // 8), (-1) ** (slot // 16)], np.float32) for slot in range(60)]
    return sum(env.step(action)[1] for action in actions)


def test_a_replaced_file_key_reads_the_new_file(tmp_path: Path) -> None:
    held = skysink.simulate(NARROW, "tour", channel=Shadowed).scenario
    assert held.replace({"seed": 2})["link.file"] == "channel.csv"
    table = tmp_path / "none.csv"
    table.write_text("distance_m,altitude_m,probability,rate_bps\n0,20,0.5,0\n")
    assert np.sum(skysink.simulate(held.replace({"link.file": str(table)}), "tour").slots["delivered_bits"]) == 0
    with pytest.raises(skysink.InputError, match="missing.csv"):
        held.replace({"link.file": str(tmp_path / "missing.csv")})


@pytest.mark.parametrize(
    ("rate", "message"),
    [
        (lambda u: 1.0 - u, "do not fall with the probability"),
        (lambda u: u - 1.0, "expected a rate from 0 to 1e300"),
        (lambda u: u * np.nan, "expected a rate from 0 to 1e300"),
        (lambda u: np.zeros(3), "expected \\(33, 1, 33\\)"),
    ],
)
def test_impossible_rates_are_refused(rate: Any, message: str) -> None:
    class Bad(skysink.Channel):
        def rate_bps(self, distance_m: Any, altitude_m: Any, u: Any) -> Any:
            return rate(u)

    with pytest.raises(skysink.InputError, match=message):
        skysink.simulate(NARROW, "gfs", channel=Bad)
    with pytest.raises(skysink.InputError, match="expected"):
        skysink.simulate(NARROW, "gfs", channel=3)  # type: ignore[arg-type]


def test_links_by_place_are_those_of_their_map(tmp_path: Path) -> None:
    (tmp_path / "rates.csv").write_text("snr_db,rate_bps\n0,20000\n10,60000\n")
    rows = [f",{x},{y},20,{12 - abs(x - 60) / 6}" for x in (0, 60, 120) for y in (0, 120)]
    (tmp_path / "links.csv").write_text("\n".join(["sensor,x_m,y_m,z_m,snr_db", *rows, ""]))
    keys = {"link.file": str(tmp_path / "links.csv"), "link.rates": str(tmp_path / "rates.csv")}
    mapped = NARROW.replace({"link.model": "map", **keys, "link.residual_db": 2.0})
    run = skysink.simulate(mapped, "horizon")
    run.save(tmp_path / "run")
    assert 0 < np.asarray(run.slots["delivered_bits"]).max() <= 4 * 6_000
    again = skysink.simulate(tmp_path / "run" / "scenario.toml")
    assert np.array_equal(run.queues, again.queues)
    assert np.array_equal(skysink.simulate(pickle.loads(pickle.dumps(mapped)), "horizon").queues, run.queues)
    assert mapped.field().route((0.0, 0.0), 3) is not None


def test_a_strategy_sees_the_links_that_are_heard() -> None:
    stays = {"link.model": "probabilistic-los", "link.los_correlation_m": 30.0}
    hearing = skysink.Scenario.letter().replace({"slots": 20, **stays, "link.beacon_radius_m": 25.0})
    heard = []

    class Listens(skysink.Strategy):
        def plan(self, view: skysink.View) -> skysink.Decision:
            if view.links is None:
                return skysink.Decision(waypoint=(50.0, 50.0))
            distances_m = np.linalg.norm(view.field.positions_m - view.uav[:2], axis=1)
            assert view.links.dtype == np.float32 and not view.links.flags.writeable
            assert np.array_equal(np.isfinite(view.links), distances_m <= 25.0)
            heard.append(view.links)
            return skysink.Decision(waypoint=view.uav[:2] + (1.0, 0.5))

    skysink.simulate(hearing, Listens)
    assert len(heard) == 20
    nearest = [np.nanmax(links) - np.nanmin(links) for links in heard]
    assert max(nearest) > 10.0  # some are in sight, and some are not
    skysink.simulate(skysink.Scenario.letter().replace({"slots": 20, **stays}), Listens)
    assert len(heard) == 20
