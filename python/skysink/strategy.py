"""Python strategies: the base class, and loading by name."""

from __future__ import annotations

import ast
import glob
import hashlib
import importlib.util
import inspect
import sys
import sysconfig
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

from skysink._skysink import STRATEGIES, Decision, Field, Flight, InputError, View

PREFIX = "python:"

MAIN = "strategy.py"
"""A strategy's file in the folder of a run. ``strategy.NAME.py`` is a module beside it."""

Sources = Sequence[tuple[str, bytes]]
"""Source files: names in the folder of a run, and contents."""

DEFINED = "_skysink_sources"
"""The attribute of a class that holds its source files."""

_FOLDERS: list[str] = []
"""Folders from which strategies have been loaded."""

_INSTALLED = set(sysconfig.get_paths().values())
"""Folders of installed packages, which are no neighbours of a strategy that is installed there."""


class Strategy(ABC):
    """A planning strategy: decides waypoint and schedule of every slot.

    The same class works in :func:`skysink.simulate`, :func:`skysink.compare`, :func:`skysink.sweep` and in a
    running ring (:func:`skysink.ring.planner`), and for several UAVs. It is flown by the rules of all strategies: around
    zones, home before energy or time end, and apart from other UAVs. If a class is passed, each mission creates an
    instance for each UAV.
    """

    def __init_subclass__(cls, **arguments: object) -> None:
        """Reads the source files, which may change before the class flies."""
        super().__init_subclass__(**arguments)
        frame = inspect.currentframe()
        while frame is not None and frame.f_globals.get("__name__") != cls.__module__:
            frame = frame.f_back
        file = Path(frame.f_code.co_filename) if frame is not None else Path()
        try:
            sources = _sources(file.absolute()) if file.is_file() else [(MAIN, inspect.getsource(cls).encode())]
        except (OSError, TypeError):  # typed into an interpreter
            sources = ()
        setattr(cls, DEFINED, sources)

    def begin(self, field: Field) -> None:
        """Called once before slot 1, with the constant data of the mission.

        In a fleet whose ``uav.coordination`` is ``partition``, the SNs are those of the UAV's part, with ids from 0.
        """

    def observe(self, slot: int, flights: list[Flight]) -> None:
        """Called before each slot is planned, also while the UAV charges, with its flight in ``slot``, the one before: 0
        at the start. In a ``sequential`` fleet with those of all UAVs, by their numbers.
        """

    @abstractmethod
    def plan(self, view: View) -> Decision | None:
        """Returns the decision for slot ``view.slot``.

        ``None`` applies the transit rule: fly at full speed toward the fullest queue, by weight, of those that zones do
        not hide, and serve the fullest queues in range. A waypoint that is out of reach or outside the area is refused:
        the UAV holds its position. With zones or on a grid it is flown around or along them instead. SNs out of range are not served. ``refused`` in the results counts both. Not called
        while the UAV charges.
        """

    def save(self) -> bytes:
        """Returns the state of the strategy, so that it can be restarted in a ring; at most 4 MiB. It may be called before
        the first plan.
        """
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


def maker(spec: str | Callable[[], Strategy]) -> Callable[[], Strategy]:
    """The factory of a Python strategy."""
    found = named(spec)
    if isinstance(found, str):
        raise InputError(f"strategy {found}: expected a Python strategy")
    return found.make


def origin(strategy: Strategy) -> tuple[str, Sources]:
    """The name of a strategy that is an object, in the scenario of its run, and the file of its class with the neighbours
    that it imports, as they were when the class was defined; no files for a class typed into an interpreter.
    """
    kind = type(strategy)
    return f"{PREFIX}{kind.__name__}", kind.__dict__.get(DEFINED, ())


class FolderFinder(MetaPathFinder):
    """Finds the modules beside strategies that have been loaded, also those imported while they plan."""

    def __init__(self, folders: list[str]) -> None:
        self.folders = folders

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """The module or package in the folder of the strategy that imports it, if there is one."""
        importing = _importing()
        for folder in [folder for folder in self.folders if folder in importing]:
            file = _file_of(Path(folder), name)
            if file is not None:
                places: list[str] | None = [str(file.parent)] if file.name.endswith("__init__.py") else None
                return importlib.util.spec_from_file_location(name, file, submodule_search_locations=places)
            if _is_namespace(Path(folder), name):
                return importlib.util.spec_from_loader(name, None, is_package=True)
        return None


_FOLDER_FINDER = FolderFinder(_FOLDERS)


