"""Scenarios of flight logs: what the executable made before, holes, names and ids, rows without a fix, and refusals."""

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
from skysink import measured
from skysink.drafts import MapGrid
from skysink.radio_maps import Measured

pytest.importorskip("pandas")

SURVEYS = ROOT / "python" / "tests" / "surveys"

RATES = "snr_db,rate_bps\n0,20000\n8,90000\n"
HEAD = "time_s,x_m,y_m,z_m,sensor,snr_db\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An own folder with a log of nothing."""
    monkeypatch.chdir(tmp_path)
    Path("log").mkdir()
    Path("log", "rates.csv").write_text(RATES)
    Path("log", "sensors.csv").write_text("x_m,y_m,name\n20,20,a\n60,20,b\n100,20,c\n140,20,d\n")
    return tmp_path


def rows(times_s: range, z_m: float = 30.0, sensor: Callable[[int], str] = lambda second: "abcd"[second % 4]) -> str:
    """A flight to the east at 1 m/s from (10, 40), one row a second."""
    return "".join(f"{at},{10 + at},40,{z_m:g},{sensor(at)},{12 - at % 7}\n" for at in times_s)


def write(text: str, encoding: str = "utf-8") -> None:
    """Writes the log."""
    Path("log", "log.csv").write_bytes(text.encode(encoding))


def make(*options: str, out: str = "out") -> dict[str, Any]:
    """The keys of the scenario of the log."""
    assert measured.main(["aerial", "--log", "log", "--out", out, "--force", *options]) == 0
    skysink.Scenario.load(Path(out, "aerial.toml"))
    return tomllib.loads(Path(out, "aerial.toml").read_text())


def served(out: str = "out") -> set[str]:
    """The ids of the sensor nodes with links."""
    with Path(out, "links.csv").open(newline="") as file:
        return {row["sensor"] for row in csv.DictReader(file) if row["snr_db"]}


Refused = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refused:
    """The line of a refusal, which leaves nothing."""

    def run(text: str, *options: str) -> str:
        write(text)
        capsys.readouterr()
        code = measured.main(["aerial", "--log", "log", "--out", "none", *options])
        said = capsys.readouterr()
        assert (code, said.out, said.err.count("\n"), Path("none").exists()) == (2, "", 1, False), said
        return said.err

    return run


def test_the_scenario_stays_that_of_the_executable_before() -> None:
    assert measured.main(["aerial", "--log", str(SURVEYS / "log")]) == 0
    golden = SURVEYS / "golden" / "aerial"
    for file in ("sensors.csv", "track.csv"):
        assert Path("aerial", file).read_bytes() == (golden / file).read_bytes(), file
    rows = [list(csv.reader((folder / "links.csv").open(newline=""))) for folder in (Path("aerial"), golden)]
    assert [row[:4] for row in rows[0]] == [row[:4] for row in rows[1]]
    levels_db = [np.array([float(row[4]) for row in of[1:]]) for of in rows]
    assert np.allclose(levels_db[0], levels_db[1], atol=0.011)  # a rounding
    keys = [tomllib.loads((folder / "aerial.toml").read_text()) for folder in (Path("aerial"), golden)]
    assert keys[0] == keys[1]


def test_positions_in_metres_become_a_map_and_a_fixed_flight() -> None:
    write(HEAD + rows(range(0, 141)))
    keys = make()
    assert (keys["slots"], keys["uav"]["altitude_m"], keys["uav"]["track"]) == (140, 30.0, "track.csv")
    assert served() == {"#0", "#1", "#2", "#3"}
    with Path("out", "track.csv").open(newline="") as file:
        track = [(float(row["x_m"]), float(row["y_m"])) for row in csv.DictReader(file)]
    assert track == [(10.0 + at, 40.0) for at in range(141)]
    flown = skysink.simulate(Path("out", "aerial.toml"), "horizon")
    assert len(flown) == 140 and 0.0 <= flown.loss_rate < 1.0
    write(HEAD + "-2,10,40,5,,\n" + rows(range(0, 141)))
    assert make() == keys, "the climb is left out"


def hole(first: range, *others: range) -> str:
    """A log with holes."""
    return HEAD + "".join(rows(times_s) for times_s in (first, *others))


