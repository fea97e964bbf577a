"""Runs a program in Python as the planner, or as the vehicle, of a ring, over iceoryx2.

``skysink run SCENARIO --planner "python3 mine.py"`` starts a program that ends with ``skysink.ring.planner(Mine())``, and
``--vehicle "python3 mine.py"`` one that ends with ``skysink.ring.vehicle(Mine())``; ``--external planner`` and ``--external
flight-sim`` wait for one that you start, with the folder that they print.
"""

from __future__ import annotations

import base64
import ctypes
import sys
from collections.abc import Iterator
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skysink._skysink import Field, InputError, PlanMaker
from skysink.ring_topics import (
    END,
    FLIGHT,
    FlightReport,
    Participant,
    Plan,
    QueuesHeader,
    Saved,
    SensorNode,
    SensorsHeader,
    SlotHeader,
    iox2,
    possible_flight,
    possible_queues,
    possible_rates,
    ring_folder,
    view,
    words,
)
from skysink.ring_vehicle import Flown, Order, Vehicle, vehicle
from skysink.strategy import Strategy, make

__all__ = ["Flown", "Order", "Vehicle", "planner", "vehicle"]

SAVED_SLOTS = 4
"""Number of slots whose states are saved. A restarted planner plans the last two slots again."""


class Ring(Participant):
    """The topics of a ring that a planner reads and writes."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, "planner")
        sensors = self.topic("sensors", iox2.Slice[SensorNode], SensorsHeader)
        known_queues = "belief" if "belief" in self.terms else "queues"
        queues = self.topic(known_queues, iox2.Slice[ctypes.c_uint32], QueuesHeader)
        rates = None
        if self.terms.get("belief") == "learnt":
            rates = self.topic("rates", iox2.Slice[ctypes.c_double], SlotHeader)
        flights = self.topic("flight", iox2.Slice[FlightReport], SlotHeader)
        self.write(self.topic("plan", iox2.Slice[Plan], SlotHeader))
        self.sensors, self.queues = sensors.reader(), queues.reader()
        self.flights = flights.reader()
        self.rates = rates.reader() if rates else None
        self.listen(sensors, queues, flights, *([rates] if rates else []))
        self.count = 0
        self.positions: dict[int, tuple[float, float, float]] = {}
        self.learnt: tuple[int, NDArray[np.float64] | None] = (-1, None)

    def field(self) -> Field:
        """Waits for the sensor nodes and the limits."""
        limits, nodes = self.sensor_nodes(self.sensors)
        field = Field._from_messages(limits, nodes)
        self.count = len(field)
        return field

    def position(self, slot: int) -> tuple[float, float, float] | None:
        """Position of the UAV after ``slot`` [m]; None if the mission has advanced since."""
        while slot not in self.positions:
            while (sample := self.receive(self.flights, "flight", possible_flight)) is not None:
                x_m, y_m, z_m = view(sample, 1, FLIGHT)[0]["at_m"].tolist()
                self.positions[words(sample.user_header())[1]] = (x_m, y_m, z_m)
                sample.delete()
            if slot in self.positions:
                break
            if self.positions and min(self.positions) > slot:
                return None
            self.wait()
        for old in [earlier for earlier in self.positions if earlier < slot]:
            del self.positions[old]
        return self.positions[slot]

    def learnt_bps(self, slot: int) -> NDArray[np.float64] | None:
        """The rates learnt by the end of ``slot`` [bit/s], or in a paced ring the newest there are; None if known."""
        while self.rates is not None and self.learnt[0] < slot:
            is_possible = partial(possible_rates, count=self.count)
            sample = self.receive(self.rates, "rates", is_possible)
            if sample is None and self.is_paced and self.learnt[0] >= 0:
                break  # that of the slot did not fit into the buffer
            if sample is None:
                self.wait()
                continue
            learnt = view(sample, self.count, np.float64).copy()
            learnt.setflags(write=False)
            self.learnt = (words(sample.user_header())[1], learnt)
            sample.delete()
        return self.learnt[1]

    def next_queues(self) -> Any:
        """The next sample of the queues; None if there is none."""
        return self.receive(self.queues, "queues", partial(possible_queues, count=self.count))

    def states(self) -> Iterator[Any]:
        """Yields each sample of the queues once, up to that of the last slot.

        In a paced ring, yields only the newest, because a plan for a slot that has begun is ignored.
        """
        last = -1
        while True:
            while (sample := self.next_queues()) is not None:
                while self.is_paced and (newer := self.next_queues()) is not None:
                    sample.delete()
                    sample = newer
                _, slot, flags = words(sample.user_header())
                if flags & END:
                    return
                if slot > last:
                    last = slot
                    yield sample
                sample.delete()
            self.wait()


class States:
    """The saved states of a strategy for its last slots."""

    def __init__(self, folder: Path) -> None:
        self.saved = Saved(folder, "planner-state", SAVED_SLOTS, "planner")
        self.is_fresh = True

    def resume(self, slot: int, strategy: Strategy) -> None:
        """Restores a restarted strategy to its state before ``slot``, or to the latest saved one before that."""
        earlier = [saved for saved in self.saved.texts if saved <= slot]
        if self.is_fresh and earlier:
            if max(earlier) < slot:
                print(f"planner: plans slot {slot} with its state of slot {max(earlier)}", file=sys.stderr)
            strategy.restore(base64.b64decode(self.saved.texts[max(earlier)]))
        elif self.is_fresh and slot > 1:
            print(f"planner: begins at slot {slot} without a saved state", file=sys.stderr)
        self.is_fresh = False

    def save(self, slot: int, strategy: Strategy) -> None:
        """Saves the state of the strategy before ``slot``, if it has one."""
        state = strategy.save()
        if not isinstance(state, bytes):
            raise InputError(f"save() of the strategy returned {type(state).__name__}: expected bytes")
        if state:
            self.saved.save(slot, base64.b64encode(state).decode())


def planner(strategy: Strategy | type[Strategy], ring: str | PathLike[str] | None = None) -> None:
    """Plans for a running ring until its mission ends.

    ``ring`` is the ring folder that ``skysink run`` prints, by default the environment variable ``SKYSINK_RING``,
    which ``skysink run --planner`` sets. The queues are in shared memory, without a copy: do not store them
    beyond :meth:`skysink.Strategy.plan`. In a paced ring, only the newest queues are planned for. After a restart, a
    stateless strategy simply continues; one with state is restored by ``save`` and ``restore``.

    Raises :class:`skysink.InputError` if the ring does not exist. SIGTERM and Ctrl-C end the program.
    """
    place = ring_folder(ring, "--planner")
    joined = Ring(place)
    states = States(place)
    flown = make(strategy)
    if isinstance(flown, str):
        raise InputError(f"strategy {flown}: expected a Python strategy; skysink run supports built-in ones directly")
    field = joined.field()
    maker = PlanMaker(flown, field)
    for sample in joined.states():
        mission, slot, _ = words(sample.user_header())
        position = joined.position(slot)
        if position is None:
            continue
        states.resume(slot + 1, flown)
        states.save(slot + 1, flown)
        learnt_bps = joined.learnt_bps(slot)
        plan = maker.plan(slot + 1, position, view(sample, len(field)), learnt_bps)
        joined.send(mission, slot + 1, [Plan.from_buffer_copy(plan)])
    joined.wait_for_release()
