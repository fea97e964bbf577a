"""The topics of a ring: layouts, checks, and waiting, which :mod:`skysink.ring` and :mod:`skysink.ring_vehicle` share."""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import sys
import time
import tomllib
from collections.abc import Callable
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skysink._skysink import InputError
from skysink.recording import need

iox2 = need("iceoryx2", "ring")

END = 1
"""Flag of the last slot's queues, and of the commit that releases the ring."""

POLL_S = 0.1
"""Time between two updates of the connections [s]."""

POLL = iox2.Duration.from_secs_f64(POLL_S)
"""Maximum wait for a notification, because notifications can be lost."""

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
Tick = message("Tick", 8)


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


def ring_folder(given: str | PathLike[str] | None, option: str) -> Path:
    """The folder of the ring to join: the given one, or the one that ``skysink run`` has set."""
    folder = given if given is not None else os.environ.get("SKYSINK_RING")
    if folder is None:
        raise InputError(f"ring: expected the folder of a running ring, or SKYSINK_RING from skysink run {option}")
    return Path(folder)


class Participant:
    """A process of a ring: its topics, its waiting, and the end of the launcher."""

    def __init__(self, folder: Path, role: str) -> None:
        config = folder / "config" / "iceoryx2.toml"
        if not config.is_file():
            raise InputError(f"ring {folder}: expected the folder of a running ring, as skysink run prints it")
        iox2.set_log_level_from_env_or(iox2.LogLevel.Fatal)
        iox2.config.setup_global_config_from_file(iox2.FilePath.new(str(config)))
        self.role = role
        self.node = iox2.NodeBuilder.new().name(iox2.NodeName.new(role)).create(iox2.ServiceType.Ipc)
        self.terms = tomllib.loads((folder / "ring.toml").read_text())
        self.is_paced = self.terms["pace"] != "max"
        self.commits = self.topic("commit", Commit, SlotHeader)
        self.wait_set = iox2.WaitSetBuilder.new().create(iox2.ServiceType.Ipc)
        self.listeners: list[Any] = []
        self.guards: list[Any] = []
        self.refused: set[str] = set()
        self.connected = time.monotonic()
        self.launcher = folder.with_suffix(".lock").open()

    def topic(self, name: str, payload: Any, header: Any) -> Topic:
        """Opens a topic."""
        return Topic(self.node, name, payload, header)

    def listen(self, *topics: Topic) -> None:
        """Is woken by samples of these topics, and of the commit."""
        self.listeners = [topic.events.listener_builder().create() for topic in (*topics, self.commits)]
        self.guards = [self.wait_set.attach_notification(listener) for listener in self.listeners]

    def write(self, topic: Topic, most: int = 1) -> None:
        """Becomes the writer of a topic whose samples have at most so many elements."""
        self.written = topic.samples.publisher_builder().initial_max_slice_len(most).create()
        self.events = topic.events.notifier_builder().create()

    def send(self, mission: int, slot: int, elements: list[Any]) -> None:
        """Sends the sample of a slot."""
        sample = self.written.loan_slice_uninit(len(elements))
        header = sample.user_header().contents.words
        header[0], header[1], header[2], header[3] = mission, slot, 0, time.monotonic_ns()
        for index, element in enumerate(elements):
            sample.payload()[index] = element
        sample.assume_init().send()
        self.events.notify()

    def wait(self) -> None:
        """Waits for a notification, at most ``POLL``. Exits on SIGTERM and SIGINT."""
        _, result = self.wait_set.wait_and_process_with_timeout(POLL)
        now = time.monotonic()
        if now - self.connected >= POLL_S:  # restarted processes get the last samples
            self.connected = now
            self.written.update_connections()
            self.events.notify()
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
        raise SystemExit(f"{self.role}: the launcher has ended")

    def receive(self, reader: Any, topic: str, is_possible: Callable[[Any], bool]) -> Any:
        """The next possible sample of a topic; None if there is none. Names the first impossible one of each topic."""
        while (sample := reader.receive()) is not None:
            if is_possible(sample):
                return sample
            if topic not in self.refused:
                self.refused.add(topic)
                slot = words(sample.user_header())[1]
                what = "a number for each SN or UAV, finite, not below 0, and links by ascending SN, none in a hold"
                print(f"{self.role}: {topic}({slot}) refused: expected {what}", file=sys.stderr)
            sample.delete()
        return None

    def sensor_nodes(self, reader: Any) -> tuple[bytes, bytes]:
        """Waits for the limits and the sensor nodes, in the layout of their messages."""
        while (sample := self.receive(reader, "sensors", possible_nodes)) is None:
            self.wait()
        limits = bytes(sample.user_header().contents)[32:]
        return limits, ctypes.string_at(sample.payload_ptr, NODE.itemsize * sample.header.number_of_elements)

    def wait_for_release(self) -> None:
        """Waits for the final commit."""
        commits = self.commits.reader()  # a new reader gets the last two commits
        while True:
            while (sample := commits.receive()) is not None:
                if words(sample.user_header())[2] & END:
                    return
                sample.delete()
            self.wait()


class Saved:
    """Texts by slot that a restarted process finds again: the last ``slots`` of them, in a file of the ring folder."""

    def __init__(self, folder: Path, name: str, slots: int, role: str) -> None:
        self.lock = (folder / f"{name}.lock").open("w")
        try:
            fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"ring {folder}: another {role} is running: stop it first") from None
        self.path = folder / f"{name}.json"
        self.slots = slots
        self.texts: dict[int, str] = {}
        with suppress(FileNotFoundError):
            self.texts = {int(slot): text for slot, text in json.loads(self.path.read_text()).items()}

    def save(self, slot: int, text: str) -> None:
        """Saves the text of a slot."""
        self.texts = {saved: text for saved, text in self.texts.items() if slot - self.slots < saved < slot}
        self.texts[slot] = text
        new = self.path.with_suffix(".new")
        new.write_text(json.dumps(self.texts))
        os.replace(new, self.path)
