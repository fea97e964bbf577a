"""Links by place: from files, pickled, compared, and from arrays."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skysink

SMALL = skysink.Scenario.letter().replace({"slots": 40, "sensors.count": 3, "sensors.sampling_bps": 900.0})

RATES = [[0.0, 2e4], [5.0, 6e4], [10.0, 18e4]]

X_M: Any = np.arange(0.0, 101.0, 25.0)
Y_M: Any = np.array([0.0, 100.0])
Z_M: Any = np.array([20.0])


def levels() -> Any:
    """SNRs of three SNs that fall to the east, without a link in a corner of the last."""
    snr_db = np.broadcast_to(12.0 - X_M / 10.0, (3, 1, 2, 5)) + np.arange(3.0)[:, None, None, None]
    snr_db[2, 0, 1, 4] = np.nan
    return snr_db


def rows(snr_db: Any) -> str:
    """The same as the text of a file."""
    lines = ["sensor,x_m,y_m,z_m,snr_db"]
    for (sensor, z, y, x), level in np.ndenumerate(snr_db):
        lines.append(f"{sensor},{X_M[x]},{Y_M[y]},{Z_M[z]},{'' if np.isnan(level) else level}")
    return "\n".join(lines) + "\n"


@pytest.fixture
def mapped(tmp_path: Path) -> skysink.Scenario:
    """The mission with a map in files."""
    (tmp_path / "links.csv").write_text(rows(levels()))
    (tmp_path / "rates.csv").write_text("snr_db,rate_bps\n" + "".join(f"{snr},{bps}\n" for snr, bps in RATES))
    text = "name = 'letter'\nslots = 40\nsensors = { count = 3, sampling_bps = 900.0 }\n"
    text += "link = { model = 'map', file = 'links.csv', rates = 'rates.csv' }\n"
    (tmp_path / "base.toml").write_text(text)
    return skysink.Scenario.load(tmp_path / "base.toml")


def test_copies_need_no_files_and_other_maps_are_unequal(mapped: skysink.Scenario) -> None:
    folder = mapped.path.parent
    pickled = pickle.dumps(mapped)
    flown = skysink.simulate(mapped, "gfs").queues
    (folder / "links.csv").unlink()
    (folder / "rates.csv").unlink()
    for other in (pickle.loads(pickled), copy.deepcopy(mapped), mapped.replace({"seed": 2}).replace({"seed": 1})):
        assert other == mapped
        assert hash(other) == hash(mapped)
        assert np.array_equal(skysink.simulate(other, "gfs").queues, flown)
    weaker = mapped.with_links(X_M, Y_M, Z_M, levels() - 9.0, RATES)
    stronger = mapped.with_links(X_M, Y_M, Z_M, levels(), RATES)
    assert weaker.to_toml() == stronger.to_toml()
    assert weaker != stronger
    assert pickle.loads(pickle.dumps(weaker)) == weaker
    assert not np.array_equal(skysink.simulate(weaker, "gfs").queues, flown)


def test_arrays_are_the_map_of_a_file(mapped: skysink.Scenario, tmp_path: Path) -> None:
    flown = skysink.simulate(mapped, "gfs").queues
    held = SMALL.with_links(X_M, Y_M, Z_M, levels(), RATES)
    assert np.array_equal(skysink.simulate(held, "gfs").queues, flown)
    for save in (np.savez, np.savez_compressed):
        axes = {"x_m": X_M, "y_m": Y_M.astype(np.float32), "z_m": Z_M.astype(int)}
        save(mapped.path.parent / "links.npz", snr_db=levels(), **axes)
        read = mapped.replace({"link.file": "links.npz"})
        assert np.array_equal(skysink.simulate(read, "gfs").queues, flown)
    run = skysink.simulate(held, "gfs")
    run.save(tmp_path / "run")
    assert np.array_equal(skysink.simulate(tmp_path / "run" / "scenario.toml").queues, flown)
    # One map for all SNs, of rates.
    same = SMALL.with_links(X_M, Y_M, Z_M, np.full((1, 1, 2, 5), 5e4))
    assert same["link.model"] == "map"
    assert skysink.simulate(same, "gfs").slots["delivered_bits"].sum() > 0


def test_a_map_does_not_read_arrivals_that_are_given() -> None:
    held = SMALL.with_links(X_M, Y_M, Z_M, levels(), RATES)
    bits = np.full((40, 3), 700, np.uint32)
    bursty = held.with_arrivals(bits)
    other = SMALL.with_arrivals(bits).with_links(X_M, Y_M, Z_M, levels(), RATES)
    for scenario in (bursty, pickle.loads(pickle.dumps(bursty)), other):
        assert scenario == bursty
        assert np.array_equal(skysink.simulate(scenario, "gfs").queues, skysink.simulate(bursty, "gfs").queues)


def test_comparisons_and_fields_hold_maps() -> None:
    held = SMALL.with_links(X_M, Y_M, Z_M, levels(), RATES)
    entries = skysink.compare(held, ["gfs", "tour"], seeds=2)
    by_seed = [skysink.simulate(held, "tour", seed=seed).loss_rate for seed in (1, 2)]
    assert [entry["mean"] for entry in entries if (entry["label"], entry["metric"]) == ("tour", "loss_rate")] == [
        pytest.approx(np.mean(by_seed), rel=1e-12)
    ]
    field = pickle.loads(pickle.dumps(held.field()))
    assert np.array_equal(field.positions_m, held.field().positions_m)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"levels": np.zeros((2, 1, 2, 5))}, "no grid for SN 2"),
        ({"levels": np.zeros((4, 1, 2, 5))}, "sensor `3`: expected the name or the id of a sensor node"),
        ({"levels": np.zeros((3, 1, 5, 2))}, r"snr_db: shape \[3, 1, 5, 2\]: expected \[N, 1, 2, 5\], for z, y and x"),
        ({"levels": np.full((3, 1, 2, 5), np.inf)}, "snr_db = inf: expected -300 to 300 dB, or nan for no link"),
        ({"x_m": X_M[::-1]}, "x_m: expected finite numbers that ascend"),
        ({"rates": [[5.0, 1.0], [0.0, 2.0]]}, "snr_db = 0, rate_bps = 2: expected ascending steps"),
        ({"rates": []}, "expected a row for each step"),
    ],
)
def test_impossible_arrays_are_refused(changes: dict[str, Any], said: str) -> None:
    arguments = {"x_m": X_M, "y_m": Y_M, "z_m": Z_M, "levels": levels(), "rates": RATES} | changes
    with pytest.raises(skysink.InputError, match=said):
        SMALL.with_links(**arguments)
