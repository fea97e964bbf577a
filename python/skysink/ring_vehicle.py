"""Vehicles in Python in the place of flight-sim."""

from __future__ import annotations

import ctypes
import math
import os
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skysink._skysink import Field, InputError, VehicleCore
from skysink.ring_topics import (
    FLIGHT,
    NODE,
    SERVING,
    FlightReport,
    Participant,
    Plan,
    Saved,
    SensorNode,
    SensorsHeader,
    SlotHeader,
    Tick,
    are_finite,
    iox2,
    ring_folder,
    view,
    words,
)

MAX_UAVS = 64
"""Most UAVs of a mission."""

REACHED_M = 2.0
"""A slot ends at the waypoint if it ends this near to it [m]."""

SERVE, FLY, DOWN = 0, 3, 6
"""Modes of a flight report."""

FLIGHT_SLOTS = 3
"""Number of slots whose flights are saved, and sent again after a restart."""

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


class VehicleRing(Participant):
    """The topics of a ring that a vehicle reads and writes."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, "flight-sim")
        sensors = self.topic("sensors", iox2.Slice[SensorNode], SensorsHeader)
        plans = self.topic("plan", iox2.Slice[Plan], SlotHeader)
        ticks = self.topic("tick", Tick, SlotHeader) if self.is_paced else None
        flights = self.topic("flight", iox2.Slice[FlightReport], SlotHeader)
        reader = sensors.reader()
        self.plans = plans.reader()
        self.ticks = ticks.reader() if ticks else None
        self.listen(sensors, plans, *([ticks] if ticks else []))
        self.write(flights, MAX_UAVS)
        self.received: dict[int, bytes] = {}
        self.tick = 0
        self.ends_at = math.inf
        self.limits, self.nodes = self.sensor_nodes(reader)
        self.mission = int(self.terms["mission"], 16)

    def poll(self) -> None:
        """Takes in the plans and ticks that are there."""
        while (sample := self.plans.receive()) is not None:
            _, slot, _ = words(sample.user_header())
            self.received[slot] = bytes(view(sample, ctypes.sizeof(Plan) * sample.header.number_of_elements, np.uint8))
            sample.delete()
        while self.ticks is not None and (sample := self.ticks.receive()) is not None:
            header = sample.user_header().contents.words
            self.tick = max(self.tick, header[1])
            self.ends_at = (header[3] + sample.payload().contents.words[0]) / 1e9
            sample.delete()

    def plan(self, slot: int) -> bytes | None:
        """The plans of a slot: waits for them, or in a paced run for the slot to begin; None if there are none in time."""
        while True:
            self.poll()
            is_due = self.tick >= slot if self.is_paced else slot in self.received
            if is_due:
                plans = self.received.get(slot)
                self.received = {later: found for later, found in self.received.items() if later > slot}
                return plans
            self.wait()

    def report(self, slot: int, reports: bytes) -> None:
        """Sends the reports of all UAVs."""
        size = FLIGHT.itemsize
        parts = [reports[start : start + size] for start in range(0, len(reports), size)]
        self.send(self.mission, slot, [FlightReport.from_buffer_copy(part) for part in parts])


def numbers(name: str, value: Any, shape: tuple[int, ...], expected: str) -> NDArray[np.float64]:
    """The numbers that a vehicle says, which are finite in single precision, in which they are drawn."""
    refused = InputError(f"{name} = {value}: expected {expected}")
    if isinstance(value, str) or np.iscomplexobj(value):
        raise refused
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise refused from None
    if name == "position" and array.shape == (2,):
        shape = (2,)
    if array.shape != shape or not are_finite(array):
        raise refused
    return array


def message_of(order: Order, flown: Flown, slot_s: float) -> NDArray[Any]:
    """The report of a vehicle, as far as it is the vehicle that says it."""
    at_m = numbers("position", flown.position, (3,), "(x, y) or (x, y, z), finite")
    time_s = order.slot * slot_s if flown.time_s is None else flown.time_s
    message = np.zeros((), FLIGHT)
    message["at_m"] = at_m if len(at_m) == 3 else [*at_m, order.position[2]]
    message["velocity_mps"] = numbers("velocity_mps", flown.velocity_mps, (3,), "three finite numbers")
    message["covariance_m2"] = numbers("covariance_m2", flown.covariance_m2, (6,), "six finite numbers")
    message["time_s"] = numbers("time_s", time_s, (), "a finite number")
    for name in ("energy_j", "heading_deg"):
        value = getattr(flown, name)
        if not isinstance(value, (int, float, np.number)) or math.isnan(value):
            raise InputError(f"{name} = {value}: expected a number, or infinity")
        message[name] = value
    message["mode"] = DOWN if flown.is_down else 0
    return message


def with_bits(reports: bytes, flown: Sequence[Flown], nodes: NDArray[Any], comm_s: float) -> bytes:
    """The reports with the links over which real SNs have delivered bits, where vehicles say so."""
    messages = np.frombuffer(reports, FLIGHT).copy()
    for message, said in zip(messages, flown, strict=True):
        if said.bits is not None:
            replace_links(message, said.bits, nodes, comm_s)
    return messages.tobytes()


def replace_links(message: Any, bits: Mapping[int, int], nodes: NDArray[Any], comm_s: float) -> None:
    """Replaces the links of a report by those over which real SNs have delivered these bits."""
    links = np.zeros_like(message["links"])
    whole = (int, np.integer)
    is_possible = isinstance(bits, Mapping) and all(
        isinstance(sensor, whole) and isinstance(count, whole) and 0 <= sensor < len(nodes) and 0 <= count < 2**62
        for sensor, count in bits.items()
    )
    if not is_possible or len(bits) > len(links):
        raise InputError(f"bits = {bits}: expected at most {len(links)} ids of sensor nodes, each with whole bits, 0 or above")
    if message["mode"] not in SERVING:
        return  # a hold, which serves no sensor node
    for link, (sensor, delivered) in zip(links, sorted(bits.items())):
        x_m, y_m = nodes[sensor]["numbers"][:2]
        distance_m = math.hypot(message["at_m"][0] - x_m, message["at_m"][1] - y_m)
        elevation_deg = math.degrees(math.atan2(message["at_m"][2], distance_m))
        link["sensor"], link["line_of_sight"] = sensor, 1
        link["numbers"] = (distance_m, elevation_deg, delivered / comm_s)
        link["capacity_bits"] = delivered
    message["links"], message["served"] = links, len(bits)
    if bits and message["mode"] == FLY:
        message["mode"] = SERVE


def vehicle(
    flown_by: Vehicle,
    ring: str | PathLike[str] | None = None,
    scenario: str | PathLike[str] | None = None,
    reached_m: float = REACHED_M,
) -> None:
    """Flies the plans of a running ring until its mission ends, in the place of flight-sim.

    ``ring`` is the ring folder and ``scenario`` the scenario file that ``skysink run`` prints, by default the environment
    variables ``SKYSINK_RING`` and ``SKYSINK_SCENARIO``, which ``skysink run --vehicle`` sets. The package checks the plans as
    flight-sim does, draws the scenario's channel above where the vehicle is, and fills in the report. A slot that ends
    farther than ``reached_m`` [m] from its waypoint is ``en-route``: the next plan begins where the vehicle is. After a restart
    the last flights are sent again, and no slot is flown twice.

    Raises :class:`skysink.InputError` if the ring does not exist, or if the vehicle says what cannot be. SIGTERM and Ctrl-C
    end the program.
    """
    place = ring_folder(ring, "--vehicle")
    file = scenario if scenario is not None else os.environ.get("SKYSINK_SCENARIO")
    if file is None:
        raise InputError("scenario: expected the scenario file of the run, or SKYSINK_SCENARIO from skysink run --vehicle")
    saved = Saved(place, "vehicle-flights", FLIGHT_SLOTS, "vehicle")
    joined = VehicleRing(place)
    core = VehicleCore(Path(file), joined.nodes, reached_m)
    data = Field._from_messages(joined.limits, joined.nodes)
    nodes = np.frombuffer(joined.nodes, NODE)
    if not saved.texts:
        saved.save(0, core.start().hex())
    slot = max(saved.texts)
    reports = bytes.fromhex(saved.texts[slot])
    core.restore(reports)
    flown_by.begin(data, np.frombuffer(reports, FLIGHT)["at_m"].copy())
    for earlier, text in sorted(saved.texts.items()):
        joined.report(earlier, bytes.fromhex(text))
    for slot in range(slot + 1, data.slots + 1):
        plans = joined.plan(slot)
        orders = [
            Order(slot, uav, np.array(at), np.array(to), serve, mode, is_late, is_refused, joined.ends_at)
            for uav, (at, to, serve, mode, is_late, is_refused) in enumerate(core.orders(slot, plans))
        ]
        says = [flown_by.fly(order) for order in orders]
        flown = [said if isinstance(said, Flown) else Flown(said) for said in says]
        try:
            messages = [message_of(order, said, data.slot_s) for order, said in zip(orders, flown, strict=True)]
            reports = core.complete(slot, b"".join(message.tobytes() for message in messages))
            reports = with_bits(reports, flown, nodes, data.comm_s)
        except InputError as error:
            print(f"vehicle: slot {slot}: {error}", file=sys.stderr)
            raise SystemExit(2) from None  # starting it again would not help
        saved.save(slot, reports.hex())  # before they are published
        joined.report(slot, reports)
    joined.wait_for_release()
