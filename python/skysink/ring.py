"""Runs a Python strategy as the planner of a ring, over iceoryx2.

``skysink run SCENARIO --planner "python3 mine.py"`` starts a program that ends with ``skysink.ring.planner(Mine())``;
``skysink run SCENARIO --external planner`` waits for one that you start, with the folder that it prints.
"""

from __future__ import annotations

import base64
import ctypes
import fcntl
import json
import os
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skysink._skysink import Field, InputError, PlanMaker
from skysink.recording import need
from skysink.strategy import Strategy, make

iox2 = need("iceoryx2", "ring")

END = 1
"""Flag of the last slot's queues, and of the commit that releases the ring."""

POLL_S = 0.1
"""Time between two updates of the connections [s]."""

POLL = iox2.Duration.from_secs_f64(POLL_S)
"""Maximum wait for a notification, because notifications can be lost."""

STATE = "planner-state.json"
"""File with the saved states of the strategy, in the ring folder."""

LOCK = "planner-state.lock"
"""Locked by the running planner."""

SAVED_SLOTS = 4
"""Number of slots whose states are saved. A restarted planner plans the last two slots again."""


def message(name: str, length: int, version: int = 1) -> type[ctypes.Structure]:
    """A message of the ring as words of 8 bytes; ``docs/src/interfaces.md`` defines them."""
    members = {"_fields_": [("words", ctypes.c_uint64 * (length // 8))]}
    return type(name, (ctypes.Structure,), {**members, "type_name": staticmethod(lambda: f"skysink.{name}.v{version}")})


SlotHeader = message("SlotHeader", 32)
QueuesHeader = message("QueuesHeader", 96)
SensorsHeader = message("SensorsHeader", 168, 2)
SensorNode = message("SensorNode", 48, 2)
Plan = message("Plan", 400)
FlightReport = message("FlightReport", 2696, 3)
Commit = message("Commit", 8)


NODE = np.dtype([("numbers", "<f8", 4), ("capacity_bits", "<u4"), ("reserved", "<u4"), ("weight", "<f8")])
"""A `SensorNode`: position, gain and rate, its buffer, and its weight."""

LINK = np.dtype([("sensor", "<u4"), ("line_of_sight", "<u4"), ("numbers", "<f8", 3), ("capacity_bits", "<u8")])
"""A link of a `FlightReport`."""

FLIGHT = np.dtype(
    [
        ("at_m", "<f8", 3),
        ("energy_j", "<f8"),
        ("time_s", "<f8"),
        ("velocity_mps", "<f8", 3),
        ("heading_deg", "<f8"),
        ("covariance_m2", "<f8", 6),
        *((name, "<u4") for name in ("mode", "hold", "refused", "served")),
        ("links", LINK, 64),
    ]
)
"""A `FlightReport`."""

SERVING = (0, 1, 3, 5, 7)
"""Modes in which SNs may be served: not in a hold, while charging, nor when down."""


class Topic:
    """A topic: its samples and its notifications."""

    def __init__(self, node: Any, name: str, payload: Any, header: Any) -> None:
        service = iox2.ServiceName.new(f"skysink/{name}")
        self.samples = node.service_builder(service).publish_subscribe(payload).user_header(header).open()
        self.events = node.service_builder(service).event().open()

    def reader(self) -> Any:
        """A subscriber with a buffer for the slots that a planner may lag behind."""
        return self.samples.subscriber_builder().buffer_size(16).create()


def words(pointer: Any) -> tuple[int, int, int]:
    """Mission, slot and flags of a sample's user header."""
    header = pointer.contents.words
    return header[0], header[1], header[2] >> 32


def view(sample: Any, count: int, dtype: Any = np.uint32) -> NDArray[Any]:
    """The numbers of a sample, one for each SN, without a copy."""
    memory = memoryview((ctypes.c_char * (np.dtype(dtype).itemsize * count)).from_address(sample.payload_ptr))
    return np.frombuffer(memory.toreadonly(), dtype=dtype)


def are_finite(numbers: NDArray[Any]) -> bool:
    """Whether these numbers are finite in single precision, in which they are drawn."""
    with np.errstate(over="ignore"):
        return bool(np.isfinite(numbers.astype(np.float32)).all())


def possible_nodes(sample: Any) -> bool:
    """Whether a sample has SNs with finite positions, gains and rates, none of the latter below 0."""
    numbers = view(sample, sample.header.number_of_elements, NODE)["numbers"]
    return are_finite(numbers) and bool((numbers[:, 2:] >= 0.0).all())


def possible_queues(sample: Any, count: int) -> bool:
    """Whether a sample has the queue of each SN, and a possible ledger."""
    lost_slots = np.frombuffer(bytes(sample.user_header().contents)[72:80], dtype=np.float64)
    return sample.header.number_of_elements == count and are_finite(lost_slots) and lost_slots[0] >= 0.0


def possible_rates(sample: Any, count: int) -> bool:
    """Whether a sample has a rate for each SN, finite and not below 0."""
    if sample.header.number_of_elements != count:
        return False
    rates_bps = view(sample, count, np.float64)
    return are_finite(rates_bps) and bool((rates_bps >= 0.0).all())


def possible_flight(sample: Any) -> bool:
    """Whether a sample has the flight of one UAV, with finite numbers, and links by ascending SN, none while idle."""
    if sample.header.number_of_elements != 1:
        return False
    flight = view(sample, 1, FLIGHT)[0]
    most = len(flight["links"]) if flight["mode"] in SERVING else 0
    links = flight["links"][: flight["served"]]
    state = [flight[name] for name in ("at_m", "velocity_mps", "covariance_m2")]
    numbers = np.concatenate([*state, [flight["time_s"]], links["numbers"].ravel()])
    is_ascending = (np.diff(links["sensor"].astype(np.int64)) > 0).all()
    has_energy = not np.isnan([flight["energy_j"], flight["heading_deg"]]).any()
    return has_energy and are_finite(numbers) and flight["served"] <= most and bool(is_ascending)


def receive(reader: Any, topic: str, is_possible: Callable[[Any], bool], refused: set[str]) -> Any:
    """The next possible sample of a topic; None if there is none. Names the first impossible one of each topic."""
    while (sample := reader.receive()) is not None:
        if is_possible(sample):
            return sample
        if topic not in refused:
            refused.add(topic)
            slot = words(sample.user_header())[1]
            what = "a number for each SN or UAV, finite, not below 0, and links by ascending SN, none in a hold"
            print(f"planner: {topic}({slot}) refused: expected {what}", file=sys.stderr)
        sample.delete()
    return None


class Ring:
    """The topics of a ring that a planner reads and writes."""

    def __init__(self, folder: Path) -> None:
        config = folder / "config" / "iceoryx2.toml"
        if not config.is_file():
            raise InputError(f"ring {folder}: expected the folder of a running ring, as skysink run prints it")
        iox2.set_log_level_from_env_or(iox2.LogLevel.Fatal)
        iox2.config.setup_global_config_from_file(iox2.FilePath.new(str(config)))
        self.node = iox2.NodeBuilder.new().name(iox2.NodeName.new("planner")).create(iox2.ServiceType.Ipc)
        sensors = Topic(self.node, "sensors", iox2.Slice[SensorNode], SensorsHeader)
        terms = tomllib.loads((folder / "ring.toml").read_text())
        known_queues = "belief" if "belief" in terms else "queues"
        queues = Topic(self.node, known_queues, iox2.Slice[ctypes.c_uint32], QueuesHeader)
        rates = None
        if terms.get("belief") == "learnt":
            rates = Topic(self.node, "rates", iox2.Slice[ctypes.c_double], SlotHeader)
        flights = Topic(self.node, "flight", iox2.Slice[FlightReport], SlotHeader)
        plans = Topic(self.node, "plan", iox2.Slice[Plan], SlotHeader)
        self.commits = Topic(self.node, "commit", Commit, SlotHeader)
        self.plans = plans.samples.publisher_builder().create()
        self.plan_events = plans.events.notifier_builder().create()
        self.sensors, self.queues = sensors.reader(), queues.reader()
        self.flights = flights.reader()
        self.rates = rates.reader() if rates else None
        woken_by = (sensors, queues, flights, self.commits, *([rates] if rates else []))
        self.listeners = [topic.events.listener_builder().create() for topic in woken_by]
        self.wait_set = iox2.WaitSetBuilder.new().create(iox2.ServiceType.Ipc)
        self.guards = [self.wait_set.attach_notification(listener) for listener in self.listeners]
        self.count = 0
        self.refused: set[str] = set()
        self.positions: dict[int, tuple[float, float, float]] = {}
        self.learnt: tuple[int, NDArray[np.float64] | None] = (-1, None)
        self.connected = time.monotonic()
        self.is_paced = terms["pace"] != "max"
        self.launcher = folder.with_suffix(".lock").open()

    def wait(self) -> None:
        """Waits for a notification, at most ``POLL``. Exits on SIGTERM and SIGINT."""
        _, result = self.wait_set.wait_and_process_with_timeout(POLL)
        now = time.monotonic()
        if now - self.connected >= POLL_S:  # restarted processes get the last plans
            self.connected = now
            self.plans.update_connections()
            self.plan_events.notify()
            self.check_launcher()
        # The wait after a termination signal says so; `Interrupt` may also be a SIGCONT.
        if result == iox2.WaitSetRunResult.TerminationRequest:
            raise SystemExit(0)
        for listener in self.listeners:
            while list(listener.try_wait()):
                pass

    def check_launcher(self) -> None:
        """Exits if the launcher has died, which releases its lock of this file."""
        try:
            fcntl.flock(self.launcher, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return
        raise SystemExit("planner: the launcher has ended")

    def field(self) -> Field:
        """Waits for the sensor nodes and the limits."""
        while (sample := receive(self.sensors, "sensors", possible_nodes, self.refused)) is None:
            self.wait()
        self.count = sample.header.number_of_elements
        limits = bytes(sample.user_header().contents)[32:]
        nodes = ctypes.string_at(sample.payload_ptr, NODE.itemsize * sample.header.number_of_elements)
        return Field._from_messages(limits, nodes)

    def position(self, slot: int) -> tuple[float, float, float] | None:
        """Position of the UAV after ``slot`` [m]; None if the mission has advanced since."""
        while slot not in self.positions:
            while (sample := receive(self.flights, "flight", possible_flight, self.refused)) is not None:
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
            sample = receive(self.rates, "rates", is_possible, self.refused)
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
        return receive(self.queues, "queues", partial(possible_queues, count=self.count), self.refused)

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

    def send(self, mission: int, slot: int, plan: bytes) -> None:
        """Sends the plan of a slot."""
        sample = self.plans.loan_slice_uninit(1)  # one for each UAV
        header = sample.user_header().contents.words
        header[0], header[1], header[2], header[3] = mission, slot, 0, time.monotonic_ns()
        sample.payload()[0] = Plan.from_buffer_copy(plan)
        sample.assume_init().send()
        self.plan_events.notify()

    def wait_for_release(self) -> None:
        """Waits for the final commit."""
        commits = self.commits.reader()  # a new reader gets the last two commits
        while True:
            while (sample := commits.receive()) is not None:
                if words(sample.user_header())[2] & END:
                    return
                sample.delete()
            self.wait()


class States:
    """The saved states of a strategy for its last slots."""

    def __init__(self, folder: Path) -> None:
        self.lock = (folder / LOCK).open("w")
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"ring {folder}: another planner is running: stop it first") from None
        self.path = folder / STATE
        self.saved: dict[int, str] = {}
        with suppress(FileNotFoundError):
            self.saved = {int(slot): state for slot, state in json.loads(self.path.read_text()).items()}
        self.is_fresh = True

    def resume(self, slot: int, strategy: Strategy) -> None:
        """Restores a restarted strategy to its state before ``slot``, or to the latest saved one before that."""
        earlier = [saved for saved in self.saved if saved <= slot]
        if self.is_fresh and earlier:
            if max(earlier) < slot:
                print(f"planner: plans slot {slot} with its state of slot {max(earlier)}", file=sys.stderr)
            strategy.restore(base64.b64decode(self.saved[max(earlier)]))
        elif self.is_fresh and slot > 1:
            print(f"planner: begins at slot {slot} without a saved state", file=sys.stderr)
        self.is_fresh = False

    def save(self, slot: int, strategy: Strategy) -> None:
        """Saves the state of the strategy before ``slot``, if it has one."""
        state = strategy.save()
        if not isinstance(state, bytes):
            raise InputError(f"save() of the strategy returned {type(state).__name__}: expected bytes")
        if state:
            self.saved = {saved: text for saved, text in self.saved.items() if slot - SAVED_SLOTS < saved < slot}
            self.saved[slot] = base64.b64encode(state).decode()
            new = self.path.with_suffix(".new")
            new.write_text(json.dumps(self.saved))
            os.replace(new, self.path)


def planner(strategy: Strategy | type[Strategy], ring: str | PathLike[str] | None = None) -> None:
    """Plans for a running ring until its mission ends.

    ``ring`` is the ring folder that ``skysink run`` prints, by default the environment variable ``SKYSINK_RING``,
    which ``skysink run --planner`` sets. The queues are in shared memory, without a copy: do not store them
    beyond :meth:`skysink.Strategy.plan`. In a paced ring, only the newest queues are planned for. After a restart, a
    stateless strategy simply continues; one with state is restored by ``save`` and ``restore``.

    Raises :class:`skysink.InputError` if the ring does not exist. SIGTERM and Ctrl-C end the program.
    """
    folder = ring if ring is not None else os.environ.get("SKYSINK_RING")
    if folder is None:
        raise InputError("ring: expected the folder of a running ring, or SKYSINK_RING from skysink run --planner")
    place = Path(folder)
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
        joined.send(mission, slot + 1, maker.plan(slot + 1, position, view(sample, len(field)), learnt_bps))
    joined.wait_for_release()
