//! Grid flight (decision D17a): the UAV flies between the middles of neighbouring cells, to the east, north, west or
//! south.
//!
//! A move from one middle to the next takes `n` slots of equal length, and begins in every nth slot of the mission. A
//! hover takes as many. So the position of the UAV, and the slot, say where it is going: it keeps no other state.

use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

use nalgebra::Vector2;

use super::ground::ClosedGround;
use super::polygon::Bends;
use super::ways::Ways;
use crate::geometry::{Position, distance_squared, within};

/// Most cells of a grid.
pub const MAX_CELLS: u32 = 10_000;

/// How far a UAV may be from a line of the grid, in cells.
const BESIDE: f64 = 1e-6;

/// How far before the middle of a move a slot ends that would end there, in cells, so that its position says which end
/// it came from.
const BEFORE_MIDDLE: f64 = 1e-10;

/// Slack of a number of cells, relative to it, so that rounding takes none.
const CELLS_SLACK: f64 = 1e-12;

/// The distance to a cell that no way leads to.
const FAR: u16 = u16::MAX;

/// Cells and the ways between them.
#[derive(Debug, Clone)]
pub(super) struct GridCells {
    cell_m: f64,
    columns: u32,
    rows: u32,
    /// Slots of a move.
    move_slots: u64,
    /// Whether the way to the eastern and to the northern neighbour is free, by cell.
    is_joined: Vec<[bool; 2]>,
    /// Whether a way leads to the cell from the start.
    is_reached: Vec<bool>,
    /// Moves from each cell to this one; found when first asked for.
    moves_to: Vec<OnceLock<Box<[u16]>>>,
}

impl PartialEq for GridCells {
    /// What is found from the rest is not compared.
    fn eq(&self, other: &Self) -> bool {
        let sizes = |grid: &Self| (grid.cell_m, grid.columns, grid.rows, grid.move_slots);
        sizes(self) == sizes(other) && self.is_joined == other.is_joined && self.is_reached == other.is_reached
    }
}

/// Where a UAV is on a grid.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Spot {
    /// In the middle of a cell.
    Cell(u32),
    /// Between the middles of two cells, this far from the first [cells].
    Between(u32, u32, f64),
}

impl GridCells {
    /// The grid of cells of this side [m] over a ground, with moves of this many slots, for a UAV that begins at
    /// `start`.
    pub fn over(ground: &ClosedGround, cell_m: f64, move_slots: u64, start: &Position) -> Self {
        let is_clear =
            |from: &Position, to: &Position| ground.contains(from) && ground.contains(to) && ground.is_clear(from, to);
        let [columns, rows] = [ground.corner.x, ground.corner.y].map(|side_m| cells_along(side_m, cell_m));
        let mut grid = Self {
            cell_m,
            columns,
            rows,
            move_slots,
            is_joined: Vec::new(),
            is_reached: Vec::new(),
            moves_to: Vec::new(),
        };
        let count = columns * rows;
        let joined = |cell: u32, other: Option<u32>| {
            other.is_some_and(|other| is_clear(&grid.middle(cell), &grid.middle(other)))
        };
        grid.is_joined = (0..count)
            .map(|cell| [joined(cell, grid.beside(cell, 1, 0)), joined(cell, grid.beside(cell, 0, 1))])
            .collect();
        grid.moves_to = (0..count).map(|_| OnceLock::new()).collect();
        grid.is_reached = vec![false; count as usize];
        if let Some(Spot::Cell(first)) = grid.spot(start) {
            let moves = grid.search(first);
            grid.is_reached = moves.iter().map(|&moves| moves < FAR).collect();
        }
        grid
    }

    /// The middle of a cell [m].
    fn middle(&self, cell: u32) -> Position {
        let index = |index: u32| (f64::from(index) + 0.5) * self.cell_m;
        Position::new(index(cell % self.columns), index(cell / self.columns))
    }

    /// The cell to the east and to the north of `cell` by these steps.
    fn beside(&self, cell: u32, east: i64, north: i64) -> Option<u32> {
        let x = i64::from(cell % self.columns) + east;
        let y = i64::from(cell / self.columns) + north;
        let is_in = (0..i64::from(self.columns)).contains(&x) && (0..i64::from(self.rows)).contains(&y);
        is_in.then(|| (y * i64::from(self.columns) + x) as u32)
    }

