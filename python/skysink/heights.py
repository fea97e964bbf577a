"""Heights of the ground from every grid that GDAL reads, in metres, and checked: units, voids, and limits of heights.

Rows and columns in messages are those of the file, from 1. What is refused is refused for the cells of the area only.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio.crs import CRS
from rasterio.errors import CRSError, RasterioError
from rasterio.warp import transform
from rasterio.windows import Window

from skysink._skysink import InputError
from skysink.grid_text import METRES, UNITS_M, Unit, clean, refusal
from skysink.ground import Floats, Ground, Map, Marks
from skysink.voids import jumps, voids

MOST_CELLS = 25_000_000
"""Most cells over an area."""

VERTICAL = re.compile(r'VERT(?:_CS|CS|CRS|ICALCRS)\[.*?UNIT\["([^"]+)",\s*([0-9.eE+-]+)', re.IGNORECASE | re.DOTALL)
ZUNITS = re.compile(r"^\s*zunits\s+(\S+)", re.IGNORECASE | re.MULTILINE)

WGS84 = CRS.from_epsg(4326)


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
        if crs is not None:
            try:
                named = CRS.from_user_input(crs)
            except CRSError:
                raise InputError(f"option --crs: `{crs}`: expected a reference system, such as EPSG:32633") from None
            is_known = system is not None and (system.is_geographic or system.is_projected)
            if is_known and plane_of(system) != plane_of(named):
                raise InputError(f"option --crs: {crs}: the grid {path} names another system: omit the option")
            system = system if is_known else named
        self.crs: Any = plane_of(system) if system is not None and (system.is_geographic or system.is_projected) else None
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
        is_void, why = voids(self.path, raw, heights_m, self.unit.length_m, is_named, is_inner)
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
        warnings = jumps(self.path, heights_m, is_inner, cell_m, first)
        heights_m[is_void & is_inner] = np.inf
        return Ground(self.path, heights_m, is_inner, to_cells, from_cells, cell_m, tuple(notes), tuple(warnings))

    def exact_side(self) -> float:
        """The shorter side of a cell in the coordinates of the grid."""
        return float(min(abs(self.opened.transform.a), abs(self.opened.transform.e)))

    def maps(self, origin_deg: tuple[float, float] | None, shift_m: tuple[float, float]) -> tuple[Map, Map]:
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

def span(axis: str, low: float, high: float) -> str:
    """A range of coordinates."""
    return f"{axis} = {low:.10g} to {high:.10g}"


def inner(from_cells: Map, sides_m: tuple[float, float], shape: tuple[int, ...]) -> Marks:
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
