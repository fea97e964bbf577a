"""Cells of a grid without a height of the ground: those that its file names, and those that only look like heights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from skysink.ground import Floats, Marks

LIMITS_M = (-500.0, 9000.0)
"""Heights of the ground [m], those of ``ground_m``."""

VOIDS = (-99999.0, -32768.0, -32767.0, -9999.0, -999.0, 9999.0, 32767.0, 65535.0, 99999.0)
"""Values that programs write for no height, also where the header names another."""

FAR = 500.0
"""Difference from the median height from which on such a value is none."""

HIGH_ZERO_M = 100.0
"""Heights around a 0 [m] from which on it is no height."""

JUMP = (100.0, 5.0)
"""A rise between neighbouring cells that is doubted: metres, and times their distance."""

FILL = "fill it by gdal_fillnodata.py, or close such cells by --voids zones"


def voids(
    path: Path, raw: Floats, heights_m: Floats, length_m: float, is_named: Marks, is_inner: Marks
) -> tuple[Marks, Callable[[int, int], str]]:
    """The cells without a height, and why one is none. ``raw`` are the values of the file, whose unit is ``length_m`` [m],
    ``is_named`` those that it names as none.
    """
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
            return f"0, where the ground around it is {HIGH_ZERO_M:g} m and higher: no height? {name_it('0', path)}"
        in_metres = "" if length_m == 1.0 or not is_finite[row, column] else f" ({heights_m[row, column]:.1f} m)"
        expected = f"expected {LIMITS_M[0]:g} to {LIMITS_M[1]:g} m"
        remedy = FILL if np.isnan(raw[row, column]) else name_it(value, path)
        return f"{value}{in_metres}: no height? {expected}: {remedy}"

    return is_void, why


def jumps(path: Path, heights_m: Floats, is_inner: Marks, cell_m: float, first: Sequence[int]) -> list[str]:
    """Says where neighbours differ by more than ground does."""
    most_m = JUMP[0] + JUMP[1] * cell_m
    inner_m = np.where(is_inner & np.isfinite(heights_m), heights_m, np.nan)
    for axis in (0, 1):
        found = np.argwhere(np.abs(np.diff(inner_m, axis=axis)) > most_m)
        if found.size:
            row, column = found[0]
            beside = inner_m[row + 1, column] if axis == 0 else inner_m[row, column + 1]
            return [
                f"terrain {path}: row {row + first[1] + 1} of the heights, column {column + first[0] + 1}: "
                f"{inner_m[row, column]:g} m beside {beside:g} m, in {found.shape[0]} places: are they heights?"
            ]
    return []


def name_it(value: str, path: Path) -> str:
    """What to do about a value that is no height."""
    return f"name it by NODATA_value (gdal_edit.py -a_nodata {value} {path.name}), and {FILL}"


def text(value: float) -> str:
    """A value of a grid."""
    return f"{value:.10g}"


def high_zeros(raw: Floats, heights_m: Floats, is_known: Marks) -> Marks:
    """The cells that are exactly 0 where all ground around them is high: a void, or a height that was clamped."""
    is_zero = is_known & (raw == 0)
    if not is_zero.any() or is_zero.all():
        return np.zeros_like(is_zero)
    # A low cell beside some of them, such as a beach, makes all that hang together heights.
    is_low = is_known & ~is_zero & (heights_m < HIGH_ZERO_M)
    is_sea = np.zeros_like(is_zero)
    rows, columns = is_zero.shape
    front = np.flatnonzero(is_zero & beside(is_low))
    while front.size > 0:
        is_sea.flat[front] = True
        row, column = np.divmod(front, columns)
        steps = [(row + down, column + right) for down in (-1, 0, 1) for right in (-1, 0, 1)]
        inner = [(0 <= at) & (at < rows) & (0 <= to) & (to < columns) for at, to in steps]
        near = np.unique(np.concatenate([(at * columns + to)[is_in] for (at, to), is_in in zip(steps, inner, strict=True)]))
        front = near[is_zero.flat[near] & ~is_sea.flat[near]]
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
