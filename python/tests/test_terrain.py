"""Scenarios over hills: what the executable made before, grids of other programs, units, systems, voids, and refusals."""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

import skysink
from skysink import heights, terrain

rasterio = pytest.importorskip("rasterio")

SURVEYS = ROOT / "python" / "tests" / "surveys"

UTM = "EPSG:32632"
CORNER_M = (460_000.0, 5_240_000.0)
"""The south-west corner of grids, near Zurich, where north of the map is 0.4 degrees beside north."""

PLACES_M = [(20.0, 30.0), (580.0, 30.0), (20.0, 370.0), (580.0, 370.0)]
"""Sensor nodes from the corner."""

START_M = (50.0, 50.0)


def cone(columns: int = 60, rows: int = 40, cell_m: float = 10.0) -> Any:
    """160 m high in the middle, 0.5 m lower each metre from there, down to 100 m; the first row is the northernmost."""
    x_m = (np.arange(columns) + 0.5) * cell_m - columns * cell_m / 2
    y_m = (np.arange(rows) + 0.5) * cell_m - rows * cell_m / 2
    return (100 + np.maximum(0.0, 60 - 0.5 * np.hypot(x_m, y_m[::-1, None]))).astype(np.float32)


def write(path: Path, values: Any, crs: str | None = UTM, **options: Any) -> None:
    """Writes a grid of cells of 10 m."""
    units, scale = options.pop("units", None), options.pop("scale", None)
    place = rasterio.transform.from_origin(CORNER_M[0], CORNER_M[1] + 10 * values.shape[0], 10, 10)
    options = {"driver": "GTiff", "crs": crs, "transform": place, "nodata": None, **options}
    with rasterio.open(
        path, "w", width=values.shape[1], height=values.shape[0], count=1, dtype=values.dtype, **options
    ) as grid:
        grid.write(values, 1)
        if units:
            grid.units = (units,)
        if scale:
            grid.scales = (scale,)


def degrees(place_m: tuple[float, float]) -> tuple[float, float]:
    """Latitude and longitude of a place from the corner [m]."""
    lon, lat = rasterio.warp.transform(UTM, "EPSG:4326", [CORNER_M[0] + place_m[0]], [CORNER_M[1] + place_m[1]])
    return lat[0], lon[0]


