"""Strategies in Python: the base class, and how one is found by its name."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from skysink._skysink import STRATEGIES, Decision, Field, InputError, View

PREFIX = "python:"


class Strategy(ABC):
    """A planning strategy: decides, slot by slot, where to fly and whom to serve.

    The same class flies in :func:`skysink.simulate`, in :func:`skysink.compare`, in :func:`skysink.sweep` and in a
    running ring (:func:`skysink.ring.planner`). Each mission has an object of its own.
    """

    def begin(self, field: Field) -> None:
        """Called once before slot 1, with what stays the same in every slot."""

    @abstractmethod
    def plan(self, view: View) -> Decision | None:
        """The decision for slot ``view.slot``.

        ``None`` leaves the slot to the transit rule: straight at full speed toward the fullest queue, serving the
        fullest in range on the way. A waypoint that is out of reach or outside the area is refused: the UAV holds, and
        ``refused`` in the results counts it; the same for SNs out of range.
        """

    def save(self) -> bytes:
        """What the strategy carries from slot to slot, for a ring in which it may be killed and started again."""
        return b""

    def restore(self, state: bytes) -> None:
        """Resumes from what :meth:`save` returned."""


@dataclass(frozen=True)
class Outside:
    """A strategy in Python by its name in sweeps and results."""

    name: str
    make: Callable[[], Strategy]
    version: str
    """Tells one source from another."""


def named(strategy: str | type[Strategy] | Callable[[], Strategy], folder: Path | None = None) -> str | Outside:
    """The name of a strategy of Skysink, or the strategy in Python that is meant.

    Raises :class:`skysink.InputError` if there is none.
    """
    if not isinstance(strategy, str):
        name = getattr(strategy, "__name__", type(strategy).__name__)
        return Outside(name, strategy, _source(strategy))
    if not strategy.startswith(PREFIX):
        return strategy
    file, _, name = strategy.removeprefix(PREFIX).rpartition(":")
    path = (folder or Path.cwd()) / file
    if not file or not path.is_file():
        raise InputError(f"strategy {strategy}: expected {PREFIX}FILE:CLASS, and the file {path}")
    found = getattr(_module(path), name, None)
    if not (inspect.isclass(found) and issubclass(found, Strategy)):
        raise InputError(f"strategy {strategy}: expected a subclass of skysink.Strategy called {name} in {path}")
    return Outside(strategy, found, hashlib.sha256(path.read_bytes()).hexdigest())


def make(strategy: Strategy | type[Strategy] | str) -> str | Strategy:
    """The name of a strategy of Skysink, or an object in Python."""
    if isinstance(strategy, Strategy):
        return strategy
    found = named(strategy)
    return found if isinstance(found, str) else found.make()


def _module(path: Path) -> object:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise InputError(f"strategy file {path}: expected a file of Python")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _source(strategy: object) -> str:
    try:
        return hashlib.sha256(inspect.getsource(strategy).encode()).hexdigest()  # type: ignore[arg-type]
    except (OSError, TypeError):
        return ""


__all__ = ["PREFIX", "STRATEGIES", "Outside", "Strategy", "make", "named"]
