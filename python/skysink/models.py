"""Arrivals of one's own: what the sensor nodes sample, from Python."""

from __future__ import annotations

import copy
import hashlib
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

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


Model = Arrivals | type[Arrivals] | Callable[[], Arrivals]
"""Arrivals, or what makes them for each mission."""


class Models:
    """The models of one's own of a mission: turns a scenario into the one that is flown."""

    def __init__(self, arrivals: Model | None = None) -> None:
        if arrivals is not None and not isinstance(arrivals, Arrivals) and not callable(arrivals):
            raise InputError(f"arrivals = {arrivals!r}: expected a subclass of skysink.Arrivals, or an object of one")
        self.arrivals = arrivals

    def __bool__(self) -> bool:
        return self.arrivals is not None

    @property
    def versions(self) -> list[tuple[str, str]]:
        """What they are, each with a hash of its source."""
        return [("arrivals", version(self.arrivals))] if self.arrivals is not None else []

    def prepare(self, scenario: Scenario) -> Scenario:
        """The scenario with what these models draw for its seed."""
        return scenario if self.arrivals is None else realised(scenario, self.arrivals)


def realised(scenario: Scenario, model: Model) -> Scenario:
    """The scenario with the bits that the model samples in its mission."""
    arrivals = copy.deepcopy(model) if isinstance(model, Arrivals) else model()
    if not isinstance(arrivals, Arrivals):
        raise InputError(f"arrivals = {model!r}: expected an object of a subclass of skysink.Arrivals")
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
    kind = model if inspect.isclass(model) or inspect.isfunction(model) else type(model)
    try:
        source = inspect.getsource(kind)
    except (OSError, TypeError):
        source = repr(kind)
    held = "" if kind is model else repr(sorted(vars(model).items(), key=lambda item: item[0]))
    return hashlib.sha256((source + held).encode()).hexdigest()[:16]


__all__ = ["Arrivals"]