def _importing() -> set[str]:
    """The folders of the file that contains the running import statement."""
    frame = inspect.currentframe()
    while frame is not None and (frame.f_code.co_filename == __file__ or "importlib" in frame.f_code.co_filename):
        frame = frame.f_back
    return set() if frame is None else {str(folder) for folder in Path(frame.f_code.co_filename).parents}


def _file_of(folder: Path, name: str) -> Path | None:
    """The file of a module beside a strategy, if there is one."""
    return next((file for file in _files_of(folder, name) if file.is_file()), None)


def _files_of(folder: Path, name: str) -> list[Path]:
    """The files that may hold a module beside a strategy: in its place, or as in the folder of a run."""
    if name.partition(".")[0] == "skysink" or str(folder) in _INSTALLED:
        return []
    package = folder.joinpath(*name.split("."))
    saved = f"strategy.{name}"
    return [
        package / "__init__.py",
        package.with_name(f"{package.name}.py"),
        folder / f"{saved}.__init__.py",
        folder / f"{saved}.py",
    ]


def _is_namespace(folder: Path, name: str) -> bool:
    """Whether modules beside a strategy are in a package of this name that has no file; an installed one goes first."""
    is_beside = any(folder.joinpath(*name.split(".")).glob("*.py")) or any(
        folder.glob(f"strategy.{glob.escape(name)}.*.py")
    )
    return is_beside and ("." in name or PathFinder.find_spec(name) is None)


def _sources(path: Path) -> Sources:
    """A strategy's file and the neighbours that it imports, directly or not, at its top or in a function."""
    text = path.read_bytes()
    sources = {MAIN: text}
    imports = _imported(text, "")
    while imports:
        name = imports.pop()
        file = _file_of(path.parent, name)
        if file is None or file == path:
            continue
        is_package = file.name.endswith("__init__.py")
        saved = f"strategy.{name}.__init__.py" if is_package else f"strategy.{name}.py"
        if saved not in sources:
            sources[saved] = file.read_bytes()
            imports |= _imported(sources[saved], name if is_package else name.rpartition(".")[0])
    return tuple(sorted(sources.items(), key=lambda source: (source[0] != MAIN, source[0])))


def _imported(text: bytes, package: str) -> set[str]:
    """The names of the modules that a module of a package may import; those of its packages, too."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):  # not Python, or not of this version
        return set()
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            module = ".".join(filter(None, [*parents, node.module]))
            names |= {module} | {f"{module}.{alias.name}".lstrip(".") for alias in node.names}
    parts = [name.split(".") for name in names if name]
    return {".".join(each[:count]) for each in parts for count in range(1, len(each) + 1)}


def _load(path: Path) -> tuple[object, str, Sources]:
    """Loads the module in a file, which may import its neighbours. Returns it with the hash of all these files, and the
    files.
    """
    name = f"skysink_strategy_{hashlib.sha256(str(path).encode()).hexdigest()[:16]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None:
        raise InputError(f"strategy file {path}: expected a Python file")
    folder = str(path.parent)
    if folder in _FOLDERS:
        _FOLDERS.remove(folder)
    _FOLDERS.append(folder)
    if _FOLDER_FINDER not in sys.meta_path:
        sys.meta_path.append(_FOLDER_FINDER)
    for neighbour in [other for other, loaded in sys.modules.items() if _is_neighbour(other, loaded)]:
        del sys.modules[neighbour]  # it may have changed, or be another module of the same name
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    first = FolderFinder([folder])
    sys.meta_path.insert(0, first)
    writes_bytecode = not sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # cached bytecode may be older than the file
    try:
        sources = _sources(path)
        exec(compile(sources[0][1], path, "exec"), module.__dict__)
    finally:
        sys.meta_path.remove(first)
        sys.dont_write_bytecode = not writes_bytecode
    # Of the contents alone: in the folder of a run, the files have other names.
    contents = sorted(hashlib.sha256(text).digest() for _, text in sources)
    return module, hashlib.sha256(b"".join(contents)).hexdigest(), sources


def _is_neighbour(name: str, module: object) -> bool:
    """Whether a module is beside a strategy that has been loaded."""
    file = getattr(module, "__file__", None)
    if file is None:
        return list(getattr(module, "__path__", sys.path)) == []  # a package without a file, found by `Neighbours`
    return any(Path(file) in _files_of(Path(folder), name) for folder in _FOLDERS)


def _source(strategy: object) -> str:
    try:
        return hashlib.sha256(inspect.getsource(strategy).encode()).hexdigest()  # type: ignore[arg-type]
    except (OSError, TypeError):
        return ""


__all__ = ["PREFIX", "STRATEGIES", "PythonStrategy", "Sources", "Strategy", "labelled", "maker", "named", "origin"]
