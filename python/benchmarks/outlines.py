"""Polygons that cover the cells of a map, as the zones, buildings and bases of a scenario need them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

APART = 1e-4  # how far the corners of cells that touch at a corner only keep apart, in cells


def outlines(cells: np.ndarray) -> list[list[list[float]]]:
    """Polygons that cover the cells which are true, none of which has a hole, in cells from ``cells[0, 0]``.

    ``cells`` has a row for each y and a column for each x. Polygons of a part with holes overlap by a column, so that no seam
    is left between them.
    """
    pending = list(parts(cells))[::-1]
    found = []
    while pending:
        part = pending.pop()
        column = hole(part)
        if column is None:
            found.append(outline(part))
            continue
        columns = np.arange(cells.shape[1])
        for side in (columns <= column, columns >= column):
            pending.extend(parts(part & side))
    return found


def parts(cells: np.ndarray) -> Iterator[np.ndarray]:
    """The parts of the cells which are joined by edges."""
    rest = np.array(cells, bool)
    while rest.any():
        part = np.zeros_like(rest)
        pending = [tuple(np.argwhere(rest)[0].tolist())]
        while pending:
            y, x = pending.pop()
            if 0 <= y < rest.shape[0] and 0 <= x < rest.shape[1] and rest[y, x]:
                rest[y, x], part[y, x] = False, True
                pending += [(y, x - 1), (y, x + 1), (y - 1, x), (y + 1, x)]
        yield part


def hole(part: np.ndarray) -> int | None:
    """The column of a cell that is not in the part and not joined with the outside."""
    for other in parts(~part):
        if not (other[0].any() or other[-1].any() or other[:, 0].any() or other[:, -1].any()):
            return int(np.argwhere(other)[0, 1])
    return None


def outline(part: np.ndarray) -> list[list[float]]:
    """The corners of a part without holes, counterclockwise."""
    rows, columns = part.shape

    def is_in(x: int, y: int) -> bool:
        return 0 <= x < columns and 0 <= y < rows and bool(part[y, x])

    # Along the boundary with the part to the left; the first cell has no cell to the south.
    y, x = np.argwhere(part)[0].tolist()
    begin, (dx, dy) = (x, y), (1, 0)
    corners = []
    while True:
        x, y = x + dx, y + dy
        left = (-dy, dx)
        ahead_left = is_in(x + (dx + left[0] - 1) // 2, y + (dy + left[1] - 1) // 2)
        ahead_right = is_in(x + (dx - left[0] - 1) // 2, y + (dy - left[1] - 1) // 2)
        # Where two cells touch at a corner the outline stays with its own.
        turned = left if not ahead_left else (dy, -dx) if ahead_right else (dx, dy)
        if turned != (dx, dy):
            apart = APART if not ahead_left and ahead_right else 0.0
            # Into the own cell, which is behind and to the left.
            corners.append([x + apart * (left[0] - dx), y + apart * (left[1] - dy)])
        dx, dy = turned
        if (x, y) == begin and (dx, dy) == (1, 0):
            return corners
