"""Models of one's own from Python: what the sensor nodes sample, and the rates of their links."""

from __future__ import annotations

import copy
import functools
import hashlib
import inspect
import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

from skysink._skysink import InputError, Scenario

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

PURPOSE = 16
"""The number of the random streams of arrivals, as in Rust."""

MOST_BITS = 2**32 - 1


class Arrivals(ABC):
    """What the sensor nodes (SNs) sample, slot by slot. A class is instantiated, and an object copied, for each mission.

    It flies in :func:`skysink.simulate`, :func:`skysink.compare`, :func:`skysink.sweep` and the environments as
    ``arrivals=``. The bits are drawn before slot 1, and become a trace: the folder of a saved run has them as
    ``arrivals.csv`` and flies again without Python. The planner is told the means, ``sensors.sampling_bps``, and
    ``dispersion_bits``.
    """

    dispersion_bits: float = 1.0
    """What the planner is told: the variance of the bits of an SN in a slot, divided by their mean [bit]."""

    @abstractmethod
    def bits(self, slot: int, mean_bits: NDArray[np.float64], random: np.random.Generator) -> ArrayLike:
        """The bits that each SN samples in ``slot``, from 1: whole numbers below 2^32, [N].

        ``mean_bits`` are the mean bits of a slot, ``sampling_bps * slot_s`` [N]. Draws must come from ``random``, which
        is made from the seed of the mission, so that the same seed samples the same.
        """


class Channel(ABC):
    """The rates of the links. A class is instantiated, and an object copied, for each mission.

    It flies in :func:`skysink.simulate`, :func:`skysink.compare`, :func:`skysink.sweep` and the environments as
    ``channel=``. Before slot 1 its rates become a table over distances, altitudes and probabilities, between whose points
    they are linear: the folder of a saved run has it as ``channel.csv`` and flies again without Python. The planner knows
    the law, flight-sim draws from it, for each slot and SN.
    """

    distances_m: ArrayLike | None = None
    """Horizontal distances of the table, ascending; by default 33 up to ``link.comm_radius_m``."""

    altitudes_m: ArrayLike | None = None
    """Altitudes of the UAV, ascending; by default that of the scenario, or 17 of its range."""

    probabilities: ArrayLike = (np.arange(33) + 0.5) / 33
    """Probabilities ``u``, ascending; one for rates that are not at random."""

    @abstractmethod
    def rate_bps(
        self, distance_m: NDArray[np.float64], altitude_m: NDArray[np.float64], u: NDArray[np.float64]
    ) -> ArrayLike:
        """The rates [bit/s] that a link does not exceed with the probabilities ``u``: the inverse of its distribution.

        The arguments broadcast against each other, [distances, 1, 1], [1, altitudes, 1] and [1, 1, probabilities]. Rates
        must be 0 to 1e300, and not fall with ``u``.
        """


Kind = TypeVar("Kind")

Model: TypeAlias = Kind | type[Kind] | Callable[[], Kind]
"""A model, or what makes it for each mission."""


class Models:
    """The models of one's own of a mission: turns a scenario into the one that is flown."""

    def __init__(self, arrivals: Model[Arrivals] | None = None, channel: Model[Channel] | None = None) -> None:
        for name, model, kind in (("arrivals", arrivals, Arrivals), ("channel", channel, Channel)):
            if model is not None and not isinstance(model, kind) and not callable(model):
                raise InputError(f"{name} = {model!r}: expected a subclass of skysink.{kind.__name__}, or an object of one")
        self.arrivals = arrivals
        self.channel = channel

    def __bool__(self) -> bool:
        return self.arrivals is not None or self.channel is not None

    @property
    def versions(self) -> list[tuple[str, str]]:
        """What they are, each with a hash of its source."""
        models = (("arrivals", self.arrivals), ("channel", self.channel))
        return [(name, version(model)) for name, model in models if model is not None]

    def prepare(self, scenario: Scenario) -> Scenario:
        """The scenario with what these models draw for its seed."""
        if self.channel is not None:
            scenario = tabulated(scenario, made(self.channel, Channel))
        if self.arrivals is not None:
            scenario = realised(scenario, made(self.arrivals, Arrivals))
        return scenario


