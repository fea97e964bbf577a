"""The polygons that the harvesting benchmark makes of the cells of a map."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "python" / "benchmarks"))
from outlines import outlines  # noqa: E402


def cells(*lines: str) -> np.ndarray:
    """Cells from lines, the north first; `#` is in."""
    return np.array([[letter == "#" for letter in line] for line in lines[::-1]])


def encloses(polygon: list[list[float]], x: float, y: float) -> bool:
    """Whether an odd number of edges lies to the east."""
    crossed = 0
    for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        crossed += (ay > y) != (by > y) and x < ax + (bx - ax) * (y - ay) / (by - ay)
    return crossed % 2 == 1


def assert_covers(covered: np.ndarray) -> int:
    """Fails unless the outlines cover the cells and nothing else, and no corner is the same as another."""
    polygons = outlines(covered)
    for (y, x), is_in in np.ndenumerate(covered):
        for dx, dy in [(0.5, 0.5), (0.01, 0.01), (0.99, 0.01), (0.01, 0.99), (0.99, 0.99)]:
            assert any(encloses(polygon, x + dx, y + dy) for polygon in polygons) == is_in, (x, y, covered, polygons)
    for polygon in polygons:
        assert len({tuple(corner) for corner in polygon}) == len(polygon), polygon
    return len(polygons)


def test_parts_become_polygons() -> None:
    assert len(outlines(cells("##.", "#..", "..#"))) == 2
    assert len(outlines(cells("###", "#..", "###"))[0]) == 8
    assert outlines(cells("####", "####")) == [[[4, 0], [4, 2], [0, 2], [0, 0]]]


def test_a_part_with_a_hole_becomes_polygons_that_overlap() -> None:
    ring = cells("#####", "#...#", "#####")
    assert assert_covers(ring) > 1
    # Along a line of the lattice across the ring, both sides of each cell's border lie together in one of them.
    for border in range(1, 5):
        near = [(border - 1e-6, 0.5), (border + 1e-6, 0.5)]
        assert any(all(encloses(polygon, *at) for at in near) for polygon in outlines(ring)), border


@pytest.mark.parametrize("lines", [("#.", ".#"), ("##.", "#.#", "###"), (".##", "#.#", "###"), ("###", "#.#", ".##")])
def test_cells_that_touch_at_a_corner_become_simple_polygons(lines: tuple[str, ...]) -> None:
    assert_covers(cells(*lines))


def test_polygons_cover_any_set_of_cells() -> None:
    random = np.random.default_rng(7)
    for turn in range(300):
        assert_covers(random.random((7, 8)) < 0.3 + 0.1 * (turn % 7))
