"""Heights of the ground from every grid that GDAL reads, in metres, and checked: units, voids, and limits of heights.

Rows and columns in messages are those of the file, from 1. What is refused is refused for the cells of the area only.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.crs import CRS
from rasterio.errors import CRSError, RasterioError
from rasterio.warp import transform
from rasterio.windows import Window

from skysink._skysink import InputError

Floats = NDArray[np.float64]
Marks = NDArray[np.bool_]

MOST_CELLS = 25_000_000
"""Most cells over an area."""

LIMITS_M = (-500.0, 9000.0)
"""Heights of the ground [m], those of ``ground_m``."""

VOIDS = (-99999.0, -32768.0, -32767.0, -9999.0, -999.0, 9999.0, 32767.0, 65535.0, 99999.0)
"""Values that programs write for no height, also where the header names another."""

FAR = 1000.0
"""Difference from the median height from which on such a value is none."""

HIGH_ZERO_M = 100.0
"""Heights around a 0 [m] from which on it is no height."""

JUMP = (100.0, 5.0)
"""A rise between neighbouring cells that is doubted: metres, and times their distance."""

METRES = 1.0
FOOT = 0.3048
SURVEY_FOOT = 1200.0 / 3937.0

UNITS_M = {
    **dict.fromkeys(["m", "metre", "metres", "meter", "meters"], METRES),
    **dict.fromkeys(["ft", "foot", "feet", "international foot", "international feet"], FOOT),
    **dict.fromkeys(["us survey foot", "us survey feet", "ftus", "us-ft", "ft-us", "foot_us", "ussft"], SURVEY_FOOT),
    **dict.fromkeys(["cm", "centimetre", "centimeter", "centimetres", "centimeters"], 0.01),
    **dict.fromkeys(["dm", "decimetre", "decimeter", "decimetres", "decimeters"], 0.1),
    **dict.fromkeys(["mm", "millimetre", "millimeter", "millimetres", "millimeters"], 0.001),
}
"""Units of heights [m]."""

HEADER = re.compile(r"[A-Za-z_]\w*$")
OF_GRID = {"ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy", "nodata_value"}
OF_UNIT = {"zunits", "zunit", "units", "unit"}

VERTICAL = re.compile(r'VERT(?:_CS|CS|CRS|ICALCRS)\[.*?UNIT\["([^"]+)",\s*([0-9.eE+-]+)', re.IGNORECASE | re.DOTALL)
ZUNITS = re.compile(r"^\s*zunits\s+(\S+)", re.IGNORECASE | re.MULTILINE)

WGS84 = CRS.from_epsg(4326)


@dataclass(frozen=True)
class Unit:
    """A unit of heights, and what names it."""

    name: str
    length_m: float
    source: str


@dataclass(frozen=True)
class Ground:
    """Heights of the ground under an area.

    Places are in cells from the corner of the window of the file, columns first, so that cell (0, 0) has its middle at
    (0.5, 0.5). They may lie aslant in the area.
    """

    path: Path
    heights_m: Floats
    """Heights in the middles of the cells [m], by row as in the file; NaN for none, infinite for what is closed."""
    is_inner: Marks
    """Whether a cell lies, at least in part, in the area."""
    to_cells: Any
    """From x and y in the area [m] to columns and rows."""
    to_area: Any
    """From columns and rows to x and y in the area [m]."""
    cell_m: float
    """The shorter side of a cell, in the middle of the area [m]."""
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def is_flat(self) -> bool:
        """Whether all heights in the area are the same."""
        inner_m = self.heights_m[self.is_inner]
        return bool((inner_m == inner_m[0]).all())

    def height_m(self, x_m: Floats, y_m: Floats, is_clamped: bool = True) -> Floats:
        """The heights at places in the area [m]: bilinear between the middles of cells, and constant beyond those in
        the area if it ``is_clamped``; NaN where there is none.
        """
        heights_m = np.where(self.is_inner, self.heights_m, np.nan) if is_clamped else self.heights_m
        columns, rows = self.to_cells(x_m, y_m)
        low, part = [], []
        inner = [np.flatnonzero(self.is_inner.any(axis=axis)) for axis in (0, 1)]
        for along, within, count in zip((columns, rows), inner, self.heights_m.shape[::-1], strict=True):
            first, last = (within[0], within[-1]) if is_clamped else (0, count - 1)
            at = np.clip(along - 0.5, first, last)
            low.append(np.minimum(at.astype(int), last))
            part.append(at - low[-1])
        west, north = low
        east, south = (np.minimum(along + 1, count - 1) for along, count in zip(low, heights_m.shape[::-1], strict=True))
        corners = [heights_m[north, west], heights_m[north, east], heights_m[south, west], heights_m[south, east]]
        weights = [(1 - part[0]) * (1 - part[1]), part[0] * (1 - part[1]), (1 - part[0]) * part[1], part[0] * part[1]]
        own = heights_m[np.clip(rows.astype(int), 0, heights_m.shape[0] - 1), np.clip(columns.astype(int), 0, heights_m.shape[1] - 1)]
        found = np.zeros_like(own)
        for corner, weight in zip(corners, weights, strict=True):
            known = np.where(np.isnan(corner) & is_clamped, own, corner)  # a neighbour beyond the area
            found += np.where(weight > 0, weight * known, 0.0)
        return found

    def is_in_sight(self, from_m: tuple[float, float, float], x_m: Floats, y_m: Floats, uav_m: float) -> Marks:
        """Whether a UAV at the height ``uav_m`` [m] over places in the area is in sight from a point [m]: the ray
        between them passes above the higher end of every edge that it crosses between the middles of neighbours.
        """
        begin = [float(along[0]) - 0.5 for along in self.to_cells(np.array([from_m[0]]), np.array([from_m[1]]))]
        end = [along - 0.5 for along in self.to_cells(x_m, y_m)]
        height_m = from_m[2]
        seen = np.ones(x_m.shape, dtype=bool)
        known_m = np.where(np.isnan(self.heights_m) | ~self.is_inner, -np.inf, self.heights_m)
        for axis in (0, 1):
            of_line = known_m.T if axis == 0 else known_m
            run = end[axis] - begin[axis]
            low, high = np.minimum(begin[axis], end[axis]), np.maximum(begin[axis], end[axis])
            first = max(int(np.ceil(low.min(initial=0))), 0)
            last = min(int(np.floor(high.max(initial=0))), of_line.shape[0] - 1)
            for line in range(first, last + 1):
                at = np.flatnonzero(seen & (low <= line) & (line <= high) & (run != 0))
                part = (line - begin[axis]) / run[at]
                across = begin[1 - axis] + part * (end[1 - axis][at] - begin[1 - axis])
                across = np.clip(across, 0, of_line.shape[1] - 1)
                edge_m = np.maximum(of_line[line, np.floor(across).astype(int)], of_line[line, np.ceil(across).astype(int)])
                seen[at] &= (part <= 0) | (height_m + part * (uav_m - height_m) > edge_m)
        return seen


def refusal(path: Path, message: str) -> InputError:
    """An error about a grid."""
    return InputError(f"terrain {path}: {message}")


class Grid:
    """An open grid."""

    def __init__(self, path: Path, opened: Any, crs: str | None, header_unit: Unit | None) -> None:
        self.path = path
        self.opened = opened
        if opened.count != 1:
            raise refusal(path, f"{opened.count} bands: expected one of heights, as `gdal_translate -b 1` makes it")
        if opened.transform.is_identity:
            raise refusal(path, "it does not say where it lies: expected a grid with coordinates, as gdalwarp makes it")
        system = opened.crs
        if system is None and crs is not None:
            try:
                system = CRS.from_user_input(crs)
            except CRSError:
                raise InputError(f"option --crs: `{crs}`: expected a reference system, such as EPSG:32633") from None
        self.crs = plane_of(system) if system is not None and (system.is_geographic or system.is_projected) else None
        self.unit = self.unit_of(system, header_unit)

    def unit_of(self, system: Any, header_unit: Unit | None) -> Unit:
        """The unit of heights: by the header, the reference system, the file ``.prj`` and the band, which must agree."""
        found = [header_unit] if header_unit else []
        prj = next((file for file in (self.path.with_suffix(end) for end in (".prj", ".PRJ")) if file.is_file()), None)
        texts = [("its reference system", system.to_wkt() if system is not None else "")]
        if prj is not None:
            texts.append((prj.name, prj.read_bytes().decode("utf-8-sig", errors="replace")))
        for source, text in texts:
            for name, length in VERTICAL.findall(text):
                found.append(Unit(name, float(length), source))
            for name in ZUNITS.findall(text):
                if name.upper() != "NO":
                    found.append(self.named(name, source))
        if self.opened.units[0]:
            found.append(self.named(self.opened.units[0], "its band"))
        for one, other in zip(found, found[1:], strict=False):
            if abs(one.length_m / other.length_m - 1) > 1e-5:
                raise refusal(
                    self.path,
                    f"heights in `{one.name}` by {one.source}, in `{other.name}` by {other.source}: expected one unit",
                )
        return found[0] if found else Unit("metre", METRES, "default")

    def named(self, name: str, source: str) -> Unit:
        """A unit by its name."""
        length_m = UNITS_M.get(name.strip().lower())
        if length_m is None:
            raise refusal(
                self.path,
                f"heights in `{name}` by {source}: expected metres or feet: convert them by "
                '`gdal_calc.py --calc="A*FACTOR"`, and remove the unit',
            )
        return Unit(name, length_m, source)

    @property
    def is_projected(self) -> bool:
        """Whether its coordinates are lengths of a known system."""
        return self.crs is not None and not self.crs.is_geographic

    def check_metres(self, sensors: Path) -> None:
        """Refuses a system with which positions in metres can have nothing in common."""
        if self.crs is None:
            cell_m = abs(self.opened.transform.a)
            if cell_m < 0.1:
                raise refusal(self.path, f"cells of {cell_m}: degrees? expected metres, or their system by --crs EPSG:4326")
            return
        if self.crs.is_geographic:
            raise InputError(
                f"sensor positions {sensors}: metres, and {self.path} is in degrees: expected positions as lat and lon, "
                "or a grid in the metres of the list, as gdalwarp -t_srs EPSG:32633 makes them for zone 33 of UTM"
            )
        unit, length_m = self.crs.linear_units_factor
        if abs(length_m - 1) > 1e-4:
            raise InputError(
                f"sensor positions {sensors}: metres, and {self.path} is in `{unit}`, {length_m} m: expected positions as "
                "lat and lon, or a grid in metres"
            )

    def degrees(self, positions: Floats) -> Floats:
        """Positions in the coordinates of the grid as latitudes and longitudes [°], [N, 2]."""
        lon_deg, lat_deg = transform(self.crs, WGS84, positions[:, 0].tolist(), positions[:, 1].tolist())
        return np.stack([lat_deg, lon_deg], axis=1)

    def under(
        self, sides_m: tuple[float, float], origin_deg: tuple[float, float] | None, shift_m: tuple[float, float], are_voids_closed: bool
    ) -> Ground:
        """The ground under an area with its south-west corner at ``origin_deg``, or by ``shift_m`` beside the grid.

        Raises :class:`skysink.InputError` if there is not a height in all of the area.
        """
        width_m, height_m = sides_m
        to_pixels, to_area = self.maps(origin_deg, shift_m)
        along = np.linspace(0.0, 1.0, 65)
        edge_x = np.concatenate([along * width_m, along * width_m, np.zeros(65), np.full(65, width_m)])
        edge_y = np.concatenate([np.zeros(65), np.full(65, height_m), along * height_m, along * height_m])
        columns, rows = to_pixels(edge_x, edge_y)
        slack = 1e-6
        if not np.isfinite(columns).all() or min(columns.min(), rows.min()) < -slack or (
            columns.max() > self.opened.width + slack or rows.max() > self.opened.height + slack
        ):
            raise refusal(self.path, self.beyond(edge_x, edge_y, origin_deg, shift_m))
        # A cell more on each side, between whose middles heights are interpolated.
        first = [max(int(np.floor(along.min() + slack)) - 1, 0) for along in (columns, rows)]
        last = [
            min(int(np.ceil(along.max() - slack)) + 1, count)
            for along, count in zip((columns, rows), (self.opened.width, self.opened.height), strict=True)
        ]
        count = [end - begin for begin, end in zip(first, last, strict=True)]
        if count[0] * count[1] > MOST_CELLS:
            expected = f"expected at most {MOST_CELLS}, as gdalwarp -tr makes them"
            raise refusal(self.path, f"{count[0]} × {count[1]} cells under the area: {expected}")
        window = Window(first[0], first[1], count[0], count[1])
        try:
            raw = self.opened.read(1, window=window).astype(np.float64)
            is_named = self.opened.read_masks(1, window=window) == 0
        except RasterioError as error:
            raise refusal(self.path, f"{one_line(error)}: expected a whole grid") from None

        def to_cells(x_m: Floats, y_m: Floats) -> tuple[Floats, Floats]:
            columns, rows = to_pixels(x_m, y_m)
            return columns - first[0], rows - first[1]

        def from_cells(columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
            x_m, y_m = to_area(columns + first[0], rows + first[1])
            return x_m, y_m

        is_inner = inner(from_cells, sides_m, raw.shape)
        scale, offset = self.opened.scales[0], self.opened.offsets[0]
        heights_m = (raw * scale + offset) * self.unit.length_m
        is_void, why = self.voids(raw, heights_m, is_named, is_inner)
        notes = []
        if self.unit.length_m != METRES:
            notes.append(f"terrain: heights in `{self.unit.name}`, by {self.unit.source}, are converted to metres")
        if (is_void & is_inner).any():
            row, column = (int(along[0]) for along in np.nonzero(is_void & is_inner))
            place = f"row {row + first[1] + 1} of the heights, column {column + first[0] + 1}"
            if not are_voids_closed:
                raise refusal(self.path, f"{place}: {why(row, column)}")
            closed = int((is_void & is_inner).sum())
            notes.append(f"terrain: {closed} cells without a height, the first in {place}, are closed")
        heights_m[is_void] = np.nan
        middle = np.array([width_m / 2]), np.array([height_m / 2])
        middle_cell = to_cells(*middle)
        sides = [from_cells(middle_cell[0] + step, middle_cell[1] + 1 - step) for step in (0, 1)]
        cell_m = min(float(np.hypot(x_m - middle[0], y_m - middle[1])[0]) for x_m, y_m in sides)
        cell_m = self.exact_side() if self.crs is None else float(f"{cell_m:.3g}")
        warnings = self.jumps(heights_m, is_inner, cell_m, first)
        heights_m[is_void & is_inner] = np.inf
        return Ground(self.path, heights_m, is_inner, to_cells, from_cells, cell_m, tuple(notes), tuple(warnings))

    def exact_side(self) -> float:
        """The shorter side of a cell in the coordinates of the grid."""
        return float(min(abs(self.opened.transform.a), abs(self.opened.transform.e)))

    def maps(self, origin_deg: tuple[float, float] | None, shift_m: tuple[float, float]) -> tuple[Any, Any]:
        """From the area [m] to columns and rows of the file, and back."""
        affine = self.opened.transform
        system = None
        if origin_deg is not None:
            system = plane_at(origin_deg)
        elif affine.b or affine.d:
            raise refusal(self.path, "it is turned: expected rows from west to east, as gdalwarp makes them")

        def to_pixels(x_m: Floats, y_m: Floats) -> tuple[Floats, Floats]:
            if system is None:
                return (x_m - shift_m[0] - affine.c) / affine.a, (y_m - shift_m[1] - affine.f) / affine.e
            xs, ys = transform(system, self.crs, x_m.tolist(), y_m.tolist())
            return through(~affine, np.array(xs), np.array(ys))

        def to_area(columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
            if system is None:
                return affine.c + shift_m[0] + columns * affine.a, affine.f + shift_m[1] + rows * affine.e
            east, north = through(affine, columns, rows)
            xs, ys = transform(self.crs, system, east.tolist(), north.tolist())
            return np.array(xs), np.array(ys)

        return to_pixels, to_area

    def beyond(
        self, edge_x: Floats, edge_y: Floats, origin_deg: tuple[float, float] | None, shift_m: tuple[float, float]
    ) -> str:
        """Says that the grid does not lie under all of the area."""
        bounds = self.opened.bounds
        columns, rows = self.maps(origin_deg, shift_m)[0](edge_x, edge_y)
        xs, ys = through(self.opened.transform, columns, rows)
        covered = span("x", bounds.left, bounds.right) + ", " + span("y", bounds.bottom, bounds.top)
        needed = span("x", np.min(xs), np.max(xs)) + ", " + span("y", np.min(ys), np.max(ys))
        return f"{covered}: expected the ground under all of the area, {needed}, in the coordinates of the grid"

    def voids(self, raw: Floats, heights_m: Floats, is_named: Marks, is_inner: Marks) -> tuple[Marks, Any]:
        """The cells without a height, and why one is none."""
        is_finite = np.isfinite(raw)
        is_limited = (heights_m >= LIMITS_M[0]) & (heights_m <= LIMITS_M[1])
        usual = raw[is_finite & is_limited & ~is_named & is_inner & ~np.isin(raw, VOIDS)]
        median = float(np.median(usual)) if usual.size else 0.0
        is_usual_void = np.isin(raw, VOIDS) & (np.abs(raw - median) > FAR)
        is_zero = high_zeros(raw, heights_m, is_finite & is_limited & ~is_named)
        is_void = is_named | ~is_finite | ~is_limited | is_usual_void | is_zero

        def why(row: int, column: int) -> str:
            value = text(raw[row, column])
            if is_named[row, column]:
                return f"{value}, NODATA_value: expected a height in all of the area: {FILL}"
            if is_zero[row, column]:
                return f"0, where the ground around it is {HIGH_ZERO_M:g} m and higher: no height? {name_it('0', self.path)}"
            in_metres = "" if self.unit.length_m == METRES or not is_finite[row, column] else f" ({heights_m[row, column]:.1f} m)"
            expected = f"expected {LIMITS_M[0]:g} to {LIMITS_M[1]:g} m"
            remedy = FILL if np.isnan(raw[row, column]) else name_it(value, self.path)
            return f"{value}{in_metres}: no height? {expected}: {remedy}"

        return is_void, why

    def jumps(self, heights_m: Floats, is_inner: Marks, cell_m: float, first: list[int]) -> list[str]:
        """Says where neighbours differ by more than ground does."""
        most_m = JUMP[0] + JUMP[1] * cell_m
        inner_m = np.where(is_inner & np.isfinite(heights_m), heights_m, np.nan)
        for axis in (0, 1):
            found = np.argwhere(np.abs(np.diff(inner_m, axis=axis)) > most_m)
            if found.size:
                row, column = found[0]
                beside = inner_m[row + 1, column] if axis == 0 else inner_m[row, column + 1]
                return [
                    f"terrain {self.path}: row {row + first[1] + 1} of the heights, column {column + first[0] + 1}: "
                    f"{inner_m[row, column]:g} m beside {beside:g} m, in {found.shape[0]} places: are they heights?"
                ]
        return []


FILL = "fill it by gdal_fillnodata.py, or close such cells by --voids zones"


def name_it(value: str, path: Path) -> str:
    """What to do about a value that is no height."""
    return f"name it by NODATA_value (gdal_edit.py -a_nodata {value} {path.name}), and {FILL}"


def text(value: float) -> str:
    """A value of a grid."""
    return f"{value:.10g}"


def span(axis: str, low: float, high: float) -> str:
    """A range of coordinates."""
    return f"{axis} = {low:.10g} to {high:.10g}"


def high_zeros(raw: Floats, heights_m: Floats, is_known: Marks) -> Marks:
    """The cells that are exactly 0 where all ground around them is high: a void, or a height that was clamped."""
    is_zero = is_known & (raw == 0)
    if not is_zero.any() or is_zero.all():
        return np.zeros_like(is_zero)
    # A low cell beside some of them, such as a beach, makes all that hang together heights.
    is_low = is_known & ~is_zero & (heights_m < HIGH_ZERO_M)
    is_sea = np.zeros_like(is_zero)
    grown = is_zero & beside(is_low)
    while (grown & ~is_sea).any():
        is_sea |= grown
        grown = is_zero & beside(is_sea)
    has_others = is_known & ~is_zero
    return is_zero & ~is_sea if has_others.any() else np.zeros_like(is_zero)


def beside(marked: Marks) -> Marks:
    """The cells with a marked neighbour, also at a corner."""
    padded = np.pad(marked, 1)
    rows, columns = marked.shape
    found = np.zeros_like(marked)
    for row in range(3):
        for column in range(3):
            found |= padded[row : row + rows, column : column + columns]
    return found


def inner(from_cells: Any, sides_m: tuple[float, float], shape: tuple[int, ...]) -> Marks:
    """The cells that have ground in common with the area."""
    rows, columns = shape
    found = np.zeros((rows, columns), dtype=bool)
    slack_m = 1e-6
    along = np.arange(columns + 1.0)
    x_m, y_m = from_cells(along, np.zeros(columns + 1))
    for row in range(rows):
        next_x_m, next_y_m = from_cells(along, np.full(columns + 1, row + 1.0))
        is_inner = np.ones(columns, dtype=bool)
        for one, other, side_m in ((x_m, next_x_m, sides_m[0]), (y_m, next_y_m, sides_m[1])):
            corners = np.stack([one[:-1], one[1:], other[:-1], other[1:]])
            is_inner &= (corners.max(axis=0) > slack_m) & (corners.min(axis=0) < side_m - slack_m)
        found[row] = is_inner
        x_m, y_m = next_x_m, next_y_m
    return found


def through(affine: Any, along: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Coordinates through an affine map."""
    return affine.a * along + affine.b * across + affine.c, affine.d * along + affine.e * across + affine.f


