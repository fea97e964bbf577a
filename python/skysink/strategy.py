"""Strategies in Python: the base class, and how one is found by its name."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from skysink._skysink import STRATEGIES, Decision, Field, InputError, View

PREFIX = "python:"

_FOLDERS: set[str] = set()
"""Folders that strategies were loaded from."""


class Strategy(ABC):
    """A planning strategy: decides the waypoint and the schedule, slot by slot.

    The same class flies in :func:`skysink.simulate`, in :func:`skysink.compare`, in :func:`skysink.sweep` and in a
    running ring (:func:`skysink.ring.planner`). Given as a class, it is made anew for each mission.
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
class PythonStrategy:
    """A strategy in Python by its name in sweeps and results."""

    name: str
    make: Callable[[], Strategy]
    version: str
    """Tells one source from another."""

    spec: str | Callable[[], Strategy]
    """What a worker makes it of: its file and class, or what makes it, which must be picklable."""


def named(strategy: str | type[Strategy] | Callable[[], Strategy], folder: Path | None = None) -> str | PythonStrategy:
    """The name of a strategy of Skysink, or the strategy in Python that is meant.

    Raises :class:`skysink.InputError` if there is none.
    """
    if not isinstance(strategy, str):
        if isinstance(strategy, Strategy) or not callable(strategy):
            raise InputError(f"strategy {strategy}: expected a class, of which each mission gets an object of its own")
        name = getattr(strategy, "__name__", type(strategy).__name__)
        return PythonStrategy(name, strategy, _source(strategy), strategy)
    if not strategy.startswith(PREFIX):
        return strategy
    file, _, name = strategy.removeprefix(PREFIX).rpartition(":")
    path = (folder or Path.cwd()) / file
    if not file or not path.is_file():
        raise InputError(f"strategy {strategy}: expected {PREFIX}FILE:CLASS, and the file {path}")
    module, version = _load(path)
    found = getattr(module, name, None)
    if not (inspect.isclass(found) and issubclass(found, Strategy)):
        raise InputError(f"strategy {strategy}: expected a subclass of skysink.Strategy called {name} in {path}")
    return PythonStrategy(strategy, found, version, f"{PREFIX}{path.absolute()}:{name}")


def labelled(label: str, strategy: str | Callable[[], Strategy]) -> str | PythonStrategy:
    """A strategy under a name of its own; those of Skysink keep theirs."""
    found = named(strategy)
    if isinstance(found, str):
        if label != found:
            raise InputError(f"strategy {found} as {label}: expected its own name")
        return found
    if label in STRATEGIES:
        raise InputError(f"strategy in Python as {label}: it is one of Skysink's: expected another name")
    return PythonStrategy(label, found.make, found.version, found.spec)


def make(strategy: Strategy | type[Strategy] | str) -> str | Strategy:
    """The name of a strategy of Skysink, or an object in Python."""
    if isinstance(strategy, Strategy):
        return strategy
    found = named(strategy)
    return found if isinstance(found, str) else found.make()


def _load(path: Path) -> tuple[object, str]:
    """The module in a file, which may import its neighbours, and the hash of them all."""
    name = f"skysink_strategy_{hashlib.sha256(str(path).encode()).hexdigest()[:16]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None:
        raise InputError(f"strategy file {path}: expected a file of Python")
    folder = str(path.parent)
    _FOLDERS.add(folder)
    for neighbour in [other for other, loaded in sys.modules.items() if any(_is_in(each, loaded) for each in _FOLDERS)]:
        del sys.modules[neighbour]  # it may have changed since, or be another one of the same name
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    sys.path.insert(0, folder)
    writes_bytecode, sys.dont_write_bytecode = not sys.dont_write_bytecode, True  # it may be older than the file
    try:
        exec(compile(path.read_bytes(), path, "exec"), module.__dict__)
    finally:
        sys.path.remove(folder)
        sys.dont_write_bytecode = not writes_bytecode
    files = sorted(str(loaded.__file__) for loaded in sys.modules.values() if _is_in(folder, loaded))
    version = hashlib.sha256()
    for file in files:
        version.update(Path(file).read_bytes())
    return module, version.hexdigest()


def _is_in(folder: str, module: object) -> bool:
    """Whether a module is a file of the folder."""
    file = getattr(module, "__file__", None)
    return isinstance(file, str) and str(Path(file).parent) == folder


def _source(strategy: object) -> str:
    try:
        return hashlib.sha256(inspect.getsource(strategy).encode()).hexdigest()  # type: ignore[arg-type]
    except (OSError, TypeError):
        return ""


__all__ = ["PREFIX", "STRATEGIES", "PythonStrategy", "Strategy", "labelled", "make", "named"]