    /// The neighbours to which a move may lead from `cell`: east, north, west, south.
    fn neighbours(&self, cell: u32) -> impl Iterator<Item = u32> {
        let [east, north] = self.is_joined[cell as usize];
        let west = self.beside(cell, -1, 0).filter(|&west| self.is_joined[west as usize][0]);
        let south = self.beside(cell, 0, -1).filter(|&south| self.is_joined[south as usize][1]);
        let east = self.beside(cell, 1, 0).filter(|_| east);
        let north = self.beside(cell, 0, 1).filter(|_| north);
        [east, north, west, south].into_iter().flatten()
    }

    /// Breadth-first search from `goal`.
    fn search(&self, goal: u32) -> Box<[u16]> {
        let mut moves = vec![FAR; self.is_joined.len()].into_boxed_slice();
        let mut pending = VecDeque::from([goal]);
        moves[goal as usize] = 0;
        while let Some(cell) = pending.pop_front() {
            for other in self.neighbours(cell) {
                if moves[other as usize] == FAR {
                    moves[other as usize] = moves[cell as usize] + 1; // at most MAX_CELLS
                    pending.push_back(other);
                }
            }
        }
        moves
    }

    fn moves_to(&self, goal: u32) -> &[u16] {
        self.moves_to[goal as usize].get_or_init(|| self.search(goal))
    }

    /// Where `at` [m] is on the grid; `None` beside its lines.
    fn spot(&self, at: &Position) -> Option<Spot> {
        let along = [at.x, at.y].map(|coordinate_m| coordinate_m / self.cell_m - 0.5);
        let nearest = along.map(f64::round);
        let is_on = [0, 1].map(|axis| (along[axis] - nearest[axis]).abs() <= BESIDE);
        let cell = |[x, y]: [f64; 2]| {
            let is_in = (0.0..f64::from(self.columns)).contains(&x) && (0.0..f64::from(self.rows)).contains(&y);
            is_in.then(|| y as u32 * self.columns + x as u32)
        };
        match is_on {
            [true, true] => cell(nearest).map(Spot::Cell),
            [false, false] => None,
            [_, is_north] => {
                let axis = usize::from(!is_north); // the one between two middles
                let low = along[axis].floor();
                let mut ends = [nearest; 2];
                ends[0][axis] = low;
                ends[1][axis] = low + 1.0;
                Some(Spot::Between(cell(ends[0])?, cell(ends[1])?, along[axis] - low))
            }
        }
    }

    fn is_neighbour(&self, cell: u32, other: u32) -> bool {
        self.neighbours(cell).any(|neighbour| neighbour == other)
    }

    /// The nearest cell to `point` [m] that a way leads to from the start.
    fn nearest_cell(&self, point: &Position) -> Option<u32> {
        let cells = (0..self.is_reached.len() as u32).filter(|&cell| self.is_reached[cell as usize]);
        let away_m2 = |cell: &u32| distance_squared(&self.middle(*cell), point);
        match self.spot(point) {
            Some(Spot::Cell(cell)) if self.is_reached[cell as usize] => Some(cell),
            _ => cells.min_by(|a, b| away_m2(a).total_cmp(&away_m2(b))),
        }
    }

    /// The middle of the nearest cell to `point` that a way leads to [m].
    fn nearest_middle(&self, point: &Position) -> Option<Position> {
        self.nearest_cell(point).map(|cell| self.middle(cell))
    }

    /// The cell from which a way from `from` to the cell `goal` goes on, and the distance to it [cells].
    fn begin(&self, from: &Position, goal: u32) -> Option<(u32, f64)> {
        let moves = self.moves_to(goal);
        match self.spot(from) {
            Some(Spot::Cell(cell)) => Some((cell, 0.0)),
            Some(Spot::Between(a, b, off)) => {
                let length = |cell: u32, off: f64| f64::from(moves[cell as usize]) + off;
                Some(if length(a, off) <= length(b, 1.0 - off) { (a, off) } else { (b, 1.0 - off) })
            }
            None => {
                let cell = self.nearest_cell(from)?;
                Some((cell, (self.middle(cell) - from).norm() / self.cell_m))
            }
        }
    }