START_DEG = "{:.8f},{:.8f}".format(*degrees(START_M))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An own folder with sensor nodes in degrees and in metres."""
    monkeypatch.chdir(tmp_path)
    rows = ["{:.8f},{:.8f},n{}\n".format(*degrees(place_m), number) for number, place_m in enumerate(PLACES_M)]
    Path("deg.csv").write_text("lat,lon,name\n" + "".join(rows))
    rows = [f"{CORNER_M[0] + x_m},{CORNER_M[1] + y_m},n{number}\n" for number, (x_m, y_m) in enumerate(PLACES_M)]
    Path("utm.csv").write_text("x_m,y_m,name\n" + "".join(rows))
    return tmp_path


def make(grid: str, *options: str, sensors: str = "deg.csv", start: str = START_DEG, out: str = "out") -> dict[str, Any]:
    """The keys of the scenario over a grid."""
    words = ["hill", "--sensors", sensors, "--terrain", grid, "--out", out, "--force", "--start", start, *options]
    assert terrain.main(words) == 0
    return tomllib.loads(Path(out, "hill.toml").read_text())


Refused = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refused:
    """The line of a refusal, which leaves nothing."""

    def run(grid: str, *options: str, sensors: str = "deg.csv", start: str = START_DEG) -> str:
        capsys.readouterr()
        code = terrain.main(["a", "--sensors", sensors, "--terrain", grid, "--start", start, "--out", "none", *options])
        said = capsys.readouterr()
        assert (code, said.out, said.err.count("\n"), Path("none").exists()) == (2, "", 1, False), said
        return said.err

    return run


def ground_m(out: str = "out") -> list[float]:
    """The ground at the sensor nodes [m]."""
    with Path(out, "sensors.csv").open(newline="") as file:
        return [float(row["ground_m"]) for row in csv.DictReader(file)]


def zones(keys: dict[str, Any]) -> list[Any]:
    """The corners of the no-fly zones [m]."""
    return [np.array(zone["polygon_m"]) for zone in keys["area"].get("no_fly", [])]


def encloses(ring: Any, x_m: float, y_m: float) -> bool:
    """Whether a polygon encloses a place."""
    other = np.roll(ring, -1, axis=0)
    crosses = (ring[:, 1] > y_m) != (other[:, 1] > y_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = ring[:, 0] + (y_m - ring[:, 1]) / (other[:, 1] - ring[:, 1]) * (other[:, 0] - ring[:, 0])
    return bool((crosses & (at > x_m)).sum() % 2)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("hill", ["--start", "3060,7060"]),
        ("ridge", ["--start", "3060,7110", "--clearance", "0", "--radio", "lora-sf7", "--drone", "x500"]),
    ],
)
def test_the_scenario_stays_that_of_the_executable_before(name: str, options: list[str]) -> None:
    grid = ["--sensors", str(SURVEYS / "nodes.csv"), "--terrain", str(SURVEYS / "hill.asc")]
    assert terrain.main([name, *grid, *options]) == 0
    golden = SURVEYS / "golden" / name
    for file in golden.glob("*.csv"):
        assert Path(name, file.name).read_bytes() == file.read_bytes(), file
    keys = [tomllib.loads((folder / f"{name}.toml").read_text()) for folder in (Path(name), golden)]
    assert keys[0] == keys[1]
    scenario = skysink.Scenario.load(Path(name, f"{name}.toml"))
    assert len(skysink.simulate(scenario.replace({"slots": 20}), "uts")) == 20


def test_the_contour_of_a_cone_becomes_a_zone_wherever_north_is(capsys: pytest.CaptureFixture[str]) -> None:
    # 20 m over 100 m: the ground above 110 m is closed, within 100 m of the middle, and a cell and a half at most beyond.
    write(Path("dem.tif"), cone())
    for sensors, start in [("deg.csv", START_DEG), ("utm.csv", "460050,5240050")]:
        keys = make("dem.tif", sensors=sensors, start=start)
        assert "100.0 m at the start, 120.0 m in flight, 1 no-fly zones where the ground is above 110.0 m" in capsys.readouterr().out
        [ring] = zones(keys)
        origin = (keys["area"]["origin_lat_deg"], keys["area"]["origin_lon_deg"])
        [middle] = heights.in_area(np.array([degrees((300.0, 200.0))]), origin)
        radii_m = np.hypot(*(ring - middle).T)
        assert 95.0 <= radii_m.max() <= 115.0
        for angle in range(0, 360, 5):
            rim = middle + (99.0 - 7.1) * np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
            assert encloses(ring, *rim), angle
    # The sides of cells point to the north of the map, which is 0.4 degrees west of north here.
    side = ring[1] - ring[0]
    assert 0.2 < abs(math.degrees(math.atan2(*sorted(abs(side))))) < 0.6


def test_positions_in_metres_and_degrees_become_the_same_area() -> None:
    write(Path("dem.tif"), cone())
    of_degrees = make("dem.tif", out="degrees")
    of_metres = make("dem.tif", sensors="utm.csv", start="460050,5240050", out="metres")
    assert of_degrees["area"]["origin_lat_deg"] == pytest.approx(of_metres["area"]["origin_lat_deg"], abs=1e-7)
    assert np.allclose(zones(of_degrees)[0], zones(of_metres)[0], atol=0.05)
    assert ground_m("degrees") == ground_m("metres") == [100.0] * 4
    # A grid without a system is in the metres of the list, and a list in degrees needs one.
    write(Path("plain.tif"), cone(), crs=None)
    plane = make("plain.tif", sensors="utm.csv", start="460050,5240050", out="plane")
    assert "origin_lat_deg" not in plane["area"] and len(zones(plane)) == 1
    named = make("plain.tif", "--crs", UTM, out="named")
    assert np.allclose(zones(named)[0], zones(of_degrees)[0])


def test_a_grid_in_degrees_is_read(refused: Refused) -> None:
    (south, west), (north, east) = degrees((-40.0, -40.0)), degrees((640.0, 440.0))
    columns, rows = 70, 60
    place = rasterio.transform.from_origin(west, north, (east - west) / columns, (north - south) / rows)
    lon, lat = (along.ravel() for along in np.meshgrid(place.c + place.a * (np.arange(columns) + 0.5), place.f + place.e * (np.arange(rows) + 0.5)))
    x_m, y_m = (np.array(along) for along in rasterio.warp.transform("EPSG:4326", UTM, lon.tolist(), lat.tolist()))
    away_m = np.hypot(x_m - CORNER_M[0] - 300, y_m - CORNER_M[1] - 200).reshape(rows, columns)
    values = (100 + np.maximum(0.0, 60 - 0.5 * away_m)).astype(np.float32)
    write(Path("geo.tif"), values, crs="EPSG:4326", transform=place)
    write(Path("dem.tif"), cone())
    areas_m2 = []
    for grid in ("geo.tif", "dem.tif"):
        [ring] = zones(make(grid))
        other = np.roll(ring, -1, axis=0)
        areas_m2.append(float(np.sum(ring[:, 0] * other[:, 1] - other[:, 0] * ring[:, 1])) / 2)
    assert areas_m2[0] == pytest.approx(math.pi * 100.0**2, rel=0.05)
    assert areas_m2[0] == pytest.approx(areas_m2[1], rel=0.05)
    assert "metres, and geo.tif is in degrees: expected positions as lat and lon" in refused("geo.tif", sensors="utm.csv", start="460050,5240050")


FEET = "VERT_CS[\"height (ftUS)\",VERT_DATUM[\"height\",2005],UNIT[\"US survey foot\",0.304800609601219]]"


@pytest.mark.parametrize("source", ["band", "compound", "prj", "zunits", "header", "vertcs"])
def test_heights_in_feet_become_metres(source: str, capsys: pytest.CaptureFixture[str]) -> None:
    length_m = 0.3048 if source in ("band", "zunits", "header") else 1200 / 3937
    values = (cone() / length_m).astype(np.float32)
    crs = rasterio.crs.CRS.from_user_input(UTM)
    if source == "band":
        write(Path("dem.tif"), values, units="ft")
    elif source == "compound":
        write(Path("dem.tif"), values, crs=rasterio.crs.CRS.from_user_input("EPSG:32632+6360"))
    else:
        write(Path("made.tif"), values)
        text = ascii_of(values)
        Path("dem.tif").write_text(text if source != "header" else "zunits feet\n" + text)
        plane = crs.to_wkt()
        Path("dem.prj").write_text(
            {
                "prj": f'COMPD_CS["a",{plane},{FEET}]',
                "vertcs": f"{plane},{FEET.replace('VERT_CS', 'VERTCS').replace('VERT_DATUM', 'VDATUM')}",
                "zunits": "Projection UTM\nZone 32\nDatum WGS84\nZunits FEET\nUnits METERS\nSpheroid WGS84\nParameters\n",
                "header": plane,
            }[source]
        )
    keys = make("dem.tif", "--crs", UTM)
    assert "are converted to metres" in capsys.readouterr().out
    assert ground_m() == pytest.approx([100.0] * 4, abs=0.02)
    assert 95.0 < np.ptp(zones(keys)[0][:, 0]) / 2 < 115.0


def ascii_of(values: Any, head: str = "cellsize 10\nNODATA_value -9999\n") -> str:
    """An Esri ASCII grid."""
    size = f"ncols {values.shape[1]}\nnrows {values.shape[0]}\nxllcorner {CORNER_M[0]}\nyllcorner {CORNER_M[1]}\n"
    return size + head + "".join(" ".join(f"{value:.3f}" for value in row) + "\n" for row in values.tolist())


def test_other_units_are_refused_by_their_name(refused: Refused) -> None:
    write(Path("dem.tif"), cone(), units="fathom")
    assert "heights in `fathom` by its band: expected metres or feet" in refused("dem.tif")
    write(Path("dem.tif"), cone(), units="m", crs=rasterio.crs.CRS.from_user_input("EPSG:32632+6360"))
    assert "heights in `US survey foot` by its reference system, in `m` by its band: expected one unit" in refused("dem.tif")
    Path("dem.asc").write_text("units cubits\n" + ascii_of(cone()))
    assert "line 1: heights in `cubits`: expected metres or feet" in refused("dem.asc", "--crs", UTM)


def test_a_scale_of_the_band_is_applied() -> None:
    write(Path("dem.tif"), np.round(cone() * 10).astype(np.int16), scale=0.1)
    assert len(zones(make("dem.tif"))) == 1 and ground_m() == pytest.approx([100.0] * 4)


VOID = (15, 30)
"""The row and column of a cell near the top of the cone."""


@pytest.mark.parametrize(
    ("value", "nodata", "why"),
    [
        (-9999.0, -9999.0, "-9999, NODATA_value: expected a height in all of the area"),
        (-9999.0, None, "-9999: no height? expected -500 to 9000 m"),
        (-32768.0, None, "-32768: no height? expected -500 to 9000 m: name it by NODATA_value (gdal_edit.py -a_nodata -32768 dem.tif)"),
        (-32768.0, -9999.0, "-32768: no height?"),
        (-32767.0, -9999.0, "-32767: no height?"),
        (-999.0, -9999.0, "-999: no height?"),
        (9999.0, -9999.0, "9999: no height?"),
        (99999.0, -9999.0, "99999: no height?"),
        (-3.4028235e38, -9999.0, "-3.402823466e+38: no height?"),
        (math.nan, -9999.0, "nan: no height?"),
        (math.nan, math.nan, "nan, NODATA_value"),
        (math.inf, None, "inf: no height?"),
        (9000.5, None, "9000.5: no height?"),
        (0.0, None, "0, where the ground around it is 100 m and higher: no height?"),
    ],
)
def test_a_void_is_refused_in_the_area_a_zone_if_asked_and_harmless_outside(
    value: float, nodata: float | None, why: str, refused: Refused, capsys: pytest.CaptureFixture[str]
) -> None:
    values = cone()
    values[VOID] = value
    write(Path("dem.tif"), values, nodata=nodata)
    assert f"skysink: terrain dem.tif: row 16 of the heights, column 31: {why}" in refused("dem.tif")
    # A hill whose top is a void is a zone, whatever is around it.
    for row in (slice(14, 17), slice(0, 40)):
        flat = np.full_like(values, 105.0)
        flat[row, 29:32] = value if row.start else 105.0
        flat[VOID] = value
        write(Path("flat.tif"), flat, nodata=nodata)
        keys = make("flat.tif", "--voids", "zones", out=f"flat-{row.start}")
        assert len(zones(keys)) == 1 and "1 no-fly zones" in capsys.readouterr().out
    # The cell in the corner is outside of the area, which begins 10 m beside the sensor nodes.
    values = cone()
    values[0, 0] = values[39, 59] = value
    write(Path("dem.tif"), values, nodata=nodata)
    assert len(zones(make("dem.tif"))) == 1


def test_feet_that_look_like_a_void_are_heights_among_such_heights(refused: Refused) -> None:
    # 9999 ft is 3047.7 m, of which the neighbours are a few feet away.
    values = np.full((40, 60), 10_000.0, dtype=np.float32) - np.arange(60, dtype=np.float32)
    write(Path("dem.tif"), values, units="ft")
    make("dem.tif")
    assert max(ground_m()) < 3048.0
    # Among 500 ft it is none, although 3048 m would be a height.
    values = np.full((40, 60), 500.0, dtype=np.float32)
    values[VOID] = 9999.0
    write(Path("dem.tif"), values, units="ft")
    assert "column 31: 9999 (3047.7 m): no height?" in refused("dem.tif")


def test_the_sea_beside_a_cliff_is_ground_and_a_jump_is_doubted(capsys: pytest.CaptureFixture[str]) -> None:
    values = np.full((40, 60), 104.0, dtype=np.float32)
    values[:, :15] = 0.0
    values[39, 15] = 3.0  # a beach
    write(Path("sea.tif"), values)
    make("sea.tif", start="{:.8f},{:.8f}".format(*degrees((300.0, 200.0))))
    assert "are they heights" not in capsys.readouterr().err
    assert ground_m() == [0.0, 104.0, 0.0, 104.0]
    values[VOID] = 700.0
    write(Path("jump.tif"), values)
    make("jump.tif", start="{:.8f},{:.8f}".format(*degrees((400.0, 300.0))))
    assert "warning: terrain jump.tif: row 15 of the heights, column 31: 104 m beside 700 m" in capsys.readouterr().err


def small(head: str, mark: str = "", encoding: str = "utf-8") -> None:
    """A grid over the sensor nodes of the small list."""
    text = (SURVEYS / "hill.asc").read_text().replace("cellsize 10\n", head)
    Path("small.asc").write_bytes((mark + text).encode(encoding))


@pytest.mark.parametrize(
    ("head", "mark", "encoding"),
    [
        ("cellsize 10\n", "\ufeff", "utf-8"),
        ("cellsize 10\n", "\ufeff", "utf-16-le"),
        ("dx 10\ndy 10\n", "", "utf-8"),
        ("DX 10.0\nDY 10.0\nNODATA_value -9999\n", "\ufeff", "utf-8"),
        ("CELLSIZE 10\r\n", "", "utf-8"),
    ],
)
def test_headers_as_programs_write_them_are_read(head: str, mark: str, encoding: str) -> None:
    small(head, mark, encoding)
    keys = make("small.asc", sensors=str(SURVEYS / "nodes.csv"), start="3060,7060")
    assert keys["area"] == tomllib.loads((SURVEYS / "golden" / "hill" / "hill.toml").read_text())["area"]


def test_cells_need_not_be_square() -> None:
    # The rows of 12 m begin at the same corner, so that the hill is higher up and longer.
    small("dx 10\ndy 12\n")
    keys = make("small.asc", sensors=str(SURVEYS / "nodes.csv"), start="3060,7060")
    [ring] = zones(keys)
    assert np.ptp(ring[:, 0]) == 20.0 and np.ptp(ring[:, 1]) == 24.0


@pytest.mark.parametrize("word", ["nan", "NaN", "1.#QNAN", "-1.#IND"])
def test_words_for_no_height_are_voids_whatever_the_header_names(word: str, refused: Refused) -> None:
    rows = (SURVEYS / "hill.asc").read_text().split("\n")
    nodes, start = str(SURVEYS / "nodes.csv"), "3060,7060"
    outside, inside = list(rows), list(rows)
    outside[5] = outside[5].replace("210", word, 1)
    inside[12] = inside[12].replace("230", word, 1)
    Path("outside.asc").write_text("\n".join(outside))
    Path("inside.asc").write_text("\n".join(inside))
    assert len(zones(make("outside.asc", sensors=nodes, start=start))) == 1
    assert "row 8 of the heights, column 9: nan: no height?" in refused("inside.asc", sensors=nodes, start=start)


def test_what_is_no_grid_is_refused_in_a_line(refused: Refused) -> None:
    text = ascii_of(cone())
    for name, content, message in [
        ("words.asc", text.replace("100.000", "five", 1), "line 7: `five`: expected a height"),
        ("key.asc", text.replace("cellsize 10", "cellsize ten"), "line 5: `cellsize ten`: expected ncols, nrows, xllcorner"),
        ("other.asc", text.replace("cellsize 10", "projection 10"), "line 5: `projection 10`: expected ncols"),
        ("short.asc", text[: len(text) // 2].rpartition(" ")[0], " heights: expected ncols × nrows = 60 × 40"),
        ("size.asc", text.replace("ncols 60\n", ""), "ncols = : expected a whole number in the header"),
        ("notes.txt", "hello", "expected a grid of heights that GDAL reads"),
    ]:
        Path(name).write_text(content)
        assert message in refused(name, "--crs", UTM), name
    assert "terrain nowhere.tif: No such file or directory" in refused("nowhere.tif")
    with rasterio.open(
        "colours.tif", "w", driver="GTiff", width=60, height=40, count=3, dtype="uint8", crs=UTM,
        transform=rasterio.transform.from_origin(CORNER_M[0], CORNER_M[1] + 400, 10, 10),
    ) as grid:  # fmt: skip
        grid.write(np.zeros((3, 40, 60), dtype=np.uint8))
    assert "3 bands: expected one of heights" in refused("colours.tif")
    write(Path("plain.tif"), cone(), crs=None)
    assert "it names no reference system, and the positions are latitudes and longitudes" in refused("plain.tif")
    assert "option --crs: `EPSG:0`: expected a reference system" in refused("plain.tif", "--crs", "EPSG:0")


def test_places_without_ground_or_under_it_are_refused(refused: Refused, capsys: pytest.CaptureFixture[str]) -> None:
    write(Path("dem.tif"), cone())
    write(Path("small.tif"), cone()[:, :50])
    assert "expected the ground under all of the area" in refused("small.tif")
    top = "{:.8f},{:.8f}".format(*degrees((300.0, 200.0)))
    assert "is or lies within ground above" in refused("dem.tif", "--clearance", "25", start=top)
    for words, message in [
        (["--clearance", "-1"], "invalid value '-1' for '--clearance <M>': expected 0 to 10000 m"),
        (["--voids", "no"], "argument --voids: invalid choice"),
    ]:
        with pytest.raises(SystemExit, match="2"):
            terrain.main(["a", "--sensors", "deg.csv", "--terrain", "dem.tif", *words])
        said = capsys.readouterr().err
        assert message in said and said.count("\n") == 1
    assert terrain.main(["deg", "--sensors", "deg.csv", "--terrain", "dem.tif", "--start", START_DEG]) == 0
    capsys.readouterr()
    again = ["deg", "--sensors", "deg.csv", "--terrain", "dem.tif", "--start", START_DEG]
    assert terrain.main(again) == 2
    assert "deg/sensors.csv: it exists: choose another --out, or pass --force" in capsys.readouterr().err


def test_flat_ground_changes_nothing_but_the_list() -> None:
    write(Path("flat.tif"), np.full((40, 60), 250.0, dtype=np.float32))
    keys = make("flat.tif")
    assert "map" != keys["link"].get("model") and not zones(keys)
    assert ground_m() == [250.0] * 4 and sorted(path.name for path in Path("out").iterdir()) == ["hill.toml", "sensors.csv"]


def test_a_ridge_hides_what_lies_behind_it() -> None:
    """A wall of 15 m, above which the UAV flies 30 m high, and a radio that reaches over it."""
    values = np.zeros((40, 60), dtype=np.float32)
    values[:, 30] = 15.0
    write(Path("wall.tif"), values, crs=None)
    hardware = ["--clearance", "0", "--radio", "lora-sf7", "--drone", "x500"]
    keys = make("wall.tif", *hardware, sensors="utm.csv", start="460050,5240200")
    assert not zones(keys)
    with Path("out", "links.csv").open(newline="") as file:
        rates = {(row["sensor"], float(row["x_m"]), float(row["y_m"])): row["rate_bps"] for row in csv.DictReader(file)}
    # SN 0, 285 m west of the wall, sees 30 m high up to 285 · 30/15 = 570 m, x = 590 in the grid, 580 in the area;
    # SN 1, 275 m east of it, up to 550 m, x = 30 in the grid, 20 in the area.
    assert float(rates["#0", 560.0, 100.0]) > 0.0 and float(rates["#1", 40.0, 100.0]) > 0.0
    assert rates["#1", 0.0, 100.0] == rates["#1", 10.0, 100.0] == ""


def test_zones_grow_only_where_they_have_many_corners() -> None:
    random = np.random.default_rng(5)
    values = np.where(random.random((40, 60)) < 0.2, 130.0, 100.0).astype(np.float32)
    values[30:, :12] = 100.0
    write(Path("rough.tif"), values, crs=None)
    keys = make("rough.tif", sensors="utm.csv", start="460050,5240050")
    rings = zones(keys)
    shift = 10.0 - 20.0, 10.0 - 30.0
    for row, column in zip(*np.nonzero(values > 110.0), strict=True):
        x_m, y_m = column * 10.0 + 5.0 + shift[0], 400.0 - row * 10.0 - 5.0 + shift[1]
        inside = 0.0 < x_m < keys["area"]["width_m"] and 0.0 < y_m < keys["area"]["height_m"]
        assert not inside or any(encloses(ring, x_m, y_m) for ring in rings), (row, column)
    assert not any(encloses(ring, 40.0, 30.0) for ring in rings), "the start is free"