def plane_at(origin_deg: tuple[float, float]) -> Any:
    """The plane of an area: it touches the ellipsoid at its south-west corner."""
    lat_deg, lon_deg = origin_deg
    return CRS.from_string(f"+proj=ortho +lat_0={lat_deg!r} +lon_0={lon_deg!r} +datum=WGS84 +units=m +no_defs")


def in_area(positions_deg: Floats, origin_deg: tuple[float, float]) -> Floats:
    """Latitudes and longitudes as places in the area [m], [N, 2]."""
    x_m, y_m = transform(WGS84, plane_at(origin_deg), positions_deg[:, 1].tolist(), positions_deg[:, 0].tolist())
    return np.stack([x_m, y_m], axis=1)


def plane_of(system: Any) -> Any:
    """The part of a reference system that is about places on the ground, without heights."""
    wkt = system.to_wkt()
    if not wkt.startswith(("COMPD_CS[", "COMPOUNDCRS[")):
        return system
    begin = wkt.index(",") + 1
    depth = 0
    is_quoted = False
    for at in range(begin, len(wkt)):
        is_quoted ^= wkt[at] == '"'
        depth += 0 if is_quoted else (wkt[at] == "[") - (wkt[at] == "]")
        if depth == 0 and wkt[at] == "]":
            return CRS.from_wkt(wkt[begin : at + 1])
    return system


