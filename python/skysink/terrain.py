"""A scenario over hills, from a list of positions and a grid of heights: no-fly zones over ground that is too high for
the flight, links by place without those that the ground hides, and ``ground_m`` of the sensor nodes (decision D37).

    python -m skysink.terrain hill --sensors nodes.csv --terrain dem.tif --clearance 10

The grid is whatever GDAL reads. Positions in degrees are found in it by its reference system; positions in metres are
those of the grid, and become degrees if its system is known.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from skysink._skysink import Field, InputError, Scenario, expected_rates_bps, simplified_polygons
from skysink.drafts import (
    LINKS,
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
from skysink.ground import Ground, Marks

try:
    from rasterio.features import rasterize, shapes

    from skysink.heights import Grid, in_area, opened
except ImportError as missing:
    if __name__ != "__main__":
        raise
    print(f"skysink: {missing}: expected rasterio (pip install rasterio)", file=sys.stderr)
    raise SystemExit(2) from None

EXACT_CORNERS = 100
"""Corners of zones up to which they are as exact as the cells."""

Ring = list[tuple[float, float]]
"""The corners of a polygon in the area [m]."""

Values = TypeVar("Values", Marks, Floats)


def main(words: Sequence[str] | None = None) -> int:
    """Runs the command line, and returns its exit code."""
    parser = parser_of("python -m skysink.terrain", "Create a scenario over hills, from a grid of heights.")
    parser.add_argument(
        "--sensors", metavar="FILE", type=Path, required=True, help="positions of the sensor nodes, as of skysink new"
    )
    parser.add_argument(
        "--terrain", metavar="FILE", type=Path, required=True, help="heights of the ground: a grid that GDAL reads"
    )
    parser.add_argument(
        "--crs", metavar="SYSTEM", help="reference system of a grid that names none, such as EPSG:32633"
    )
    parser.add_argument(
        "--clearance", metavar="M", type=float, default=10.0, help="least height of the flight above the cells of the grid [m] [default: 10]"
    )
    parser.add_argument(
        "--voids", choices=["refuse", "zones"], default="refuse", help="cells of the area without a height: refuse the grid, or close them as no-fly zones [default: refuse]"
    )
    parser.add_argument("--start", metavar="X,Y", help="where the UAV starts, in the coordinates of the positions")
    parser.add_argument("--radio", metavar="RADIO", help="radio of the sensor nodes, as of skysink new")
    parser.add_argument("--drone", metavar="DRONE", help="drone, as of skysink new")
    options = parser.parse_args(joined(sys.argv[1:] if words is None else words, ["--start", "--clearance"]))
    if not 0.0 <= options.clearance <= 1e4:
        parser.error(f"invalid value '{options.clearance:g}' for '--clearance <M>': expected 0 to 10000 m")
    return run(lambda: create(options))


def create(options: Namespace) -> None:
    """Writes the scenario, its list and its map, all or none."""
    with opened(options.terrain, options.crs) as grid:
        draft = draft_over(grid, options)
        ground = grid.under(draft.sides_m, draft.origin_deg, draft.shift_m, options.voids == "zones")
    sensors_m = draft.positions()
    if draft.origin_deg is not None:
        sensors_m = in_area(sensors_m, draft.origin_deg)
    own_m = None
    if "ground_m" in draft.header:
        column = draft.header.index("ground_m")
        own_m = np.array([float(cells[column]) for cells in draft.rows])
    add_ground(draft, ground, sensors_m, options)
    draft.notes += ground.notes
    draft.warnings += ground.warnings
    files: dict[str, str] = {}
    if not ground.is_flat:
        scenario, field = draft.scenario()
        start = draft.keys["uav"].get("start_m", [side_m / 2 for side_m in draft.sides_m])
        start_m = (float(start[0]), float(start[1]))
        at_start_m = height_at(ground, start_m)
        altitude_m = at_start_m + float(scenario["uav.altitude_m"])
        limit_m = altitude_m - options.clearance
        zones = zones_above(ground, limit_m, start_m, options)
        draft.text += "".join(f"\n[[area.no_fly]]\npolygon_m = {[list(at) for at in zone]}\n" for zone in zones)
        draft.notes.append(
            f"terrain: {at_start_m:.1f} m at the start, {altitude_m:.1f} m in flight, {len(zones)} no-fly zones where "
            f"the ground is above {limit_m:.1f} m"
        )
        files[LINKS] = links_over(ground, altitude_m, scenario, field, sensors_m, own_m, draft)
    inputs = [path for path in (options.sensors, options.terrain, options.zones) if path is not None]
    draft.finish(options.out or Path(options.name), files, inputs, options.force)


def draft_over(grid: Grid, options: Namespace) -> Draft:
    """The draft with its sensor nodes, in degrees if the system of the grid is known."""
    hardware = [f"--{name}={getattr(options, name)}" for name in ("radio", "drone", "zones") if getattr(options, name)]
    start = [f"--start={options.start}"] if options.start else []
    if grid.crs is None:
        draft = Draft.new(options.name, options.sensors, [*hardware, *start])
    else:
        draft = Draft.new(options.name, options.sensors)  # of metres, which zones would refuse; or of degrees
        if not draft.is_plane:
            draft = Draft.new(options.name, options.sensors, [*hardware, *start])
    if not draft.is_plane:
        if grid.crs is None:
            raise InputError(
                f"terrain {options.terrain}: it names no reference system, and the positions are latitudes and longitudes: "
                "expected a file .prj beside it, or --crs EPSG:32633 for zone 33 of UTM"
            )
        return draft
    grid.check_metres(options.sensors)
    if grid.crs is None:
        return draft
    # Metres of a map grid have their north, and become degrees.
    notes = draft.notes
    places = grid.degrees(draft.positions() - np.array(draft.shift_m))
    if not np.isfinite(places).all():
        row = int(np.flatnonzero(~np.isfinite(places).all(axis=1))[0])
        name = grid.crs.to_string()
        raise InputError(f"sensor positions {options.sensors}: {draft.label(row)}: it lies outside of the system {name}")
    if options.start:
        lat_deg, lon_deg = grid.degrees(np.array([numbers(options.start)]))[0].tolist()
        start = [f"--start={text_of(lat_deg)},{text_of(lon_deg)}"]
    warnings = draft.warnings
    with tempfile.TemporaryDirectory() as folder:
        converted = Path(folder, "sensors.csv")
        columns = [index for index, column in enumerate(draft.header) if column not in ("x_m", "y_m")]
        with converted.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["lat_deg", "lon_deg", *(draft.header[index] for index in columns)])
            for cells, (lat_deg, lon_deg) in zip(draft.rows, places.tolist(), strict=True):
                rows.writerow([f"{lat_deg:.9f}", f"{lon_deg:.9f}", *(cells[index] for index in columns)])
        try:
            draft = Draft.new(options.name, converted, [*hardware, *start])
        except InputError as error:
            raise InputError(str(error).replace(str(converted), str(options.sensors))) from None
    notes.append(f"positions in metres are those of the grid, {named(grid)}, and become latitudes and longitudes")
    draft.notes = notes + draft.notes
    doubts = ("its metres are taken as", "their metres are probably those of a map")
    kept = [warning for warning in warnings if not any(doubt in warning for doubt in doubts)]
    own = [warning.replace(str(converted), str(options.sensors)) for warning in draft.warnings]
    draft.warnings = kept + [warning for warning in own if warning not in kept]
    return draft


def named(grid: Grid) -> str:
    """The name of the system of a grid."""
    wkt: list[str] = grid.crs.to_wkt().split('"')
    return wkt[1]


def numbers(place: str) -> list[float]:
    """The two numbers of a place."""
    try:
        x, y = (float(word) for word in place.split(","))
    except ValueError:
        raise InputError(f"option --start: `{place}`: expected two numbers, X,Y") from None
    return [x, y]


def add_ground(draft: Draft, ground: Ground, sensors_m: Floats, options: Namespace) -> None:
    """Adds the ground at the sensor nodes as a column, unless they have one."""
    if "ground_m" in draft.header:
        return
    heights_m = ground.height_m(sensors_m[:, 0], sensors_m[:, 1], is_clamped=False)
    for sensor in np.flatnonzero(~np.isfinite(heights_m)).tolist():
        expected = f"expected a place with a height in {options.terrain}, or a column ground_m"
        raise InputError(f"sensor positions {options.sensors}: {draft.label(sensor)}: {expected}")
    draft.add_column("ground_m", [text_of(in_mm(height_m)) for height_m in heights_m.tolist()])


def height_at(ground: Ground, at_m: tuple[float, float]) -> float:
    """The height of the ground at a place in the area [m]."""
    height_m = float(ground.height_m(np.array([at_m[0]]), np.array([at_m[1]]))[0])
    if not np.isfinite(height_m):
        raise InputError(f"terrain {ground.path}: no height at the start, {at_m} m in the area: expected another --start")
    return height_m


def zones_above(ground: Ground, limit_m: float, start_m: tuple[float, float], options: Namespace) -> list[Ring]:
    """The cells that are too high as zones, of fewer corners where that lets them grow by less than a cell."""
    closed = filled(ground.heights_m > limit_m, ground.heights_m, ground.is_inner)
    columns, rows = ground.to_cells(np.array([start_m[0]]), np.array([start_m[1]]))
    near = [(int(columns[0] + step), int(rows[0] + other)) for step in (-1e-9, 1e-9) for other in (-1e-9, 1e-9)]
    if any(0 <= row < closed.shape[0] and 0 <= column < closed.shape[1] and closed[row, column] for column, row in near):
        raise InputError(
            f"terrain {ground.path}: the ground at the start, ({start_m[0]:g}, {start_m[1]:g}) m in the area, is or lies "
            f"within ground above {limit_m:.1f} m: expected another --start, or less than --clearance {options.clearance:g}"
        )
    rings = sorted(ring_of(outline, ground) for outline in outlines(closed))
    if sum(map(len, rings)) > EXACT_CORNERS:
        rings = simplified_polygons(rings, EXACT_CORNERS, ground.cell_m, [start_m])
    return [[(in_mm(x_m), in_mm(y_m)) for x_m, y_m in ring] for ring in rings]


def filled(marked: Marks, heights_m: Floats, is_inner: Marks) -> Marks:
    """Marked cells whose outlines are simple and apart: cells that no way leads to from the edge are marked, too, and one
    of two cells between marked ones that touch at a corner, the higher one.
    """
    marked = marked & is_inner
    while True:
        rows, columns = marked.shape
        free = np.pad(~marked | ~is_inner, 1, constant_values=True).astype(np.uint8)
        regions = [shape for shape, value in shapes(free, mask=free == 1, connectivity=4) if value == 1]
        outer = [shape for shape in regions if (0.0, 0.0) in shape["coordinates"][0]]
        marked = (rasterize(outer, out_shape=free.shape, fill=0, dtype="uint8") == 0)[1 : rows + 1, 1 : columns + 1]
        again = marked.copy()
        for one, other, free_at, beside_at in CORNERS:
            pairs = part(marked, one) & part(marked, other) & ~part(marked, free_at) & ~part(marked, beside_at)
            is_beside = part(heights_m, beside_at) > part(heights_m, free_at)
            part(again, beside_at)[pairs & is_beside] = True
            part(again, free_at)[pairs & ~is_beside] = True
        if (again == marked).all():
            return marked
        marked = again


NORTH_WEST, NORTH_EAST, SOUTH_WEST, SOUTH_EAST = (0, 0), (0, 1), (1, 0), (1, 1)
"""The cells about a corner: their row and column in a square of four."""

CORNERS = [(SOUTH_WEST, NORTH_EAST, SOUTH_EAST, NORTH_WEST), (SOUTH_EAST, NORTH_WEST, SOUTH_WEST, NORTH_EAST)]
"""Two cells that touch at a corner, and the two between them."""


def part(values: Values, cell: tuple[int, int]) -> Values:
    """The cells at this place of all squares of four."""
    rows, columns = values.shape
    found: Values = values[cell[0] : rows - 1 + cell[0], cell[1] : columns - 1 + cell[1]]
    return found


def outlines(marked: Marks) -> list[list[tuple[float, float]]]:
    """The outlines of marked cells, in columns and rows."""
    found = shapes(marked.astype(np.uint8), mask=marked, connectivity=4)
    return [[(float(column), float(row)) for column, row in shape["coordinates"][0][:-1]] for shape, _ in found]


def ring_of(outline: list[tuple[float, float]], ground: Ground) -> Ring:
    """An outline in the area [m], anticlockwise from its westernmost, southernmost corner."""
    columns, rows = (np.array(along) for along in zip(*outline, strict=True))
    x_m, y_m = ground.to_area(columns, rows)
    if np.sum(x_m * np.roll(y_m, -1) - np.roll(x_m, -1) * y_m) < 0:
        x_m, y_m = x_m[::-1], y_m[::-1]
    ring = list(zip(x_m.tolist(), y_m.tolist(), strict=True))
    first = ring.index(min(ring))
    return ring[first:] + ring[:first]


def links_over(
    ground: Ground, altitude_m: float, scenario: Scenario, field: Field, sensors_m: Floats,
    own_m: Floats | None, draft: Draft
) -> str:
    """Sets the lines of a map of the rates of the radio, without links where the ground hides a sensor node, and returns
    its text.
    """
    check_places(draft, sensors_m)
    flown_m = float(scenario["uav.altitude_m"])
    radius_m = field.comm_radius_m
    gains = field.gains
    most = min(MOST_POINTS // len(sensors_m), MOST_OF_NODE)
    grid = MapGrid.over(draft.sides_m, min(ground.cell_m, radius_m), most)
    places_m = np.minimum(grid.positions_m, np.array(draft.sides_m))
    heights_m = ground.height_m(sensors_m[:, 0], sensors_m[:, 1]) if own_m is None else own_m
    farthest_m = radius_m + 2.0 * grid.step_m  # cells of the map that begin farther away are of no use
    rates_bps = np.full((len(sensors_m), len(places_m)), np.nan)
    reached = hidden = 0
    for sensor, ((x_m, y_m), height_m) in enumerate(zip(sensors_m.tolist(), heights_m.tolist(), strict=True)):
        d2_m2 = (places_m[:, 0] - x_m) ** 2 + (places_m[:, 1] - y_m) ** 2
        at = np.flatnonzero((d2_m2 <= farthest_m**2) & (altitude_m > height_m))
        seen = ground.is_in_sight((x_m, y_m, height_m), places_m[at, 0], places_m[at, 1], altitude_m)
        reached += at.size
        hidden += int(at.size - seen.sum())
        at = at[seen]
        rates = expected_rates_bps(scenario, float(gains[sensor]), d2_m2[at], altitude_m - height_m)
        rates_bps[sensor, at] = np.floor(rates + 0.5)
    blind = np.flatnonzero(~(rates_bps > 0.0).any(axis=1)).tolist()
    if blind:
        more = f", as from {len(blind) - 1} more" if len(blind) > 1 else ""
        draft.warnings.append(f"{draft.label(blind[0])}: no place of the flight has a link to it{more}: it is never served")
    setup_s = scenario["link"].get("setup_s")
    lines = [commented('model = "map"', "none where the ground hides an SN"), f'file = "{LINKS}"']
    lines += [f"setup_s = {setup_s!r}"] if setup_s is not None else []
    draft.set_map(lines, (radius_m, "Communication radius on the ground, d_c [m]"))
    blocks = f"resource_blocks = {scenario['link.resource_blocks']}"
    draft.set("link.resource_blocks", blocks, "Resource blocks, n, the most SNs served in a slot")
    draft.notes.append(
        f"links: hidden by the ground from {100.0 * hidden / max(reached, 1):.1f} % of the places in range, on a grid of "
        f"{text_of(grid.step_m)} m"
    )
    return grid.links_csv(flown_m, rates_bps, "rate_bps")


def in_mm(along_m: float) -> float:
    """A length rounded to millimetres [m]."""
    return float(np.floor(along_m * 1e3 + 0.5) / 1e3)


if __name__ == "__main__":
    sys.exit(main())
