"""Python strategies: the base class, and loading by name."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path

from skysink._skysink import STRATEGIES, Decision, Field, InputError, View

PREFIX = "python:"

MAIN = "strategy.py"
"""A strategy's file in the folder of a run. ``strategy.NAME.py`` is a module beside it."""

Sources = Sequence[tuple[str, bytes]]
"""Source files: names in the folder of a run, and contents."""

_FOLDERS: set[str] = set()
"""Folders from which strategies have been loaded."""


class Strategy(ABC):
    """A planning strategy: decides waypoint and schedule of every slot.

    The same class works in :func:`skysink.simulate`, :func:`skysink.compare`, :func:`skysink.sweep` and in a
    running ring (:func:`skysink.ring.planner`). If a class is passed, each mission creates an instance.
    """

    def begin(self, field: Field) -> None:
        """Called once before slot 1, with the constant data of the mission."""

    @abstractmethod
    def plan(self, view: View) -> Decision | None:
        """Returns the decision for slot ``view.slot``.

        ``None`` applies the transit rule: fly straight at full speed toward the fullest queue, and serve the
        fullest queues in range. A waypoint that is out of reach or outside the area is refused: the UAV holds its
        position. SNs out of range are not served. ``refused`` in the results counts both.
        """

    def save(self) -> bytes:
        """Returns the state of the strategy, so that it can be restarted in a ring."""
        return b""

    def restore(self, state: bytes) -> None:
        """Restores a state returned by :meth:`save`."""


@dataclass(frozen=True)
class PythonStrategy:
    """A Python strategy with its name in sweeps and results."""

    name: str
    make: Callable[[], Strategy]
    version: str
    """Hash of the source code."""

    spec: str | Callable[[], Strategy]
    """How a worker creates it: file and class, or a picklable factory."""

    sources: Sources = ()
    """Its source files, as in the folder of a run."""


def named(strategy: str | type[Strategy] | Callable[[], Strategy], folder: Path | None = None) -> str | PythonStrategy:
    """Resolves a strategy: returns the name of a built-in one, or a Python strategy.

    Raises :class:`skysink.InputError` if it does not exist.
    """
    if not isinstance(strategy, str):
        if isinstance(strategy, Strategy) or not callable(strategy):
            raise InputError(f"strategy {strategy}: expected a class, so that each mission can create an instance")
        name = getattr(strategy, "__name__", type(strategy).__name__)
        return PythonStrategy(name, strategy, _source(strategy), strategy)
    if not strategy.startswith(PREFIX):
        return strategy
    file, _, name = strategy.removeprefix(PREFIX).rpartition(":")
    path = (folder or Path.cwd()) / file
    if not file:
        flown_by = f"an object of the program that flew it, as in simulate(scenario, {name}())"
        raise InputError(f"strategy {strategy}: expected {flown_by}, or {PREFIX}FILE:CLASS")
    if not path.is_file():
        raise InputError(f"strategy {strategy}: expected {PREFIX}FILE:CLASS, and the file {path}")
    module, version, sources = _load(path)
    found = getattr(module, name, None)
    if not (inspect.isclass(found) and issubclass(found, Strategy)):
        raise InputError(f"strategy {strategy}: expected a subclass of skysink.Strategy called {name} in {path}")
    return PythonStrategy(strategy, found, version, f"{PREFIX}{path.absolute()}:{name}", sources)


def labelled(label: str, strategy: str | Callable[[], Strategy]) -> str | PythonStrategy:
    """Resolves a strategy under a label; built-in ones must keep their name."""
    found = named(strategy)
    if isinstance(found, str):
        if label != found:
            raise InputError(f"strategy {found} as {label}: expected its own name")
        return found
    if label in STRATEGIES:
        raise InputError(f"Python strategy as {label}: it is the name of a built-in strategy: expected another name")
    return PythonStrategy(label, found.make, found.version, found.spec, found.sources)


def make(strategy: Strategy | type[Strategy] | str) -> str | Strategy:
    """The name of a built-in strategy, or an instance of a Python strategy."""
    if isinstance(strategy, Strategy):
        return strategy
    found = named(strategy)
    return found if isinstance(found, str) else found.make()


def origin(strategy: Strategy) -> tuple[str, Sources]:
    """The name of a strategy that is an object, in the scenario of its run, and the file of its class."""
    kind = type(strategy)
    try:
        source = Path(inspect.getsourcefile(kind) or "")
        text = source.read_bytes() if source.is_file() else inspect.getsource(kind).encode()
    except (OSError, TypeError):  # typed into an interpreter
        return f"{PREFIX}{kind.__name__}", ()
    return f"{PREFIX}{kind.__name__}", ((MAIN, text),)


class SavedModules(MetaPathFinder):
    """Finds the modules beside a strategy in the folder of a run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """The module in ``strategy.NAME.py``, if there is that file."""
        file = self.folder / f"strategy.{name}.py"
        return importlib.util.spec_from_file_location(name, file) if file.is_file() else None


def _load(path: Path) -> tuple[object, str, Sources]:
    """Loads the module in a file, which may import its neighbours. Returns it with the hash of all these files, and the
    files.
    """
    name = f"skysink_strategy_{hashlib.sha256(str(path).encode()).hexdigest()[:16]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None:
        raise InputError(f"strategy file {path}: expected a Python file")
    folder = str(path.parent)
    _FOLDERS.add(folder)
    for neighbour in [other for other, loaded in sys.modules.items() if any(_is_in(each, loaded) for each in _FOLDERS)]:
        del sys.modules[neighbour]  # it may have changed, or be another module of the same name
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    sys.path.insert(0, folder)
    saved = SavedModules(path.parent)
    if path.name == MAIN:
        sys.meta_path.insert(0, saved)
    writes_bytecode = not sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # cached bytecode may be older than the file
    try:
        exec(compile(path.read_bytes(), path, "exec"), module.__dict__)
    finally:
        sys.path.remove(folder)
        if path.name == MAIN:
            sys.meta_path.remove(saved)
        sys.dont_write_bytecode = not writes_bytecode
    files = {str(loaded.__file__): other for other, loaded in sys.modules.items() if _is_in(folder, loaded)}
    contents = {file: Path(file).read_bytes() for file in sorted(files)}
    version = hashlib.sha256(b"".join(sorted(hashlib.sha256(text).digest() for text in contents.values()))).hexdigest()
    neighbours = [(f"strategy.{files[file]}.py", text) for file, text in contents.items() if files[file] != name]
    return module, version, ((MAIN, path.read_bytes()), *neighbours)


def _is_in(folder: str, module: object) -> bool:
    """Whether a module is a file in the folder."""
    file = getattr(module, "__file__", None)
    return isinstance(file, str) and str(Path(file).parent) == folder


def _source(strategy: object) -> str:
    try:
        return hashlib.sha256(inspect.getsource(strategy).encode()).hexdigest()  # type: ignore[arg-type]
    except (OSError, TypeError):
        return ""


__all__ = ["PREFIX", "STRATEGIES", "PythonStrategy", "Sources", "Strategy", "labelled", "make", "named", "origin"]
