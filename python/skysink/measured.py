"""A scenario with the links and the flight of a flight log (decision D32).

    python -m skysink.measured aerial --log flights/monday

The folder has ``log.csv``, ``rates.csv`` and, without ``--sensors``, ``sensors.csv``. The SNRs become a map of links, the
flight a fixed track. Where nothing is known of the flight, it is not flown straight: such a log is refused, or cut.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skysink._skysink import InputError, positions_m
from skysink.drafts import (
    LINKS,
    LIST,
    MOST_OF_NODE,
    MOST_POINTS,
    Draft,
    Floats,
    MapGrid,
    check_places,
    commented,
    joined,
    parser_of,
    run,
    text_of,
)
from skysink.radio_maps import Measured

try:
    from skysink.flight_logs import RATES, FlightLog, read_rates
except ImportError as missing:
    if __name__ != "__main__":
        raise
    print(f"skysink: {missing}: expected pandas (pip install pandas)", file=sys.stderr)
    raise SystemExit(2) from None

LOG = "log.csv"
TRACK = "track.csv"

BIN_M = 10.0
"""Least side of a bin [m]: that of the positions of a satellite receiver with their errors."""

MOST_MPS = 100.0
"""Speed that no UAV with a log has [m/s]."""

MOST_DB = 20.0
"""Largest standard deviation of a residual [dB]."""

MOST_SLOTS = 1_000_000
"""Most slots of a track."""


def main(words: Sequence[str] | None = None) -> int:
    """Runs the command line, and returns its exit code."""
    parser = parser_of("python -m skysink.measured", "Create a scenario with the links and the flight of a flight log.")
    parser.add_argument(
        "--log", metavar="DIR", type=Path, required=True, help="folder: log.csv, rates.csv and, without --sensors, sensors.csv"
    )
    parser.add_argument("--sensors", metavar="FILE", type=Path, help="positions of the sensor nodes, as of skysink new")
    parser.add_argument(
        "--flight", metavar="K", type=int, help="the flight of a log with holes, from 1; its SNRs are those of all flights"
    )
    parser.add_argument(
        "--hole", metavar="S", type=float, default=5.0, help="longest time between rows farther apart than 20 m [s] [default: 5]"
    )
    options = parser.parse_args(joined(sys.argv[1:] if words is None else words, ["--hole", "--flight"]))
    if not options.hole > 0.0:
        parser.error(f"invalid value '{options.hole:g}' for '--hole <S>': expected a time above 0")
    return run(lambda: create(options))


def create(options: Namespace) -> None:
    """Writes the scenario, its list, its map and its track, all or none."""
    path = options.log / LOG
    log = FlightLog.read(path)
    rates = read_rates(options.log / RATES)
    level = log.level()
    sensors = options.sensors or options.log / LIST
    draft = draft_around(level, sensors, options)
    sensors_m, flown_m = draft.positions(), level.positions
    if draft.origin_deg is not None:
        sensors_m, flown_m = positions_m(draft.origin_deg, sensors_m), positions_m(draft.origin_deg, flown_m)
    else:
        flown_m = flown_m + np.array(draft.shift_m)
    files = {TRACK: add_track(draft, level, flown_m, options)}
    draft.notes += level.notes
    files |= {RATES: "snr_db,rate_bps\n" + "".join(f"{text_of(snr_db)},{text_of(rate_bps)}\n" for snr_db, rate_bps in rates)}
    files[LINKS] = add_links(draft, level, flown_m, sensors_m)
    inputs = [options.log / name for name in (LOG, RATES, LIST)]
    inputs += [given for given in (options.sensors, options.zones) if given is not None]
    draft.finish(options.out or Path(options.name), files, inputs, options.force)


def draft_around(log: FlightLog, sensors: Path, options: Namespace) -> Draft:
    """The draft whose area encloses the sensor nodes and the flight."""
    zones = [f"--zones={options.zones}"] if options.zones else []
    alone = Draft.new(options.name, sensors, zones)
    if alone.is_plane != log.is_plane:
        expected = "expected positions as in the flight log, all in metres or all in degrees"
        raise InputError(f"sensor positions {sensors}: {expected}")
    # The farthest places of the flight as sensor nodes, which are taken from the list again.
    ends = {int(index) for axis in (0, 1) for index in (log.positions[:, axis].argmin(), log.positions[:, axis].argmax())}
    columns = [alone.header.index(name) for name in (("x_m", "y_m") if alone.is_plane else ("lat_deg", "lon_deg"))]
    shift = np.array(alone.shift_m if alone.is_plane else (0.0, 0.0))
    rows = [list(row) for row in alone.rows]
    for row, position in zip(rows, alone.positions() - shift, strict=True):
        for column, along in zip(columns, position, strict=True):
            row[column] = text_of(round(float(along), 9))
    for index in sorted(ends):
        row = list(alone.rows[0])
        for column, along in zip(columns, log.positions[index], strict=True):
            row[column] = text_of(float(along))
        rows.append(row)
    with tempfile.TemporaryDirectory() as folder:
        enclosing = Path(folder, LIST)
        with enclosing.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([alone.header, *rows])
        try:
            draft = Draft.new(options.name, enclosing, zones)
        except InputError as error:
            raise InputError(str(error).replace(str(enclosing), str(sensors))) from None
    draft.rows = draft.rows[: len(alone.rows)]
    draft.notes, draft.warnings = alone.notes, alone.warnings
    return draft


def add_track(draft: Draft, log: FlightLog, flown_m: Floats, options: Namespace) -> str:
    """Sets the lines of the flight, and returns its text: the rows of the log at the ends of the slots."""
    slot_s = float(draft.keys["slot_s"])
    first, last = log.flight(flown_m, options.hole, options.flight, slot_s)
    times_s, at_m, lines = (along[first:last] for along in (log.times_s, flown_m, log.lines))
    slots = int(np.floor((times_s[-1] - times_s[0]) / slot_s + 1e-9))
    if slots < 1:
        raise log.refusal(f"it lasts less than a slot: expected {text_of(slot_s)} s or more")
    if slots > MOST_SLOTS:
        expected = f"expected at most {MOST_SLOTS}, the most of a track"
        raise log.refusal(f"line {lines[-1]}: {slots} slots after the first row: {expected}")
    ends_s = times_s[0] + np.arange(slots + 1) * slot_s
    track_m = np.stack([np.interp(ends_s, times_s, at_m[:, axis]) for axis in (0, 1)], axis=1)
    track_m = np.sign(track_m) * np.floor(np.abs(track_m) * 1e3 + 0.5) / 1e3
    speeds_mps = np.hypot(*np.diff(track_m, axis=0).T) / slot_s
    too_fast = np.flatnonzero(speeds_mps > MOST_MPS)
    if too_fast.size:
        line = lines[min(np.searchsorted(times_s, ends_s[too_fast[0] + 1]), len(lines) - 1)]
        speed_mps = speeds_mps[too_fast[0]]
        raise log.refusal(f"line {line}: {speed_mps:.1f} m/s to there: expected at most {MOST_MPS:g} m/s")
    altitude_m = log.altitude_m
    keys = draft.keys
    draft.set("slots", f"slots = {slots}", "Number of slots, T: the length of the log")
    draft.set("uav.altitude_m", f"altitude_m = {altitude_m!r}", "Altitude, H [m], the log's median")
    fastest_mps = float(np.ceil(speeds_mps.max() * 10.0) / 10.0 + 0.1)
    max_speed_mps = max(float(keys["uav"]["max_speed_mps"]), fastest_mps)
    draft.set("uav.max_speed_mps", f"max_speed_mps = {max_speed_mps!r}", "Maximum speed, V [m/s]")
    endurance_s = max(float(keys["uav"]["endurance_s"]), slots * slot_s)
    draft.set("uav.endurance_s", f"endurance_s = {endurance_s!r}", "Endurance, T_e [s]")
    draft.set("uav.start_m", "")
    draft.set("uav.track", commented(f'track = "{TRACK}"', "the log's flight; strategies only schedule"))
    rows = [f"{slot},{text_of(x_m)},{text_of(y_m)}\n" for slot, (x_m, y_m) in enumerate(track_m.tolist())]
    return "slot,x_m,y_m\n" + "".join(rows)


def add_links(draft: Draft, log: FlightLog, flown_m: Floats, sensors_m: Floats) -> str:
    """Sets the lines of the map of links, and returns its text."""
    check_places(draft, sensors_m)
    heard, sensors = log.heard(draft.names)
    if not heard.size:
        raise log.refusal("no snr_db: expected SNRs of sensor nodes")
    most = min(MOST_POINTS // len(sensors_m), MOST_OF_NODE)
    grid = MapGrid.over(draft.sides_m, BIN_M, most)
    measured = Measured.of(grid, log.altitude_m, sensors_m, sensors, flown_m[heard], log.snrs_db[heard])
    snr_db, exponent = measured.law()
    lines = [commented('model = "map"', "the links of the log, by place"), f'file = "{LINKS}"', f'rates = "{RATES}"']
    residual_db = measured.residual_db()
    if residual_db is not None:
        lines.append(f"residual_db = {min(residual_db, MOST_DB):.2f}                # about the mean of a bin")
    lines.append(f'law_snr_db = {np.clip(snr_db, -300.0, 300.0):.2f}                # for planner.links = "law"')
    lines.append(f"law_exponent = {exponent:.3f}")
    farthest_m = max(1.0, float(np.hypot(*(flown_m[heard] - sensors_m[sensors]).T).max()))
    draft.set_map(lines, (float(np.ceil(farthest_m)), "d_c [m]: as far as SNRs were logged"))
    error_db, law_db = measured.errors_db
    error = "too few to tell how good"
    if law_db != 0.0:
        error = (
            f"each left out and predicted: {error_db:.1f} dB rms with residuals over {text_of(measured.length_m)} m, "
            f"{law_db:.1f} dB by a law of the distance alone"
        )
    draft.notes.append(f"links: {measured.count} bins of {text_of(grid.step_m)} m, {error}")
    unheard = [draft.label(sensor) for sensor in range(len(sensors_m)) if sensor not in set(sensors.tolist())]
    if unheard:
        names = ", ".join(unheard[:5])
        draft.warnings.append(f"{len(unheard)} sensor nodes have no SNR in the log, and so no link: {names}")
    levels_db = measured.levels_db()
    rounded_db = np.clip(np.sign(levels_db) * np.floor(np.abs(levels_db) * 100.0 + 0.5), -3e4, 3e4) / 100.0
    return grid.links_csv(log.altitude_m, rounded_db, "snr_db")


if __name__ == "__main__":
    sys.exit(main())