def test_a_hole_is_refused_by_its_line_or_cut(refused: Refused, capsys: pytest.CaptureFixture[str]) -> None:
    log = hole(range(0, 25), range(90, 141))
    said = refused(log)
    assert "flight log log/log.csv: line 27: nothing is known from 24 s to 90 s, 66 m apart" in said
    assert "--flight: 1 is lines 2 to 26, 24 s; 2 is lines 27 to 77, 50 s" in said
    keys = make("--flight", "1")
    assert keys["slots"] == 24 and served() == {"#0", "#1", "#2", "#3"}
    assert "flight log: flight 1 of 2, lines 2 to 26, with the SNRs of all" in capsys.readouterr().out
    assert make("--flight", "2")["slots"] == 50
    assert "option --flight: 3: expected 1 to 2" in refused(log, "--flight", "3")
    assert "option --flight: 0: expected 1 to 2" in refused(log, "--flight", "0")


@pytest.mark.parametrize(
    ("log", "line"),
    [
        (HEAD + rows(range(0, 40)) + rows(range(40, 100), z_m=90.0) + rows(range(100, 200)), "line 102: nothing is known from 39 s to 100 s, 61 m apart, with 60 rows of another altitude between them"),
        (HEAD + rows(range(0, 40)) + "2440,49,40,30,,\n" + "2441,50,40,30,,\n", "line 42: nothing is known from 39 s to 2440 s"),
        (HEAD + rows(range(0, 40)) + "40,49,40,90,,\n48,49,40,30,,\n49,49,40,30,,\n", "line 43: nothing is known from 39 s to 48 s, 0 m apart, with 1 rows"),
        (hole(range(0, 10), range(60, 70), range(120, 141)), "3 is lines 22 to 42, 20 s"),
        (HEAD + rows(range(0, 141, 30)), "line 3: nothing is known from 0 s to 30 s"),
    ],
)  # fmt: skip
def test_climbs_long_waits_and_several_holes_are_holes(log: str, line: str, refused: Refused) -> None:
    assert line in refused(log)


@pytest.mark.parametrize(
    "log",
    [
        HEAD + rows(range(0, 40)) + rows(range(44, 100)),  # 5 s
        HEAD + rows(range(0, 40)) + "".join(f"{at},49,40,30,a,5\n" for at in range(45, 100, 30)),  # hovering
    ],
)
def test_short_gaps_and_hovering_are_no_holes(log: str) -> None:
    write(log)
    assert make()["slots"] > 70


def test_a_log_of_few_rows_is_flown_if_asked() -> None:
    write(HEAD + rows(range(0, 141, 10)))
    assert measured.main(["aerial", "--log", "log"]) == 0, "10 m in 10 s are near"
    write(HEAD + rows(range(0, 141, 30)))
    assert make("--hole", "30")["slots"] == 120


def ids(*words: str) -> str:
    """A log of sensor nodes with these words."""
    return HEAD + rows(range(0, 141), sensor=lambda second: words[second % len(words)])


def named(*names: str) -> None:
    """Renames the four sensor nodes."""
    places = zip([20, 60, 100, 140], names, strict=True)
    Path("log", "sensors.csv").write_text("x_m,y_m,name\n" + "".join(f"{x},20,{name}\n" for x, name in places))


def test_ids_from_0_beside_names_from_1_are_refused(refused: Refused) -> None:
    named("1", "2", "3", "4")
    said = refused(ids("0", "1", "2", "3"))
    assert "line 3: sensor `1`: it is the name of SN 0 and the id of SN 1, and `0` (line 2) is an id alone" in said
    assert "expected names, or ids as #1, from #0" in said
    assert "sensor `1.0`: it is the name of SN 0 and the id of SN 1" in refused(ids("0.0", "1.0"))


@pytest.mark.parametrize(
    ("names", "words", "heard"),
    [
        (("1", "2", "3", "4"), ("1", "2", "3", "4"), "0123"),  # names
        (("1", "2", "3", "4"), ("1.0", "2.0", "3.0"), "012"),  # names, as pandas writes a column with gaps
        (("1", "2", "3", "4"), ("#0", "#1"), "01"),  # ids
        (("", "", "", ""), ("0", "1.0", "2", "3.0"), "0123"),  # ids
        (("a", "b", "c", "d"), ("3", "1"), "13"),  # ids
        (("a", "b", "c", "d"), ("d", "b"), "13"),
        (("3", "2", "1", "0"), ("3", "2"), "01"),  # all are both: names, as in a map of links
        (("1.0", "b", "c", "d"), ("1.0", "b"), "01"),
        (("7", "8", "9", "x y"), ("7", "x y"), "03"),
        (("7", "8", "9", "d"), ("#3", "#0"), "03"),
    ],
)
def test_a_column_is_all_names_or_all_ids(names: tuple[str, ...], words: tuple[str, ...], heard: str) -> None:
    named(*names)
    write(ids(*words))
    make()
    assert served() == {f"#{sensor}" for sensor in heard}


