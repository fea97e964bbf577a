"""The ground under an area: heights between the middles of cells, and whether a UAV is in sight over them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Marks = NDArray[np.bool_]

Map = Callable[[Floats, Floats], tuple[Floats, Floats]]
"""From coordinates to others."""


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
    to_cells: Map
    """From x and y in the area [m] to columns and rows."""
    to_area: Map
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
        last_row, last_column = (count - 1 for count in heights_m.shape)
        own = heights_m[np.clip(rows.astype(int), 0, last_row), np.clip(columns.astype(int), 0, last_column)]
        found: Floats = np.zeros_like(own)
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
            alive = np.flatnonzero(seen & (run != 0))
            # From the point outward, so that what is hidden near it is left out of all lines behind.
            here = begin[axis]
            for line in sorted(range(first, last + 1), key=lambda line: abs(line - here)):
                at = alive[(low[alive] <= line) & (line <= high[alive])]
                part = (line - begin[axis]) / run[at]
                across = begin[1 - axis] + part * (end[1 - axis][at] - begin[1 - axis])
                across = np.clip(across, 0, of_line.shape[1] - 1)
                edge_m = np.maximum(of_line[line, np.floor(across).astype(int)], of_line[line, np.ceil(across).astype(int)])
                is_clear = (part <= 0) | (height_m + part * (uav_m - height_m) > edge_m)
                if not is_clear.all():
                    seen[at[~is_clear]] = False
                    alive = alive[seen[alive]]
        return seen
