//! The outlines of marked cells of a grid, as polygons.

use std::collections::BTreeMap;

/// Corners of a polygon in sides of cells from the south-west corner of the grid.
pub type CellOutline = Vec<[usize; 2]>;

/// Steps to the east, north, west and south.
const STEPS: [[isize; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// The outlines, anticlockwise, of the `marked` ones of `cells` to the east and to the north, by row from the south.
/// They are simple and apart: a cell that no way leads to from the edge of the grid is marked, too, and one of two
/// cells between marked ones that touch at a corner, the one where `height` is higher.
#[must_use]
pub fn outlines(marked: &[bool], cells: [usize; 2], height: impl Fn(usize) -> f64) -> Vec<CellOutline> {
    let mut marked = marked.to_vec();
    loop {
        fill(&mut marked, cells);
        if !join(&mut marked, cells, &height) {
            break;
        }
    }
    // Each side between a marked cell and an unmarked one, with the marked one to the left.
    let [columns, rows] = cells;
    let is_marked = |column: isize, row: isize| {
        let is_within = (0..columns as isize).contains(&column) && (0..rows as isize).contains(&row);
        is_within && marked[row as usize * columns + column as usize]
    };
    let mut sides: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    for row in 0..rows {
        for column in 0..columns {
            if !marked[row * columns + column] {
                continue;
            }
            let corners = [[column, row], [column + 1, row], [column + 1, row + 1], [column, row + 1]];
            for (direction, corner) in corners.into_iter().enumerate() {
                let [outward_x, outward_y] = STEPS[(direction + 3) % 4];
                if !is_marked(column as isize + outward_x, row as isize + outward_y) {
                    sides.insert(corner, direction);
                }
            }
        }
    }
    let mut rings = Vec::new();
    while let Some((&first, _)) = sides.first_key_value() {
        let mut ring = Vec::new();
        let mut at = first;
        let mut before = None;
        while let Some(direction) = sides.remove(&at) {
            if before != Some(direction) {
                ring.push(at);
            }
            before = Some(direction);
            let [step_x, step_y] = STEPS[direction];
            at = [at[0].wrapping_add_signed(step_x), at[1].wrapping_add_signed(step_y)];
        }
        rings.push(ring); // it begins at its south-western corner
    }
    rings
}

/// Marks all cells that no way over unmarked neighbours leads to from the edge.
fn fill(marked: &mut [bool], [columns, rows]: [usize; 2]) {
    let is_edge =
        |cell: &usize| [0, columns - 1].contains(&(cell % columns)) || [0, rows - 1].contains(&(cell / columns));
    let mut open: Vec<usize> = (0..marked.len()).filter(|cell| !marked[*cell] && is_edge(cell)).collect();
    let mut is_open = vec![false; marked.len()];
    open.iter().for_each(|cell| is_open[*cell] = true);
    while let Some(cell) = open.pop() {
        for [step_x, step_y] in STEPS {
            let column = (cell % columns).checked_add_signed(step_x).filter(|column| *column < columns);
            let row = (cell / columns).checked_add_signed(step_y).filter(|row| *row < rows);
            if let (Some(column), Some(row)) = (column, row) {
                let beside = row * columns + column;
                if !marked[beside] && !is_open[beside] {
                    is_open[beside] = true;
                    open.push(beside);
                }
            }
        }
    }
    marked.iter_mut().zip(is_open).for_each(|(marked, is_open)| *marked = !is_open);
}

/// Marks a cell beside each corner at which two marked ones touch; returns whether there was one.
fn join(marked: &mut [bool], [columns, rows]: [usize; 2], height: &impl Fn(usize) -> f64) -> bool {
    let mut is_changed = false;
    for row in 1..rows {
        for column in 1..columns {
            let north_east = row * columns + column;
            let [south_west, south_east, north_west] = [north_east - columns - 1, north_east - columns, north_east - 1];
            for ([one, other], [free, beside]) in [
                ([south_west, north_east], [south_east, north_west]),
                ([south_east, north_west], [south_west, north_east]),
            ] {
                if marked[one] && marked[other] && !marked[free] && !marked[beside] {
                    marked[if height(beside) > height(free) { beside } else { free }] = true;
                    is_changed = true;
                }
            }
        }
    }
    is_changed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The outlines of the cells `#` of a picture, the first row the northernmost.
    fn of(picture: &[&str]) -> Vec<CellOutline> {
        let rows: Vec<&[u8]> = picture.iter().rev().map(|row| row.as_bytes()).collect();
        let marked: Vec<bool> = rows.iter().flat_map(|row| row.iter().map(|cell| *cell == b'#')).collect();
        outlines(&marked, [rows[0].len(), rows.len()], |cell| cell as f64)
    }

    #[test]
    fn a_ring_of_cells_is_filled_and_corners_in_a_line_are_left_out() {
        assert_eq!(of(&["....", ".##.", ".##."]), [[[1, 0], [3, 0], [3, 2], [1, 2]]]);
        assert_eq!(of(&["###", "#.#", "###"]), [[[0, 0], [3, 0], [3, 3], [0, 3]]]);
        assert_eq!(of(&["#.", "##"]), [[[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]]);
        assert!(of(&["..", ".."]).is_empty());
    }

    #[test]
    fn cells_that_touch_at_a_corner_are_joined_by_the_higher_one() {
        // The cell in the north-west has the larger number, and so height.
        assert_eq!(of(&[".#", "#."]).len(), 1);
        assert_eq!(of(&["..#", "...", "#.."]).len(), 2);
        assert_eq!(of(&[".#", "#."]), [[[0, 0], [1, 0], [1, 1], [2, 1], [2, 2], [0, 2]]]);
    }
}