def test_words_that_name_no_sensor_node_are_refused(refused: Refused) -> None:
    assert "line 3: sensor `4`: expected the name or the id of one sensor node" in refused(ids("0", "4"))
    assert "line 2: sensor `#9`: expected the name or the id" in refused(ids("#9"))
    assert "line 2: sensor `1.5`: expected the name or the id" in refused(ids("1.5"))
    assert "line 2: sensor `2`: an id, and `a` (line 3) is a name: expected all names, or all ids" in refused(ids("2", "a"))
    named("a", "a", "c", "d")
    assert "line 2: sensor `a`: SN 0 and SN 1 have this name" in refused(ids("a", "c"))


@pytest.mark.parametrize("empty", [",", "nan,nan", "NaN,", "0,0", "0.000,-0.0"])
def test_rows_before_the_first_fix_are_named_by_line(empty: str, capsys: pytest.CaptureFixture[str]) -> None:
    head = "time_s,lat_deg,lon_deg,z_m,sensor,snr_db\n"
    fixed = "".join(f"{at},{35.72 + at * 5e-5},-78.69,25,{at % 2},{12 - at}\n" for at in range(20))
    Path("log", "sensors.csv").write_text("lat,lon\n35.7205,-78.691\n35.7205,-78.689\n")
    write(head + f"-3,{empty},,,\n-2,{empty},0,,\n-1,{empty},25,1,9\n" + fixed)
    keys = make()
    assert "flight log: lines 2 to 4: no position before the first fix: left out" in capsys.readouterr().out
    write(head + fixed)
    assert make() == keys
    rows = (head + fixed).split("\n")
    rows[7] = f"6,{empty},25,,"
    write("\n".join(rows))
    make()
    assert "flight log: line 8: no position: left out" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: header ``: expected time_s,x_m,y_m,z_m,sensor,snr_db"),
        ("time_s,x_m,y_m,lat_deg,lon_deg,z_m,sensor,snr_db\n", "line 1: header"),
        (HEAD, "expected rows of at least two times"),
        (HEAD + "0,1,2,30,a,5\n0,1,2,30,b,5\n", "expected rows of at least two times"),
        (HEAD.replace("x_m,y_m", "lat_deg,lon_deg") + "0,95,2,30,a,5\n", "line 2: latitude 95: expected -90 to 90"),
        (HEAD + "0,1,2,30,a,x\n", "line 2: snr_db = x: expected a finite number"),
        (HEAD + "0,1,2,30,a,inf\n", "line 2: snr_db = inf: expected a finite number"),
        (HEAD + "0,1,2,30,a,5\n\n1,1,2,x,a,5\n", "line 4: z_m = x: expected a finite number"),
        (HEAD + "0,1,2,30,a,400\n", "line 2: snr_db = 400: expected a number from −300 to 300"),
        (HEAD + "0,1,2,30,,5\n", "line 2: sensor = : expected a name or an id, as there is an SNR"),
        (HEAD + "0,1,2\n", "line 2: 3 fields: expected 6, as in the header"),
        (HEAD.replace("z_m", "x_m") + "0,1,2,30,a,5\n", "line 1: column `x_m`: expected it once"),
        (HEAD + '0,1,2,30,"' + "a" * 200_000 + "\n", "field larger than field limit (131072): expected fields whose quotes end"),
        (HEAD + "0,1,2,30,a,5\n1,1,2,30,a,5,7\n", "line 3: 7 fields: expected 6, as in the header"),
        (HEAD + "1,1,2,30,a,5\n0,1,2,30,a,5\n", "line 3: time_s = 0: expected at least 1, as before"),
        (HEAD + "1,1,2,30,a,5\n1,1,3,30,a,5\n", "line 3: time_s = 1: expected one place at one time"),
        (HEAD + "0,20,40,30,a,5\n2,820,40,30,,\n", "line 3: 400.0 m/s to there: expected at most 100 m/s"),
        (HEAD + "0,20,40,30,,\n5,25,40,30,,\n", "no snr_db: expected SNRs of sensor nodes"),
        (HEAD + "0,20,40,-3,a,5\n5,25,40,-3,,\n", "median z_m = -3: expected altitudes above the ground"),
        (HEAD + "0,20,40,30,a,5\n0.5,20,40,30,,\n", "it lasts less than a slot: expected 1 s or more"),
        (HEAD.replace("x_m,y_m", "lat_deg,lon_deg") + "0,35,-78,30,a,5\n4,35,-78,30,,\n", "sensor positions log/sensors.csv: expected positions as in the flight log, all in metres or all in degrees"),
    ],
)  # fmt: skip
def test_an_invalid_log_is_refused_with_its_line(text: str, message: str, refused: Refused) -> None:
    assert message in refused(text)