def made(model: Any, kind: Any) -> Any:
    """The model of a mission: a copy of an object, or an instance of a class."""
    found = copy.deepcopy(model) if isinstance(model, kind) else model()
    if not isinstance(found, kind):
        raise InputError(f"{kind.__name__.lower()} = {model!r}: expected an object of a subclass of skysink.{kind.__name__}")
    return found


def tabulated(scenario: Scenario, channel: Channel) -> Scenario:
    """The scenario with the table of a channel."""
    uav = scenario["uav"]
    is_free = uav["altitude"] == "free"
    lowest_m, highest_m = (uav["min_altitude_m"], uav["max_altitude_m"]) if is_free else (uav["altitude_m"],) * 2
    grid = [
        np.linspace(0.0, scenario["link.comm_radius_m"], 33) if channel.distances_m is None else channel.distances_m,
        np.linspace(lowest_m, highest_m, 17 if is_free else 1) if channel.altitudes_m is None else channel.altitudes_m,
        channel.probabilities,
    ]
    distances_m, altitudes_m, probabilities = (np.atleast_1d(np.asarray(axis, np.float64)) for axis in grid)
    rates_bps = np.asarray(
        channel.rate_bps(distances_m[:, None, None], altitudes_m[None, :, None], probabilities[None, None, :]), np.float64
    )
    shape = (len(distances_m), len(altitudes_m), len(probabilities))
    try:
        rates_bps = np.broadcast_to(rates_bps, shape)
    except ValueError:
        raise InputError(f"channel: rates of shape {rates_bps.shape}: expected {shape}") from None
    return scenario.with_channel(distances_m, altitudes_m, probabilities, np.ascontiguousarray(rates_bps))


def realised(scenario: Scenario, arrivals: Arrivals) -> Scenario:
    """The scenario with the bits that the arrivals sample in its mission."""
    mean_bits = scenario.mean_bits()
    mean_bits.flags.writeable = False
    random = np.random.default_rng([PURPOSE, scenario.seed])
    drawn = np.empty((scenario.slots, len(mean_bits)), np.uint32)
    for slot in range(1, scenario.slots + 1):
        bits = np.asarray(arrivals.bits(slot, mean_bits, random))
        if bits.shape != mean_bits.shape:
            raise InputError(f"arrivals in slot {slot} of shape {bits.shape}: expected {mean_bits.shape}, one for each SN")
        possible = (bits >= 0) & (bits <= MOST_BITS) & (bits == np.floor(bits))
        if not possible.all():
            sensor = int(np.argmin(possible))
            raise InputError(f"arrivals in slot {slot} of SN {sensor}: {bits[sensor]}: expected whole bits below 2^32")
        drawn[slot - 1] = bits
    return scenario.with_arrivals(drawn, float(arrivals.dispersion_bits))


def version(model: Any) -> str:
    """A hash of the source of a model and of what it holds."""
    return hashlib.sha256("\n".join(described(model)).encode()).hexdigest()[:16]


def described(model: Any) -> Iterator[str]:
    """The source of a class, a function, or what made an object, and the values that they hold."""
    if isinstance(model, functools.partial):
        yield from described(model.func)
        yield fingerprint((model.args, sorted(model.keywords.items())))
        return
    kind = model if inspect.isclass(model) or inspect.isfunction(model) else type(model)
    try:
        yield inspect.getsource(kind)
    except (OSError, TypeError):
        yield repr(kind)
    if inspect.isfunction(kind):
        held: Any = (kind.__defaults__, kind.__kwdefaults__, [cell.cell_contents for cell in kind.__closure__ or ()])
    else:
        held = [] if kind is model else sorted(vars(model).items())
    yield fingerprint(held)


def fingerprint(value: Any) -> str:
    """A text that differs where values do."""
    try:
        return pickle.dumps(value, protocol=5).hex()
    except Exception:  # what cannot be pickled, such as a class within a function
        return repr(value)


__all__ = ["Arrivals", "Channel"]