    /// Length of the shortest way [m]; infinite if there is none.
    fn length_m(&self, from: &Position, to: &Position) -> f64 {
        let Some(goal) = self.nearest_cell(to) else { return f64::INFINITY };
        let Some((cell, off)) = self.begin(from, goal) else { return f64::INFINITY };
        match self.moves_to(goal)[cell as usize] {
            FAR => f64::INFINITY,
            moves => (f64::from(moves) + off) * self.cell_m,
        }
    }

    /// The cells of the shortest way from `from` to the cell nearest to `to`; empty if there is none. Of several
    /// equally short ones that which begins to the east, north, west or south, in this order, at each cell: so the way
    /// from any of its cells is the rest of it.
    fn cells(&self, from: &Position, to: &Position) -> Vec<u32> {
        let Some(goal) = self.nearest_cell(to) else { return Vec::new() };
        let Some((mut cell, _)) = self.begin(from, goal) else { return Vec::new() };
        let moves = self.moves_to(goal);
        if moves[cell as usize] == FAR {
            return Vec::new();
        }
        let mut cells = vec![cell];
        while cell != goal {
            let is_nearer = |other: &u32| moves[*other as usize] < moves[cell as usize];
            let Some(next) = self.neighbours(cell).find(is_nearer) else { return Vec::new() };
            cell = next;
            cells.push(cell);
        }
        cells
    }

    /// The turns and the end of a way along `cells`.
    fn bends(&self, from: &Position, cells: &[u32]) -> Bends {
        let mut bends = Bends::new();
        let mut before = *from;
        for (index, &cell) in cells.iter().enumerate() {
            let middle = self.middle(cell);
            let is_turn = cells.get(index + 1).is_none_or(|&next| {
                let [arriving, leaving] = [middle - before, self.middle(next) - middle];
                arriving.perp(&leaving).abs() > BESIDE * self.cell_m * self.cell_m || arriving.dot(&leaving) < 0.0
            });
            let is_there = (middle - from).norm() <= BESIDE * self.cell_m;
            if is_turn && (!is_there || cells.len() == 1) {
                bends.push(middle);
            }
            before = middle;
        }
        bends
    }

    /// The end of a slot from `from` toward the middle of a neighbouring cell [m].
    fn advance(&self, from: &Position, goal: u32) -> Position {
        let end = self.middle(goal);
        let back = from - end;
        let steps = self.move_slots as f64;
        // Slots that are left of the move after this one.
        let left = (back.norm() / self.cell_m * steps).round() - 1.0;
        if left < 0.5 {
            return end;
        }
        let is_middle = 2.0 * left == steps;
        let part = left / steps + if is_middle { BEFORE_MIDDLE } else { 0.0 };
        end + back.try_normalize(0.0).unwrap_or_else(Vector2::zeros) * (part * self.cell_m)
    }

    /// Slots of the mission since the begin of a move, before `slot`.
    fn phase(&self, slot: u64) -> u64 {
        slot.saturating_sub(1) % self.move_slots
    }
}

impl Ways for Arc<GridCells> {
    /// Along a line of the grid, within a move.
    fn is_free(&self, _ground: &ClosedGround, from: &Position, to: &Position) -> bool {
        self.is_move(from, to)
    }

    fn is_move(&self, from: &Position, to: &Position) -> bool {
        match (self.spot(from), self.spot(to)) {
            (Some(Spot::Cell(from)), Some(Spot::Cell(to))) => from == to || self.is_neighbour(from, to),
            (Some(Spot::Cell(cell)), Some(Spot::Between(a, b, _)))
            | (Some(Spot::Between(a, b, _)), Some(Spot::Cell(cell))) => {
                (cell == a || cell == b) && self.is_neighbour(a, b)
            }
            (Some(Spot::Between(a, b, _)), Some(Spot::Between(c, d, _))) => (a, b) == (c, d) && self.is_neighbour(a, b),
            _ => false,
        }
    }

