"""Flight logs: where the UAV was at which time, and the signal-to-noise ratios (SNRs) that it measured there.

CSV with the columns ``time_s``; ``x_m`` and ``y_m``, or ``lat_deg`` and ``lon_deg``; ``z_m``, the altitude above ground;
``sensor``, a name or an id; and ``snr_db``, empty if the sensor node was not heard. Times do not descend; rows of one time
are of one place. Other columns are ignored. Lines in messages are those of the file.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from skysink._skysink import InputError
from skysink.drafts import Floats, text_of

Ids = NDArray[np.int64]

RATES = "rates.csv"
"""The file with the rates of SNRs."""

POSITIONS = [("x_m", "y_m"), ("lat_deg", "lon_deg")]
"""The columns of positions: metres, or degrees."""

OTHERS = ["time_s", "z_m", "sensor", "snr_db"]

MOST_DB = 300.0
"""Largest SNR, and the negative of the smallest [dB]."""

LEVEL_M = 10.0
"""Rows farther than this from the median altitude are of a climb [m]."""

NEAR_M = 20.0
"""Rows nearer than this to each other have no hole between them, while the UAV hovers [m]."""

HOVER_S = 60.0
"""Time after which nothing is known of a UAV that was near before [s]."""

MOST_LISTED = 5

ID = re.compile(r"(#?)(\d+)(?:\.0*)?")


@dataclass(frozen=True)
class FlightLog:
    """The rows of a log that have a position, by time."""

    path: Path
    is_plane: bool
    """Whether positions are metres, not degrees."""
    lines: Ids
    times_s: Floats
    positions: Floats
    """x and y [m], or latitude and longitude [°], [rows, 2]."""
    z_m: Floats
    """Altitudes above ground [m]."""
    sensors: list[str]
    """Names or ids of sensor nodes."""
    snrs_db: Floats
    """SNRs [dB], NaN for sensor nodes that were not heard."""
    climbed: Ids
    """How many rows before each, after the one before it, were left out as those of a climb."""
    notes: list[str] = field(default_factory=list)

    def refusal(self, message: str) -> InputError:
        """An error about the log."""
        return InputError(f"flight log {self.path}: {message}")

    @staticmethod
    def read(path: Path) -> FlightLog:
        """Reads a file. Raises :class:`skysink.InputError` for what is no log."""
        table, lines = rows_of(path, "flight log")

        def refusal(message: str) -> InputError:
            return InputError(f"flight log {path}: {message}")

        columns = [pair for pair in POSITIONS if set(pair) <= set(table)]
        if len(columns) != 1 or not set(OTHERS) <= set(table):
            expected = "expected time_s,x_m,y_m,z_m,sensor,snr_db, or lat_deg,lon_deg instead of x_m,y_m"
            raise refusal(f"line 1: header `{','.join(table)[:120]}`: {expected}")
        is_plane = columns[0] == POSITIONS[0]
        texts = [table[name] for name in columns[0]]
        has_fix = np.ones(len(table), dtype=bool)
        for column in texts:
            has_fix &= ~column.str.lower().isin(["", "nan", "none", "null"]).to_numpy()
        if not is_plane:  # as receivers write that do not know where they are
            zero = [pd.to_numeric(column, errors="coerce").to_numpy(dtype=float) == 0.0 for column in texts]
            has_fix &= ~(zero[0] & zero[1])
        notes = []
        if not has_fix.all():
            first = int(np.argmax(has_fix)) if has_fix.any() else len(has_fix)
            before, later = lines[:first], lines[first:][~has_fix[first:]]
            notes += [f"flight log: {spans(before)}: no position before the first fix: left out"] if before.size else []
            notes += [f"flight log: {spans(later)}: no position: left out"] if later.size else []
        table, lines = table[has_fix].reset_index(drop=True), lines[has_fix]

        def numbers(name: str, needed: Any = None) -> Floats:
            found: Floats = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
            wrong = ~np.isfinite(found) & (True if needed is None else needed)
            for row in np.flatnonzero(wrong)[:1]:
                raise refusal(f"line {lines[row]}: {name} = {table[name][row][:60]}: expected a finite number")
            return found

        times_s, z_m = numbers("time_s"), numbers("z_m")
        positions = np.stack([numbers(name) for name in columns[0]], axis=1)
        is_heard = (table["snr_db"] != "").to_numpy(dtype=bool)
        snrs_db = np.where(is_heard, numbers("snr_db", is_heard), np.nan)
        sensors = table["sensor"].tolist()
        for row in np.flatnonzero(np.abs(snrs_db) > MOST_DB)[:1]:
            expected = f"expected a number from −{MOST_DB:g} to {MOST_DB:g}"
            raise refusal(f"line {lines[row]}: snr_db = {text_of(snrs_db[row])}: {expected}")
        for row in np.flatnonzero(is_heard & (table["sensor"] == "").to_numpy(dtype=bool))[:1]:
            raise refusal(f"line {lines[row]}: sensor = : expected a name or an id, as there is an SNR")
        for (name, most), along in zip([("latitude", 90), ("longitude", 180)], positions.T, strict=True):
            for row in np.flatnonzero(np.abs(along) > most)[: 0 if is_plane else 1]:
                raise refusal(f"line {lines[row]}: {name} {text_of(along[row])}: expected -{most} to {most}")
        steps_s = np.diff(times_s)
        for row in np.flatnonzero(steps_s < 0)[:1]:
            before_s = text_of(times_s[row])
            raise refusal(f"line {lines[row + 1]}: time_s = {text_of(times_s[row + 1])}: expected at least {before_s}, as before")
        moved = (np.diff(positions, axis=0) != 0).any(axis=1) | (np.diff(z_m) != 0)
        for row in np.flatnonzero((steps_s == 0) & moved)[:1]:
            raise refusal(f"line {lines[row + 1]}: time_s = {text_of(times_s[row + 1])}: expected one place at one time")
        if not len(times_s) or times_s[0] == times_s[-1]:
            raise refusal("expected rows of at least two times")
        none = np.zeros(len(lines), dtype=np.int64)
        return FlightLog(path, is_plane, lines, times_s, positions, z_m, sensors, snrs_db, none, notes)

    @property
    def altitude_m(self) -> float:
        """The median altitude [m]."""
        return float(np.floor(np.sort(self.z_m)[len(self.z_m) // 2] * 10.0 + 0.5) / 10.0)

    def level(self) -> FlightLog:
        """The rows about the median altitude, with a note on the others."""
        median_m = float(np.sort(self.z_m)[len(self.z_m) // 2])
        altitude_m = self.altitude_m
        if altitude_m <= 0.0:
            raise self.refusal(f"median z_m = {text_of(median_m)}: expected altitudes above the ground")
        is_level = np.abs(self.z_m - median_m) <= LEVEL_M
        kept = np.flatnonzero(is_level)
        if not is_level.all():
            self.notes.append(
                f"flight log: {int((~is_level).sum())} rows farther than {LEVEL_M:g} m from the altitude of "
                f"{text_of(altitude_m)} m are left out"
            )
        if kept.size == 0:
            raise self.refusal("expected rows about the median altitude")
        climbed = np.diff(kept, prepend=kept[0] - 1) - 1
        sensors = [self.sensors[row] for row in kept.tolist()]
        return replace(
            self, lines=self.lines[kept], times_s=self.times_s[kept], positions=self.positions[kept], z_m=self.z_m[kept],
            sensors=sensors, snrs_db=self.snrs_db[kept], climbed=climbed,
        )  # fmt: skip

    def flight(self, at_m: Floats, hole_s: float, chosen: int | None, slot_s: float) -> tuple[int, int]:
        """The first row and the end of the flight, which has no holes: all of the log, or the ``chosen`` one from 1.

        ``at_m`` are the positions in the area [m]. Raises :class:`skysink.InputError` for a log with holes.
        """
        times_s = np.diff(self.times_s)
        moved_m = np.hypot(*np.diff(at_m, axis=0).T)
        is_long = times_s > max(hole_s, slot_s)
        is_hole = is_long & ((moved_m > NEAR_M) | (self.climbed[1:] > 0) | (times_s > max(HOVER_S, hole_s)))
        holes = np.flatnonzero(is_hole) + 1
        begins, ends = np.r_[0, holes], np.r_[holes, len(self.times_s)]
        if chosen is not None:
            if not 1 <= chosen <= len(begins):
                expected = f"expected 1 to {len(begins)}, as it has {len(holes)} holes"
                raise InputError(f"option --flight: {chosen}: {expected} ({self.path})")
            first, end = int(begins[chosen - 1]), int(ends[chosen - 1])
            lines = f"lines {self.lines[first]} to {self.lines[end - 1]}"
            self.notes.append(f"flight log: flight {chosen} of {len(begins)}, {lines}, with the SNRs of all")
            return first, end
        if holes.size:
            row = int(holes[0])
            before_s, after_s = (text_of(self.times_s[at]) for at in (row - 1, row))
            why = f"{moved_m[row - 1]:.0f} m apart"
            if self.climbed[row]:
                why += f", with {self.climbed[row]} rows of another altitude between them"
            flights = [
                f"{number} is lines {self.lines[begin]} to {self.lines[end - 1]}, {self.times_s[end - 1] - self.times_s[begin]:g} s"
                for number, (begin, end) in enumerate(zip(begins, ends, strict=True), 1)
            ]
            rest = "" if len(flights) <= MOST_LISTED else f"; and {len(flights) - MOST_LISTED} more"
            raise self.refusal(
                f"line {self.lines[row]}: nothing is known from {before_s} s to {after_s} s, {why}: expected a log without "
                f"holes, or one of its flights by --flight: {'; '.join(flights[:MOST_LISTED])}{rest}"
            )
        return 0, len(self.times_s)

    def heard(self, names: Sequence[str]) -> tuple[Ids, Ids]:
        """The rows with SNRs, and the ids of their sensor nodes, by the names in a list or by their ids.

        All are names, or all are ids (``#7`` always is one), as in a map of links.
        """
        rows = np.flatnonzero(np.isfinite(self.snrs_db))
        words = [self.sensors[row] for row in rows.tolist()]
        lines: dict[str, int] = {}
        for word, line in zip(words, self.lines[rows].tolist(), strict=True):
            lines.setdefault(word, line)
        found = {word: self.sensor(word, lines, names) for word in lines}
        named = {word: place for word, place in found.items() if place[0] is not None}
        are_names = len(named) == len(found)
        are_ids = all(place[1] is not None for place in found.values())
        ids = {}
        for word, (by_name, by_id) in found.items():
            if are_ids and not are_names and by_name is not None and by_name != by_id:
                other = next(word for word, place in found.items() if place[0] is None)
                raise self.refusal(
                    f"line {lines[word]}: sensor `{word}`: it is the name of SN {by_name} and the id of SN {by_id}, and "
                    f"`{other}` (line {lines[other]}) is an id alone: expected names, or ids as #{by_id}, from #0"
                )
            if not are_ids and not are_names and by_name is None:
                other = next(word for word, place in found.items() if place[1] is None)
                raise self.refusal(
                    f"line {lines[word]}: sensor `{word}`: an id, and `{other}` (line {lines[other]}) is a name: expected all "
                    "names, or all ids"
                )
            ids[word] = by_name if are_names else by_id if are_ids else by_name
        return rows, np.array([ids[word] for word in words], dtype=np.int64)

    def sensor(self, word: str, lines: dict[str, int], names: Sequence[str]) -> tuple[int | None, int | None]:
        """The sensor nodes of a word: by name, and by id."""
        matched = ID.fullmatch(word)
        by_id = int(matched[2]) if matched and len(matched[2]) < 10 and int(matched[2]) < len(names) else None
        if matched and matched[1] and by_id is not None:
            return by_id, by_id  # always an id
        own = [matched[2]] if matched and not matched[1] and word not in names else []  # 1.0 is a whole number
        named = [sensor for sensor, name in enumerate(names) if name and name in (word, *own)]
        if len(named) > 1:
            expected = "expected names of one sensor node each, or ids"
            raise self.refusal(f"line {lines[word]}: sensor `{word}`: SN {named[0]} and SN {named[1]} have this name: {expected}")
        if not named and by_id is None:
            expected = "expected the name or the id of one sensor node"
            raise self.refusal(f"line {lines[word]}: sensor `{word}`: {expected}")
        return (named[0] if named else None), by_id


def read_rates(path: Path) -> list[tuple[float, float]]:
    """The SNR [dB] from which on each rate [bit/s] is carried, both ascending."""
    table, lines = rows_of(path, "rates")
    if list(table) != ["snr_db", "rate_bps"]:
        raise InputError(f"rates {path}: line 1: header `{','.join(table)[:120]}`: expected snr_db,rate_bps")
    columns = []
    for name in table:
        values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
        for row in np.flatnonzero(~np.isfinite(values))[:1]:
            raise InputError(f"rates {path}: line {lines[row]}: {name} = {table[name][row][:60]}: expected a finite number")
        for row in np.flatnonzero(np.diff(values) <= 0)[:1]:
            raise InputError(f"rates {path}: line {lines[row + 1]}: {name} = {table[name][row + 1]}: expected ascending values")
        columns.append(values.tolist())
    if not columns[0]:
        raise InputError(f"rates {path}: expected a rate in a row")
    return list(zip(*columns, strict=True))


def checked(reader: Any, source: str) -> Iterator[list[str]]:
    """The records of a reader; a field that has no end is refused."""
    try:
        yield from reader
    except csv.Error as error:
        raise InputError(f"{source}: line {reader.line_num}: {error}: expected fields whose quotes end") from None


def rows_of(path: Path, what: str) -> tuple[pd.DataFrame, Ids]:
    """The rows of a CSV file as text, and their lines. Semicolons and tabs may separate numbers with decimal commas."""
    try:
        data = path.read_bytes()
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except OSError as error:
        raise InputError(f"{what} {path}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(f"{what} {path}: line {line}: expected UTF-8 text") from None
    head = text.partition("\n")[0]
    separator = next((mark for mark in (";", "\t") if mark in head), ",")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    header = [name.strip() for name in next(reader, [])]
    for name in {name for name in header if name and header.count(name) > 1}:
        raise InputError(f"{what} {path}: line 1: column `{name}`: expected it once")
    records, lines = [], []
    before = reader.line_num
    for record in checked(reader, f"{what} {path}"):
        line, before = before + 1, reader.line_num
        if not any(record):
            continue
        if len(record) != len(header):
            raise InputError(f"{what} {path}: line {line}: {len(record)} fields: expected {len(header)}, as in the header")
        records.append(record)
        lines.append(line)
    table = pd.DataFrame(records, columns=pd.Index(header, dtype=str), dtype=str)
    table = table.apply(lambda column: column.str.strip())
    if separator != ",":
        table = table.apply(lambda column: column.str.replace(",", ".", n=1) if column.name != "sensor" else column)
    return table, np.array(lines, dtype=np.int64)


def spans(lines: Ids) -> str:
    """Lines as text, such as ``lines 2 to 14, 20``."""
    parts = np.split(lines, np.flatnonzero(np.diff(lines) > 1) + 1)
    texts = [f"{part[0]}" if part.size == 1 else f"{part[0]} to {part[-1]}" for part in parts[:MOST_LISTED]]
    rest = f" and {len(parts) - MOST_LISTED} more" if len(parts) > MOST_LISTED else ""
    return ("line " if lines.size == 1 else "lines ") + ", ".join(texts) + rest
