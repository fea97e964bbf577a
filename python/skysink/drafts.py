"""Scenarios that ``skysink new`` begins and another module completes: their lines, their lists, and the files beside
them. What is written is checked before, and all of it is written or nothing.
"""

from __future__ import annotations

import argparse
import csv
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Never

import numpy as np
from numpy.typing import NDArray

from skysink._skysink import Field, InputError, Scenario
from skysink.programs import executable

Floats = NDArray[np.float64]

LIST = "sensors.csv"
"""The file name of the sensor list."""

LINKS = "links.csv"
"""The file name of a map of links."""

COMMENT_COLUMN = 34

MOST_POINTS = 1_000_000
"""Most points of the maps of all sensor nodes."""

MOST_OF_NODE = 10_000
"""Most points of the map of one sensor node."""

SHIFT = re.compile(r"^# Positions are translated by (\S+) m and (\S+) m\.$", re.MULTILINE)

OF_RATES = ["bandwidth_hz", "tx_power_w", "noise_dbm", "gain_db", "gain"]
"""Keys of ``[link]`` that a map of links replaces."""


@dataclass
class Draft:
    """What ``skysink new`` made of a list of positions."""

    name: str
    text: str
    """The scenario file."""
    header: list[str]
    rows: list[list[str]]
    """The sensor list."""
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    centre: list[str] = field(default_factory=list)
    """The line with the centre of the area, if it has an origin."""

    @staticmethod
    def new(name: str, sensors: Path, options: Sequence[str] = ()) -> Draft:
        """A draft with the sensor nodes of a file. Raises :class:`skysink.InputError` if it is refused."""
        with tempfile.TemporaryDirectory() as folder:
            words = [str(executable()), "new", name, "--sensors", str(sensors), "--out", folder, *options]
            ended = subprocess.run(words, capture_output=True, text=True, check=False)
            said = [line.removeprefix("skysink: ") for line in ended.stderr.splitlines()]
            if ended.returncode != 0:
                raise InputError(" ".join(said[-1:]) or f"skysink new ended with {ended.returncode}")
            with Path(folder, LIST).open(encoding="utf-8", newline="") as file:
                header, *rows = csv.reader(file)
            text = Path(folder, f"{name}.toml").read_text(encoding="utf-8")
        *notes, _, _ = ended.stdout.splitlines()  # the last two say where the files were written
        centre = [line for line in notes if line.startswith("Centre of the area:")]
        notes = [line for line in notes if line not in centre]
        return Draft(name, text, header, rows, notes, [line.removeprefix("warning: ") for line in said], centre)

    @property
    def keys(self) -> dict[str, Any]:
        """The keys of the scenario file."""
        return tomllib.loads(self.text)

    @property
    def sides_m(self) -> tuple[float, float]:
        """Width and height of the area [m]."""
        area = self.keys["area"]
        return float(area["width_m"]), float(area["height_m"])

    @property
    def origin_deg(self) -> tuple[float, float] | None:
        """Latitude and longitude of the south-west corner of the area [°]; None for positions in metres."""
        area = self.keys["area"]
        return (float(area["origin_lat_deg"]), float(area["origin_lon_deg"])) if "origin_lat_deg" in area else None

    @property
    def is_plane(self) -> bool:
        """Whether positions are metres, not degrees."""
        return "x_m" in self.header

    @property
    def shift_m(self) -> tuple[float, float]:
        """The translation of positions in metres into the area [m]."""
        found = SHIFT.search(self.text)
        return (float(found[1]), float(found[2])) if found else (0.0, 0.0)

    @property
    def names(self) -> list[str]:
        """The names of the sensor nodes by id, empty without one."""
        if "name" not in self.header:
            return ["" for _ in self.rows]
        return [row[self.header.index("name")] for row in self.rows]

    def label(self, sensor: int) -> str:
        """The name of a sensor node, or ``SN id``."""
        return self.names[sensor] or f"SN {sensor}"

    def positions(self) -> Floats:
        """The positions as the list has them, [N, 2]: x and y in the area [m], or latitude and longitude [°]."""
        columns = ["x_m", "y_m"] if self.is_plane else ["lat_deg", "lon_deg"]
        indices = [self.header.index(column) for column in columns]
        return np.array([[float(row[index]) for index in indices] for row in self.rows]).reshape(-1, 2)

    def scenario(self) -> tuple[Scenario, Field]:
        """The draft as a scenario, and its sensor nodes."""
        with tempfile.TemporaryDirectory() as folder:
            self.write_into(Path(folder), {})
            scenario = Scenario.load(Path(folder, f"{self.name}.toml"))
            return scenario, scenario.field()

    def add_column(self, name: str, values: Iterable[str]) -> None:
        """Adds a column to the sensor list."""
        self.header.append(name)
        for row, value in zip(self.rows, values, strict=True):
            row.append(value)

    def set(self, key: str, setting: str, comment: str = "") -> None:
        """Sets the line of a dotted key, at its place or at the end of its table; an empty ``setting`` removes it."""
        table, _, name = key.rpartition(".")
        lines = self.text.split("\n")
        first = lines.index(f"[{table}]") + 1 if table else 0
        end = next((at for at in range(first, len(lines)) if lines[at].startswith("[")), len(lines))
        while end > first and not lines[end - 1]:
            end -= 1
        own = re.compile(rf"(# )?{name} = ")
        found = [at for at in range(first, end) if own.match(lines[at])]
        line = commented(setting, comment) if comment else setting
        at = found[0] if found else end
        lines[at : found[-1] + 1 if found else end] = line.split("\n") if setting else []
        self.text = "\n".join(lines)

    def set_map(self, lines: Sequence[str], radius: tuple[float, str]) -> None:
        """Sets the lines of a map of links in the place of a radio, its radius [m] with a comment, and a strategy that
        knows it.
        """
        own = "preset" if "preset" in self.keys["link"] else "model"
        self.set(f"link.{own}", "\n".join(lines))
        for name in OF_RATES:
            self.set(f"link.{name}", "")
        self.set("link.comm_radius_m", f"comm_radius_m = {radius[0]!r}", radius[1])
        self.set("planner.strategy", 'strategy = "horizon"', "Strategy, one of those in skysink simulate --help")

    def list_text(self) -> str:
        """The sensor list as CSV."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([self.header, *self.rows])
        return text.getvalue()

    def write_into(self, folder: Path, files: dict[str, str]) -> None:
        """Writes the scenario, its list and these files."""
        for name, text in {LIST: self.list_text(), **files, f"{self.name}.toml": self.text}.items():
            Path(folder, name).write_text(text, encoding="utf-8", newline="")

    def finish(self, out: Path, files: dict[str, str], inputs: Sequence[Path], is_forced: bool) -> None:
        """Writes the scenario with these files beside it into a folder, all or none, and says what was made.

        Raises :class:`skysink.InputError` for files that exist, are the ``inputs``, or that ``skysink check`` refuses.
        """
        names = [LIST, *files, f"{self.name}.toml"]
        for path in [out / name for name in names]:
            if any(path.exists() and given.exists() and path.samefile(given) for given in inputs):
                raise InputError(f"file {path}: the scenario is made from it: expected another --out")
            if path.exists() and not is_forced:
                raise InputError(f"file {path}: it exists: choose another --out, or pass --force to replace it")
        if out.exists() and not out.is_dir():
            raise InputError(f"folder {out}: it is not a folder: choose another --out")
        with tempfile.TemporaryDirectory() as staged:
            self.write_into(Path(staged), files)
            check = [str(executable()), "check", str(Path(staged, f"{self.name}.toml")), "--json"]
            ended = subprocess.run(check, capture_output=True, text=True, check=False)
            if ended.returncode != 0:
                raise InputError(ended.stderr.strip().removeprefix("skysink: ").replace(staged, str(out)))
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out) as staged:
            self.write_into(Path(staged), files)
            for name in names:
                os.replace(Path(staged, name), out / name)
        for line in [*self.notes, *self.centre]:
            print(line)
        for warning in self.warnings:
            print(f"skysink: warning: {warning}", file=sys.stderr)
        path = out / f"{self.name}.toml"
        width_m, height_m = (text_of(side_m) for side_m in self.sides_m)
        print(f"{path}: {len(self.rows)} sensor nodes in {width_m} m × {height_m} m")
        print(f"Next:  skysink check {shlex.quote(str(path))}")


@dataclass(frozen=True)
class MapGrid:
    """The grid of a map of links at one altitude, whose node (0, 0) is the corner of the area."""

    step_m: float
    """Between nodes [m]."""
    nodes: tuple[int, int]
    """Nodes to the east and to the north."""

    @staticmethod
    def over(sides_m: Sequence[float], step_m: float, most: int) -> MapGrid:
        """The grid over an area of these sides [m], with steps of at least ``step_m`` and at most ``most`` nodes."""
        while True:
            columns, rows = (int(np.ceil(side_m / step_m)) + 1 for side_m in sides_m)
            if columns * rows <= max(most, 4):
                return MapGrid(step_m, (columns, rows))
            step_m = float(np.ceil(step_m * 1.1))

    @property
    def positions_m(self) -> Floats:
        """The positions of all nodes [m], [rows × columns, 2], by row from the south."""
        columns, rows = (np.arange(count) * self.step_m for count in self.nodes)
        return np.stack([np.tile(columns, rows.size), np.repeat(rows, columns.size)], axis=1)

    def links_csv(self, altitude_m: float, levels: Floats, name: str) -> str:
        """The map as CSV: the column ``name`` of ``levels`` [N, nodes], NaN for no link."""
        columns, rows = self.nodes
        east, north = ([text_of(round(at * self.step_m * 1e3) / 1e3) for at in range(count)] for count in self.nodes)
        z = text_of(altitude_m)
        lines = [f"sensor,x_m,y_m,z_m,{name}\n"]
        for sensor, of_node in enumerate(levels.reshape(-1, rows, columns)):
            for column, x in enumerate(east):
                for row, y in enumerate(north):
                    level = of_node[row, column]
                    lines.append(f"#{sensor},{x},{y},{z},{text_of(level) if np.isfinite(level) else ''}\n")
        return "".join(lines)


def check_places(draft: Draft, positions_m: Floats) -> None:
    """Raises :class:`skysink.InputError` if two sensor nodes stand at one place, whose links no map tells apart."""
    first: dict[tuple[float, float], int] = {}
    for sensor, (x_m, y_m) in enumerate(positions_m.tolist()):
        other = first.setdefault((x_m, y_m), sensor)
        if other != sensor:
            raise InputError(
                f"sensor positions: {draft.label(other)} and {draft.label(sensor)} stand at one place: expected other "
                "places for links of their own"
            )


def commented(setting: str, comment: str) -> str:
    """A line with a comment, at the column of all comments."""
    return f"{setting:{COMMENT_COLUMN}}# {comment}"


def text_of(number: float) -> str:
    """A number in the fewest digits, without an exponent."""
    return np.format_float_positional(number, trim="-")


class Parser(argparse.ArgumentParser):
    """Options that are refused in one line, with the exit code 2."""

    def error(self, message: str) -> Never:
        """Ends the program."""
        print(f"skysink: {message}; usage: {self.prog} --help", file=sys.stderr)
        raise SystemExit(2)


def parser_of(prog: str, about: str) -> Parser:
    """Options that all drafts have."""
    parser = Parser(prog=prog, description=about, allow_abbrev=False)
    parser.add_argument("name", metavar="NAME", help="name of the mission")
    parser.add_argument("--zones", metavar="FILE", type=Path, help="zones, as of skysink new; positions in degrees")
    parser.add_argument("--out", metavar="DIR", type=Path, help="output folder [default: ./NAME]")
    parser.add_argument("--force", action="store_true", help="replace existing files")
    return parser


def joined(words: Sequence[str], options: Sequence[str]) -> list[str]:
    """The words of a command line, in which these options may have values that begin with a minus."""
    left = iter(words)
    return [f"{word}={next(left, '')}" if word in options else word for word in left]


def run(command: Callable[[], None]) -> int:
    """Runs a command, and returns its exit code: 2 for input that is refused, in one line."""
    try:
        command()
    except InputError as error:
        print(f"skysink: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"skysink: {error}", file=sys.stderr)
        return 1
    return 0
