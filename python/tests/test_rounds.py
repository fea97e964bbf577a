"""Rounds over disks."""

from __future__ import annotations

import signal
import threading
import time
from typing import Any

import numpy as np
import pytest
import skysink

RANDOM = np.random.default_rng(1)
POSITIONS = RANDOM.uniform(0.0, 500.0, (40, 2))


def test_a_round_touches_all_disks_and_respects_its_bound() -> None:
    for start, closed in (((250.0, 250.0), True), ((0.0, 0.0), False), (None, True)):
        found = skysink.round_over_disks(POSITIONS, 15.0, start, closed=closed, steps=500)
        points = found.points_m
        legs = list(zip(points, np.roll(points, -1, axis=0), strict=True))
        legs = legs if closed else legs[:-1]
        length = sum(np.linalg.norm(to - begin) for begin, to in legs)
        assert found.length_m == pytest.approx(length, rel=1e-12)
        for centre in POSITIONS:
            assert min(distance(centre, begin, to) for begin, to in legs) <= 15.0
        assert 0.5 * found.length_m < found.bound_m <= found.length_m
        assert len(points) == len(found.order) + (start is not None)
        if start is not None:
            assert tuple(points[0]) == start
        assert np.all(np.linalg.norm(points[-len(found.order) :] - POSITIONS[found.order], axis=1) <= 15.0)


def distance(point: Any, begin: Any, to: Any) -> float:
    along = to - begin
    fraction = np.clip((point - begin) @ along / max(along @ along, 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(begin + fraction * along - point))


def test_equal_steps_give_equal_rounds_and_few_disks_are_solved() -> None:
    one, other = (skysink.round_over_disks(POSITIONS, 15.0, steps=300) for _ in range(2))
    assert np.array_equal(one.points_m, other.points_m) and one.bound_m == other.bound_m
    square = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]])
    found = skysink.round_over_disks(square, 10.0, seconds=0.05)
    assert found.length_m == pytest.approx(4.0 * (50.0 - 10.0 * np.sqrt(2.0)), rel=1e-6)
    assert found.bound_m == pytest.approx(found.length_m, rel=1e-5)
    assert repr(found).startswith("DiskRound(4 points, 143.43")
    with pytest.raises(ValueError, match="read-only"):
        found.points_m[0] = 0.0


def test_zero_and_one_disk_have_a_round() -> None:
    assert skysink.round_over_disks(np.empty((0, 2)), 5.0, steps=10).length_m == 0.0
    assert skysink.round_over_disks(np.array([[30.0, 40.0]]), 5.0, (0.0, 0.0), steps=10).length_m == pytest.approx(90.0, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"positions_m": np.zeros((3, 3))}, r"shape \(3, 3\): expected \(N, 2\)"),
        ({"positions_m": np.array([[0.0, np.nan]])}, "expected metres"),
        ({"start_m": (np.inf, 0.0)}, "expected metres"),
        ({"radius_m": -1.0}, "radius_m = -1: expected 0 to 1e9"),
        ({"seconds": 1.0, "steps": 5}, "expected one of them"),
        ({"seconds": -1.0}, "seconds = -1: expected 0 to 1e6"),
    ],
)
def test_invalid_rounds_are_refused(arguments: dict[str, Any], message: str) -> None:
    settings: dict[str, Any] = {"positions_m": POSITIONS, "radius_m": 5.0} | arguments
    with pytest.raises(skysink.InputError, match=message):
        skysink.round_over_disks(**settings)


def test_ctrl_c_ends_a_long_search() -> None:
    begin = time.monotonic()
    threading.Timer(0.3, lambda: signal.raise_signal(signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        skysink.round_over_disks(POSITIONS, 15.0, seconds=600.0)
    assert time.monotonic() - begin < 30.0
