"""Units of heights, and grids in text: what GDAL does not read of them is put right or refused before."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skysink._skysink import InputError

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


@dataclass(frozen=True)
class Unit:
    """A unit of heights, and what names it."""

    name: str
    length_m: float
    source: str


def refusal(path: Path, message: str) -> InputError:
    """An error about a grid."""
    return InputError(f"terrain {path}: {message}")


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