def one_line(error: Exception) -> str:
    """The message of an error of GDAL."""
    return " ".join(str(error.__cause__ or error).split())


@contextmanager
def opened(path: Path, crs: str | None) -> Iterator[Grid]:
    """Opens a grid. Raises :class:`skysink.InputError` for what is none."""
    with ExitStack() as stack:
        try:
            with path.open("rb") as file:
                file.read(1)
        except OSError as error:
            raise refusal(path, error.strerror or "cannot be read") from None
        copy, unit = clean(path, Path(stack.enter_context(tempfile.TemporaryDirectory())))
        stack.enter_context(rasterio.Env(AAIGRID_DATATYPE="Float64", CPL_LOG="/dev/null"))
        try:
            grid = stack.enter_context(rasterio.open(copy))
        except RasterioError as error:
            message = one_line(error).replace(str(copy), str(path))
            raise refusal(path, f"{message}: expected a grid of heights that GDAL reads") from None
        yield Grid(path, grid, crs, unit)


def clean(path: Path, folder: Path) -> tuple[Path, Unit | None]:
    """An Esri ASCII grid without what GDAL does not read: marks of byte order, words for no height, a unit. Returns the
    path of the grid, which is that of other formats, and the unit of its header.

    GDAL takes words for 0, and so heights that are none are refused here, with their line.
    """
    with path.open("rb") as file:
        head = file.read(64)
    marks = [(b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")]
    encoding = next((name for mark, name in marks if head.startswith(mark)), "latin-1")
    if head.decode(encoding, errors="replace").lower().split()[:1] not in [[key] for key in sorted(OF_GRID | OF_UNIT)]:
        return path, None
    lines = path.read_bytes().decode(encoding, errors="replace").splitlines()
    unit = None
    kept: list[str] = []
    sizes: dict[str, str] = {}
    count = 0
    for number, line in enumerate(lines, 1):
        words = line.split()
        if count == 0 and words and HEADER.match(words[0]) and words[0].lower() not in {"nan", "inf", "infinity"}:
            key = words[0].lower()
            if key in OF_UNIT and len(words) > 1:
                name = " ".join(words[1:])
                if name.lower() not in UNITS_M:
                    raise refusal(path, f"line {number}: heights in `{name}`: expected metres or feet")
                unit = Unit(name, UNITS_M[name.lower()], "its header")
                continue
            if key not in OF_GRID and len(words) > 2:
                raise refusal(path, f"line {number}: `{words[0][:60]}`: expected a height")
            if key not in OF_GRID or len(words) != 2 or not is_number(words[1]):
                expected = "expected ncols, nrows, xllcorner, yllcorner, cellsize, dx, dy or NODATA_value, and a number"
                raise refusal(path, f"line {number}: `{line.strip()[:60]}`: {expected}")
            sizes[key] = words[1]
            kept.append(f"{words[0]} {words[1]}")
            continue
        try:
            np.array(words, dtype=np.float64)
        except ValueError:
            words = [height(path, number, word) for word in words]
        count += len(words)
        kept.append(" ".join(words))
    try:
        expected_count = int(sizes["ncols"]) * int(sizes["nrows"])
    except (KeyError, ValueError):
        missing = next((key for key in ("ncols", "nrows") if key not in sizes), "ncols")
        raise refusal(path, f"{missing} = {sizes.get(missing, '')}: expected a whole number in the header") from None
    if count != expected_count:
        size = f"ncols × nrows = {sizes['ncols']} × {sizes['nrows']}"
        raise refusal(path, f"{count} heights: expected {size}")
    copy = folder / f"{path.stem}.asc"
    copy.write_text("\n".join(kept) + "\n", encoding="ascii", errors="replace")
    for end in (".prj", ".PRJ"):
        if path.with_suffix(end).is_file():
            copy.with_suffix(".prj").write_bytes(path.with_suffix(end).read_bytes())
    return copy, unit


def is_number(word: str) -> bool:
    """Whether a word is a number of a header."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def height(path: Path, line: int, word: str) -> str:
    """The number of a word among heights."""
    if word.upper().lstrip("+-").startswith("1.#"):  # as programs on Windows print NaN and infinity
        return "nan"
    number = word.replace(",", ".", 1)
    if not is_number(number):
        raise refusal(path, f"line {line}: `{word[:60]}`: expected a height")
    return number