def test_files_that_are_missing_or_made_from_are_refused(refused: Refused, capsys: pytest.CaptureFixture[str]) -> None:
    log = HEAD + rows(range(0, 141))
    assert measured.main(["aerial", "--log", "nowhere"]) == 2
    assert "flight log nowhere/log.csv: No such file or directory" in capsys.readouterr().err
    for text, message in [
        ("snr_db,rate\n", "line 1: header `snr_db,rate`: expected snr_db,rate_bps"),
        ("snr_db,rate_bps\n5,1\n0,2\n", "line 3: snr_db = 0: expected ascending values"),
        ("snr_db,rate_bps\n5,x\n", "line 2: rate_bps = x: expected a finite number"),
        ("snr_db,rate_bps\n", "expected a rate in a row"),
    ]:
        Path("log", "rates.csv").write_text(text)
        assert f"rates log/rates.csv: {message}" in refused(log), text
    Path("log", "rates.csv").write_text(RATES)
    write(log)
    assert measured.main(["aerial", "--log", "log", "--out", "log", "--force"]) == 2
    assert "file log/sensors.csv: the scenario is made from it: expected another --out" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        measured.main(["aerial"])
    assert "the following arguments are required: --log" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "encoding"),
    [(lambda text: "\ufeff" + text, "utf-8"), (lambda text: "\ufeff" + text, "utf-16-le"), (lambda text: text.replace(",", ";"), "utf-8"), (lambda text: text.replace("\n", "\r\n"), "utf-8"), (lambda text: text.replace(",", ", "), "utf-8")],
)  # fmt: skip
def test_logs_as_programs_write_them_are_read(change: Callable[[str], str], encoding: str) -> None:
    write(HEAD + rows(range(0, 141)))
    keys = make()
    write(change(HEAD + rows(range(0, 141))), encoding)
    assert make() == keys


GRID = MapGrid(10.0, (21, 11))
PLACE_M = np.array([[40.0, 50.0]])


def law_db(at_m: Any) -> Any:
    """60 dB at 1 m and an exponent of 2.5, at an altitude of 30 m."""
    away_m = np.hypot(np.hypot(*(at_m - PLACE_M[0]).T), 30.0)
    return 60.0 - 25.0 * np.log10(away_m)


def test_a_law_without_residuals_is_found_exactly() -> None:
    at_m = GRID.positions_m[::3]
    found = Measured.of(GRID, 30.0, PLACE_M, np.zeros(len(at_m), dtype=np.int64), at_m, law_db(at_m))
    assert found.law() == pytest.approx((60.0, 2.5)) and max(found.errors_db) < 1e-9
    assert np.allclose(found.levels_db()[0], law_db(GRID.positions_m)) and found.residual_db() is None


def test_bins_have_the_mean_of_what_was_measured_in_db() -> None:
    at_m = np.array([[52.0, 48.0], [52.0, 48.0], [0.0, 0.0]])  # twice nearest to node (5, 5)
    places_m = np.array([[0.0, 0.0], [40.0, 50.0]])
    found = Measured.of(GRID, 30.0, places_m, np.ones(3, dtype=np.int64), at_m, np.array([3.0, 9.0, 1.0]))
    levels_db = found.levels_db()
    assert np.isnan(levels_db[0]).all() and levels_db[1, 5 * 21 + 5] == 6.0
    assert found.residual_db() == pytest.approx(math.sqrt(18.0))  # ((3 - 6)² + (9 - 6)²)/1


def test_residuals_that_stay_predict_better_than_the_law() -> None:
    def shadowed_db(at_m: Any) -> Any:
        return law_db(at_m) + 8.0 * np.sin(at_m[:, 0] / 19.0) * np.cos(at_m[:, 1] / 19.0)

    at_m = GRID.positions_m[::2]
    found = Measured.of(GRID, 30.0, PLACE_M, np.zeros(len(at_m), dtype=np.int64), at_m, shadowed_db(at_m))
    error_db, of_law_db = found.errors_db
    assert of_law_db > 3.0 and error_db < 0.8 * of_law_db
    rms_db = np.sqrt(np.mean((found.levels_db()[0] - shadowed_db(GRID.positions_m)) ** 2))
    assert rms_db < error_db