    fn nearest(&self, ground: &ClosedGround, point: &Position) -> Position {
        if self.is_reachable(ground, point) { *point } else { self.nearest_middle(point).unwrap_or(*point) }
    }

    /// A place on a line of the grid.
    fn is_reachable(&self, _ground: &ClosedGround, point: &Position) -> bool {
        match self.spot(point) {
            Some(Spot::Cell(cell)) => self.is_reached[cell as usize],
            Some(Spot::Between(a, b, _)) => self.is_reached[a as usize] && self.is_neighbour(a, b),
            None => false,
        }
    }

    /// To the cell nearest to `to`.
    fn way(&self, _ground: &ClosedGround, from: &Position, to: &Position) -> Bends {
        if self.is_move(from, to) { Bends::from_slice(&[*to]) } else { self.bends(from, &self.cells(from, to)) }
    }

    fn distance_m(&self, _ground: &ClosedGround, from: &Position, to: &Position) -> f64 {
        if self.is_move(from, to) { (to - from).norm() } else { self.length_m(from, to) }
    }

    fn between_m(&self, _ground: &ClosedGround, from: &Position, to: &Position) -> f64 {
        self.length_m(from, to)
    }

    /// Up to the first cell whose middle is within the radius; `from` alone if that is.
    fn way_into(
        &self,
        _ground: &ClosedGround,
        from: &Position,
        to: &Position,
        centre: &Position,
        radius_m: f64,
    ) -> Bends {
        if within(from, centre, radius_m) {
            return Bends::from_slice(&[*from]);
        }
        let cells = self.cells(from, to);
        let entered = cells.iter().position(|&cell| within(&self.middle(cell), centre, radius_m));
        entered.map_or_else(Bends::new, |entered| self.bends(from, &cells[..=entered]))
    }

    fn slot_end(&self, _ground: &ClosedGround, slot: u64, from: &Position, to: &Position, _reach_m: f64) -> Position {
        self.under_way(slot, from).unwrap_or_else(|| {
            // Told a place on the way to a neighbour, it flies on to the neighbour.
            let toward = match (self.spot(from), self.spot(to)) {
                (Some(Spot::Cell(cell)), Some(Spot::Between(a, b, _)))
                    if [a, b].contains(&cell) && self.is_neighbour(a, b) =>
                {
                    Some(if cell == a { b } else { a })
                }
                _ => {
                    // Told a place in reach, as far as the slots of a move would lead.
                    let step_m = self.cell_m / self.move_slots as f64;
                    let slots = if within(from, to, step_m) { self.move_slots as f64 } else { 1.0 };
                    self.cells(from, &(from + (to - from) * slots)).get(1).copied()
                }
            };
            toward.map_or(*from, |cell| self.advance(from, cell))
        })
    }

    /// Toward the first bend.
    fn step(&self, _ground: &ClosedGround, from: &Position, way: &[Position], reach_m: f64) -> (Position, usize) {
        let bend = &way[0];
        let along = bend - from;
        let away_m = along.norm();
        let is_there = away_m <= reach_m + BESIDE * self.cell_m;
        if is_there { (*bend, 1) } else { (from + along * (reach_m / away_m), 0) }
    }

    fn reached(&self) -> Vec<Position> {
        let cells = (0..).zip(&self.is_reached).filter(|(_, is_reached)| **is_reached);
        cells.map(|(cell, _)| self.middle(cell)).collect()
    }

    fn neighbouring(&self, at: &Position) -> Vec<Position> {
        let Some(Spot::Cell(cell)) = self.spot(at) else { return Vec::new() };
        self.neighbours(cell).map(|other| self.middle(other)).collect()
    }

    fn move_slots(&self) -> u64 {
        self.move_slots
    }

