"""Runs a program in Python as the planner, or as the vehicle, of a ring.

``skysink run SCENARIO --planner "python3 mine.py"`` starts a program that ends with ``skysink.ring.planner(Mine)``, and
``--vehicle "python3 mine.py"`` one that ends with ``skysink.ring.vehicle(Mine())``; ``--external planner`` and ``--external
flight-sim`` wait for one that you start, with the folder and the scenario that they print.
"""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skysink._skysink import Field, InputError, fly_ring, plan_ring
from skysink.strategy import Strategy, maker

REACHED_M = 2.0
"""A slot ends at the waypoint if it ends this near to it [m]."""

Point = Sequence[float] | NDArray[np.float64]


@dataclass(frozen=True)
class Order:
    """What a vehicle is to do in a slot."""

    slot: int
    """The slot, from 1."""
    uav: int
    """The number of the UAV, from 0."""
    position: NDArray[np.float64]
    """Where it was at the end of the slot before [m], [3]."""
    waypoint: NDArray[np.float64]
    """Where it is to be at the end of the slot [m], [3]; ``position`` if it is to stay."""
    serve: list[int]
    """Ids of the SNs to serve from there."""
    mode: str
    """The mode of the plan, such as ``"serve"``, ``"transit"``, ``"return"``, ``"charge"``, ``"hold"``."""
    is_late: bool
    """Whether there was no plan in time: it is to stay."""
    is_refused: bool
    """Whether the plan must not be followed, because it leads out of reach, of the area, or into a zone: it is to stay."""
    ends_at: float
    """When the slot ends in a paced run [s], on the clock of ``time.monotonic``; without a pace infinity."""


@dataclass(frozen=True)
class Flown:
    """Where a vehicle is at the end of a slot, and what else it knows."""

    position: Point
    """Position [m]; without z, the altitude is kept."""
    velocity_mps: Point = (0.0, 0.0, 0.0)
    """Velocity, east, north, up [m/s]."""
    heading_deg: float = math.inf
    """Heading, clockwise from north [deg]; infinite if it is not known."""
    covariance_m2: Point = (0.0,) * 6
    """Covariance of the position, xx, xy, xz, yy, yz, zz [m²]."""
    energy_j: float = math.inf
    """Energy in the battery [J]; infinite for that of the model."""
    time_s: float | None = None
    """When it was there [s], from the start of slot 1, by its own clock; None for the end of the slot."""
    is_down: bool = False
    """Whether it cannot fly any more."""
    bits: Mapping[int, int] | None = None
    """Bits that real SNs have delivered in the slot, by id; None for what the scenario's channel carries to those in range. They
    do not count in a slot in which the UAV holds, charges or is down."""


class Vehicle(ABC):
    """A vehicle of your own, which :func:`skysink.ring.vehicle` flies in a ring."""

    def begin(self, field: Field, starts: NDArray[np.float64]) -> None:
        """Called once, before the first slot, or after a restart where the UAVs are: the constant data of the mission, and a
        position for each UAV [m], [U, 3]."""

    @abstractmethod
    def fly(self, order: Order) -> Flown | Point:
        """Flies a slot, and returns where the vehicle is at its end. Called for one UAV after the other.

        A simulated vehicle returns at once. A real one returns shortly before ``order.ends_at``, so that there is time to plan."""


def planner(
    strategy: Strategy | Callable[[], Strategy] | str,
    ring: str | PathLike[str] | None = None,
    scenario: str | PathLike[str] | None = None,
) -> None:
    """Plans for a running ring until its mission ends, as the planner of Skysink does: by the same rules and checks.

    ``strategy`` is a class, an object, or ``"python:FILE:CLASS"``; a class makes an object for each UAV. ``ring`` is the
    ring folder and ``scenario`` the scenario file that ``skysink run`` prints, by default the environment variables
    ``SKYSINK_RING`` and ``SKYSINK_SCENARIO``, which ``skysink run --planner`` sets. In a paced ring, only the newest queues
    are planned for. After a restart, a stateless strategy simply continues; one with state is restored by ``save`` and
    ``restore``.

    Raises :class:`skysink.InputError` if the ring does not exist, and the exceptions of the strategy with a note that names
    the slot. SIGINT and SIGTERM end the program with the exit codes 130 and 143.
    """
    found = strategy if isinstance(strategy, Strategy) else maker(strategy)
    _end(plan_ring(found, *_places(ring, scenario, "--planner")))


def vehicle(
    flown_by: Vehicle,
    ring: str | PathLike[str] | None = None,
    scenario: str | PathLike[str] | None = None,
    reached_m: float = REACHED_M,
) -> None:
    """Flies the plans of a running ring until its mission ends, in the place of flight-sim.

    ``ring`` and ``scenario`` as in :func:`skysink.ring.planner`; ``skysink run --vehicle`` sets the environment variables.
    The plans are checked as flight-sim does, the scenario's channel is drawn above where the vehicle is, and the report is
    filled in. A slot that ends farther than ``reached_m`` [m] from its waypoint is ``en-route``: the next plan begins where
    the vehicle is. After a restart the last flights are sent again, and no slot is flown twice.

    Raises :class:`skysink.InputError` if the ring does not exist, and the exceptions of the vehicle. What the vehicle says
    and cannot be ends the program with one line and exit code 2, SIGINT and SIGTERM with 130 and 143.
    """
    _end(fly_ring(flown_by, *_places(ring, scenario, "--vehicle"), reached_m))


def _places(
    ring: str | PathLike[str] | None, scenario: str | PathLike[str] | None, option: str
) -> tuple[Path, Path]:
    """The folder of the ring and the scenario file: the given ones, or those that ``skysink run`` has set."""
    folder = ring if ring is not None else os.environ.get("SKYSINK_RING")
    file = scenario if scenario is not None else os.environ.get("SKYSINK_SCENARIO")
    if folder is None:
        raise InputError(f"ring: expected the folder of a running ring, or SKYSINK_RING from skysink run {option}")
    if file is None:
        raise InputError(f"scenario: expected the scenario file of the run, or SKYSINK_SCENARIO from skysink run {option}")
    return Path(folder), Path(file)


def _end(code: int) -> None:
    """Ends the program with an exit code that is not 0."""
    if code:
        raise SystemExit(code)


__all__ = ["Flown", "Order", "Vehicle", "planner", "vehicle"]