    /// It also hovers out of turn.
    fn under_way(&self, slot: u64, from: &Position) -> Option<Position> {
        let phase = self.phase(slot);
        match self.spot(from) {
            Some(Spot::Cell(_)) if phase == 0 => None,
            Some(Spot::Cell(cell)) => Some(self.middle(cell)),
            Some(Spot::Between(a, b, off)) => {
                let [near, far] = if off < 0.5 { [a, b] } else { [b, a] };
                let goal = if phase == 0 || 2 * phase > self.move_slots { near } else { far };
                Some(self.advance(from, goal))
            }
            None => Some(self.nearest_middle(from).unwrap_or(*from)),
        }
    }

    /// The move, or hover, that goes on, and its end.
    fn committed(&self, slot: u64, from: &Position, to: &Position) -> (u64, Position) {
        let slots = self.move_slots - self.phase(slot);
        let end = match self.spot(to) {
            Some(Spot::Between(a, b, _)) => {
                let [to_a, to_b] = [a, b].map(|cell| (self.middle(cell) - to).dot(&(to - from)));
                self.middle(if to_a > to_b { a } else { b })
            }
            _ => *to,
        };
        (slots, end)
    }
}

/// Whole cells of `cell_m` [m] along a side [m].
#[must_use]
pub fn cells_along(side_m: f64, cell_m: f64) -> u32 {
    (side_m / cell_m * (1.0 + CELLS_SLACK)).floor().min(f64::from(u32::MAX)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airspace::{Airspace, AnyWays, Polygon};

    fn at(x_m: f64, y_m: f64) -> Position {
        Position::new(x_m, y_m)
    }

    /// 8 × 6 cells of 10 m with a wall over the cells (3, 0) to (3, 4), and moves of `move_slots` slots.
    fn walled(move_slots: u64) -> Airspace {
        let wall = Polygon::of(&[[30.0, 0.0], [40.0, 0.0], [40.0, 50.0], [30.0, 50.0]], false).unwrap();
        Airspace::new([80.0, 60.0], 20.0, [(wall, f64::INFINITY)].into_iter()).on_grid(10.0, move_slots, &at(5.0, 5.0))
    }

    fn cells_of(airspace: &Airspace) -> &Arc<GridCells> {
        let AnyWays::Cells(cells) = &airspace.ways else { panic!("it has a grid") };
        cells
    }

    #[test]
    fn grid_paths_lead_around_zones() {
        let airspace = walled(4);
        let [from, to] = [at(25.0, 15.0), at(45.0, 15.0)];
        // Four north, two east, four south.
        assert_eq!(airspace.distance_m(&from, &to), 100.0);
        assert_eq!(airspace.way(&from, &to)[..], [at(25.0, 55.0), at(45.0, 55.0), to]);
        assert_eq!(airspace.distance_m(&at(25.0, 17.5), &to), 97.5, "from within a move");
        assert_eq!(airspace.nearest(&at(38.0, 12.0)), at(45.0, 15.0), "beside the wall");
        assert!(airspace.is_reachable(&at(75.0, 55.0)) && !airspace.is_reachable(&at(35.0, 5.0)));
        assert!(!airspace.is_reachable(&at(7.0, 6.0)), "beside the lines");
        assert_eq!(airspace.cells().count(), 8 * 6 - 5);
        let into = airspace.way_into(&from, &to, &to, 10.0);
        assert_eq!(into[..], [at(25.0, 55.0), at(45.0, 55.0), at(45.0, 25.0)]);
        assert_eq!(airspace.way_into(&from, &to, &from, 3.0)[..], [from]);
    }

    #[test]
    fn a_slot_leads_along_a_line_of_the_grid_or_stays() {
        let airspace = walled(4);
        let from = at(15.0, 15.0);
        assert_eq!(airspace.last_free(&from, &at(15.0, 25.0), [20.0; 2]), at(15.0, 25.0));
        assert_eq!(airspace.last_free(&from, &at(20.0, 20.0), [20.0; 2]), from, "beside the lines");
        assert_eq!(airspace.last_free(&at(25.0, 15.0), &at(35.0, 15.0), [20.0; 2]), at(25.0, 15.0), "into the wall");
        let grid = cells_of(&airspace);
        assert_eq!(grid.step(&airspace.ground, &from, &[at(15.0, 25.0)], 2.5), (at(15.0, 17.5), 0));
        assert_eq!(grid.step(&airspace.ground, &from, &[at(15.0, 25.0)], 10.0), (at(15.0, 25.0), 1));
        // In the second of four slots two are left after it, to the cell that it flies to.
        assert_eq!(grid.committed(2, &at(17.5, 15.0), &at(20.0, 15.0)), (3, at(25.0, 15.0)));
        assert_eq!(grid.committed(2, &at(22.5, 15.0), &at(20.0, 15.0)), (3, from));
        assert_eq!(grid.committed(1, &from, &from), (4, from), "a hover");
    }

    #[test]
    fn grids_are_equal_by_their_cells_and_moves() {
        assert!(walled(4) == walled(4) && walled(4) != walled(2));
        let open = Airspace::new([80.0, 60.0], 20.0, std::iter::empty()).on_grid(10.0, 4, &at(5.0, 5.0));
        assert!(walled(4).ways != open.ways, "other ways between the same cells");
    }

    #[test]
    fn grid_paths_are_as_short_as_those_of_a_reference_search() {
        // Bellman–Ford over all pairs of neighbours.
        let airspace = walled(1);
        let cells: Vec<Position> = airspace.cells().collect();
        for goal in &cells {
            let mut length_m = vec![f64::INFINITY; cells.len()];
            for _ in 0..cells.len() {
                for (index, cell) in cells.iter().enumerate() {
                    let beside = cells.iter().zip(&length_m).filter(|(other, _)| (*other - cell).norm() < 11.0);
                    let nearest_m = beside.map(|(_, length_m)| length_m + 10.0).fold(f64::INFINITY, f64::min);
                    length_m[index] = if cell == goal { 0.0 } else { nearest_m.min(length_m[index]) };
                }
            }
            for (cell, length_m) in cells.iter().zip(&length_m) {
                assert_eq!(airspace.distance_m(cell, goal), *length_m, "{cell} to {goal}");
            }
        }
    }

    /// Otherwise a plan of a way would not be what is flown of it, slot by slot.
    #[test]
    fn the_ways_to_and_from_a_cell_of_a_way_are_parts_of_it() {
        let airspace = walled(1);
        let grid = cells_of(&airspace);
        let cells: Vec<Position> = airspace.cells().collect();
        for (from, to) in cells.iter().flat_map(|from| cells.iter().map(move |to| (from, to))) {
            let way = grid.cells(from, to);
            for (passed, cell) in way.iter().enumerate() {
                assert_eq!(grid.cells(&grid.middle(*cell), to), way[passed..], "{from} to {to}");
                assert_eq!(
                    grid.cells(from, &grid.middle(*cell)),
                    way[..=passed],
                    "{from} to a cell on the way to {to}"
                );
            }
        }
    }

    /// A move that has begun goes on, whatever the UAV is told: the place and the slot say where it leads.
    #[test]
    fn a_move_in_progress_is_completed() {
        for move_slots in 1..=6 {
            let airspace = walled(move_slots);
            let reach_m = 10.0 / move_slots as f64;
            for (to, end) in [(at(25.0, 5.0), at(15.0, 5.0)), (at(5.0, 55.0), at(5.0, 15.0))] {
                let mut uav = at(5.0, 5.0);
                for slot in 1..=move_slots {
                    let told = if slot == 1 { to } else { at(5.0, 5.0) };
                    uav = airspace.slot_end(slot, &uav, &told, reach_m);
                    let flown_m = 10.0 * slot as f64 / move_slots as f64;
                    assert!(((uav - at(5.0, 5.0)).norm() - flown_m).abs() < 1e-6, "{move_slots}, {slot}: {uav}");
                    let (slots, goal) = airspace.committed(slot, &at(5.0, 5.0), &uav);
                    assert_eq!((slots, (goal - end).norm() < 1e-6), (move_slots - slot + 1, true), "{goal}");
                }
                assert_eq!(uav, end);
            }
            // Out of turn it waits.
            if move_slots > 1 {
                assert_eq!(airspace.slot_end(2, &at(5.0, 5.0), &at(25.0, 5.0), reach_m), at(5.0, 5.0));
            }
        }
    }
}
