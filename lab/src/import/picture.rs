//! Zones, buildings and bases from a picture of a map, in the colours of the public data harvesting environments: red
//! for what must not be entered, green for buildings, both (yellow) for buildings that must not be entered, blue for
//! where to start and land.

/// Most pixels along a side.
#[cfg(feature = "pictures")]
const MOST_CELLS: u32 = 1_000;

/// From which value on a colour is there.
#[cfg(feature = "pictures")]
const PRESENT: u8 = 128;

/// How far the corners of cells that touch at a corner only keep apart, in cells.
const APART: f64 = 1e-4;

/// Outlines in cells, from the south-west corner of the picture; rows of pixels go from the north to the south.
#[derive(Debug, Clone, PartialEq)]
pub struct MapPicture {
    /// Pixels to the east.
    pub columns: u32,
    /// Pixels to the north.
    pub rows: u32,
    /// Outlines of what must not be entered.
    pub no_fly: Vec<Vec<[f64; 2]>>,
    /// Outlines of buildings.
    pub buildings: Vec<Vec<[f64; 2]>>,
    /// Outlines of where to start and land.
    pub landing: Vec<Vec<[f64; 2]>>,
    /// The middle of a pixel to start from: one to land in, or the free one that is nearest to the middle of the
    /// picture.
    pub start: [f64; 2],
}

/// Columns and rows of a PNG picture, and which colours are in each of its pixels.
#[cfg(feature = "pictures")]
fn decode(bytes: &[u8]) -> Result<([u32; 2], Vec<[bool; 3]>), String> {
    let pixels = resvg::tiny_skia::Pixmap::decode_png(bytes);
    let pixels = pixels.map_err(|error| format!("{error}: expected a PNG picture"))?;
    let (columns, rows) = (pixels.width(), pixels.height());
    if columns > MOST_CELLS || rows > MOST_CELLS {
        return Err(format!("{columns} × {rows} pixels: expected at most {MOST_CELLS} × {MOST_CELLS}"));
    }
    let is_present = |value| value >= PRESENT;
    let colours = pixels.pixels().iter().map(|pixel| [pixel.red(), pixel.green(), pixel.blue()].map(is_present));
    Ok(([columns, rows], colours.collect()))
}

#[cfg(not(feature = "pictures"))]
fn decode(_: &[u8]) -> Result<([u32; 2], Vec<[bool; 3]>), String> {
    Err("this build reads no pictures: build with the default features".to_owned())
}

/// Reads a picture in the format PNG.
pub fn read(bytes: &[u8]) -> Result<MapPicture, String> {
    let ([columns, rows], colours) = decode(bytes)?;
    // White is no colour of the code: it is ground, as black is.
    let of = |is_there: fn([bool; 3]) -> bool| {
        let at = |x: u32, y: u32| {
            let colour = colours[((rows - 1 - y) * columns + x) as usize];
            colour != [true; 3] && is_there(colour)
        };
        Cells::of(columns, rows, at)
    };
    let no_fly = of(|[red, ..]| red);
    let buildings = of(|[_, green, _]| green);
    let landing = of(|[_, _, blue]| blue);
    let centre = [columns, rows].map(|count| f64::from(count) / 2.0);
    let middle = |(x, y): (u32, u32)| [x, y].map(|index| f64::from(index) + 0.5);
    let away = |cell: &(u32, u32)| {
        let [x, y] = middle(*cell);
        (x - centre[0]).hypot(y - centre[1])
    };
    let free = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    let free =
        free.filter(|&(x, y)| landing.has(x, y) || landing.is_empty() && !no_fly.has(x, y) && !buildings.has(x, y));
    let start = free.min_by(|a, b| away(a).total_cmp(&away(b)));
    let Some(start) = start else { return Err("no free pixel: expected one that is neither red nor green".to_owned()) };
    let [no_fly, buildings, landing] = [no_fly, buildings, landing].map(|cells| cells.outlines());
    Ok(MapPicture { columns, rows, no_fly, buildings, landing, start: middle(start) })
}

/// A set of cells.
#[derive(Debug, Clone, PartialEq)]
struct Cells {
    columns: u32,
    rows: u32,
    is_in: Vec<bool>,
}

impl Cells {
    fn of(columns: u32, rows: u32, is_in: impl Fn(u32, u32) -> bool) -> Self {
        let cells = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
        Self { columns, rows, is_in: cells.map(|(x, y)| is_in(x, y)).collect() }
    }

    fn has(&self, x: u32, y: u32) -> bool {
        x < self.columns && y < self.rows && self.is_in[(y * self.columns + x) as usize]
    }

    fn is_empty(&self) -> bool {
        !self.is_in.contains(&true)
    }

    /// Its parts, whose cells are joined by edges.
    fn parts(&self) -> Vec<Self> {
        let mut rest = self.clone();
        let mut parts = Vec::new();
        while let Some(first) = rest.is_in.iter().position(|is_in| *is_in) {
            let mut part = Self { is_in: vec![false; self.is_in.len()], ..*self };
            let mut pending = vec![(first as u32 % self.columns, first as u32 / self.columns)];
            while let Some((x, y)) = pending.pop() {
                if rest.has(x, y) {
                    let index = (y * self.columns + x) as usize;
                    rest.is_in[index] = false;
                    part.is_in[index] = true;
                    pending.extend([(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)]);
                }
            }
            parts.push(part);
        }
        parts
    }

    /// A column of a hole: of cells that are not in the set and not joined with the outside.
    fn hole(&self) -> Option<u32> {
        let other = Self { is_in: self.is_in.iter().map(|is_in| !is_in).collect(), ..*self };
        let is_hole = |part: &Self| {
            let at_rim = |x: u32, y: u32| x == 0 || y == 0 || x + 1 == self.columns || y + 1 == self.rows;
            !(0..self.rows).any(|y| (0..self.columns).any(|x| at_rim(x, y) && part.has(x, y)))
        };
        let hole = other.parts().into_iter().find(is_hole)?;
        hole.is_in.iter().position(|is_in| *is_in).map(|index| index as u32 % self.columns)
    }

    /// Polygons that cover the set, none of which has a hole. Those of a part with holes overlap by a column, so that
    /// no seam is left between them.
    fn outlines(&self) -> Vec<Vec<[f64; 2]>> {
        let mut pending = self.parts();
        let mut outlines = Vec::new();
        pending.reverse();
        while let Some(part) = pending.pop() {
            match part.hole() {
                None => outlines.push(part.outline()),
                Some(column) => {
                    let west = Self::of(self.columns, self.rows, |x, y| x <= column && part.has(x, y));
                    let east = Self::of(self.columns, self.rows, |x, y| x >= column && part.has(x, y));
                    pending.extend([west, east].iter().flat_map(Self::parts));
                }
            }
        }
        outlines
    }

    /// The corners of a part without holes, counterclockwise.
    fn outline(&self) -> Vec<[f64; 2]> {
        let first = self.is_in.iter().position(|is_in| *is_in).unwrap_or(0) as u32;
        let begin = (i64::from(first % self.columns), i64::from(first / self.columns));
        let is_in = |x: i64, y: i64| u32::try_from(x).is_ok_and(|x| u32::try_from(y).is_ok_and(|y| self.has(x, y)));
        // Along the boundary with the set to the left; the first cell has no cell to the south.
        let (mut at, mut step) = (begin, (1i64, 0i64));
        let mut corners = Vec::new();
        loop {
            at = (at.0 + step.0, at.1 + step.1);
            // The cells ahead, to the left and to the right of the way.
            let cell = |side: (i64, i64)| {
                let x = at.0 + (step.0 + side.0 - 1) / 2;
                let y = at.1 + (step.1 + side.1 - 1) / 2;
                is_in(x, y)
            };
            let left = (-step.1, step.0);
            let [ahead_left, ahead_right] = [cell(left), cell((-left.0, -left.1))];
            let turned = match (ahead_left, ahead_right) {
                (false, _) => left, // also where two cells touch at a corner: the outline stays with its own
                (true, true) => (step.1, -step.0),
                (true, false) => step,
            };
            if turned != step {
                let apart = if !ahead_left && ahead_right { APART } else { 0.0 };
                // Into the own cell, which is behind and to the left.
                let [x, y] = [(at.0, left.0 - step.0), (at.1, left.1 - step.1)]
                    .map(|(index, inward)| index as f64 + apart * inward as f64);
                corners.push([x, y]);
            }
            step = turned;
            if at == begin && step == (1, 0) {
                return corners;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::airspace::Polygon;
    use skysink_common::geometry::Position;

    /// Cells from lines, the north first; `#` is in.
    fn cells(lines: &[&str]) -> Cells {
        let rows = lines.len() as u32;
        let at = |x: u32, y: u32| lines[(rows - 1 - y) as usize].as_bytes()[x as usize] == b'#';
        Cells::of(lines[0].len() as u32, rows, at)
    }

    /// Whether the outlines are simple polygons that cover the cells and nothing else.
    fn assert_covers(cells: &Cells) -> usize {
        let outlines = cells.outlines();
        let polygons: Vec<Polygon> = outlines.iter().map(|outline| Polygon::of(outline, false).unwrap()).collect();
        for y in 0..cells.rows {
            for x in 0..cells.columns {
                for (dx, dy) in [(0.5, 0.5), (0.01, 0.01), (0.99, 0.01), (0.01, 0.99), (0.99, 0.99)] {
                    let at = Position::new(f64::from(x) + dx, f64::from(y) + dy);
                    let is_covered = polygons.iter().any(|polygon| polygon.encloses(&at));
                    assert_eq!(is_covered, cells.has(x, y), "({x}, {y}) of {cells:?}: {outlines:?}");
                }
            }
        }
        outlines.len()
    }

    #[test]
    fn parts_become_polygons() {
        assert_eq!(cells(&["##.", "#..", "..#"]).outlines().len(), 2);
        assert_eq!(cells(&["###", "#..", "###"]).outline().len(), 8);
        assert_eq!(assert_covers(&cells(&["####", "####"])), 1);
    }

    #[test]
    fn a_part_with_a_hole_becomes_polygons_that_overlap() {
        let ring = cells(&["#####", "#...#", "#####"]);
        assert!(assert_covers(&ring) > 1);
        let polygons: Vec<Polygon> =
            ring.outlines().iter().map(|outline| Polygon::of(outline, false).unwrap()).collect();
        // Along any line of the lattice across the ring, a point is deep in one of them.
        for step in 1..50 {
            let at = Position::new(f64::from(step) / 10.0, 0.5);
            assert!(polygons.iter().any(|polygon| polygon.forbids(&at, 1e-6)), "{at}");
        }
    }

    #[test]
    fn cells_that_touch_at_a_corner_become_simple_polygons() {
        assert_eq!(assert_covers(&cells(&["#.", ".#"])), 2);
        assert_covers(&cells(&["##.", "#.#", "###"]));
        assert_covers(&cells(&[".##", "#.#", "###"]));
        assert_covers(&cells(&["###", "#.#", ".##"]));
    }

    #[test]
    fn polygons_cover_any_set_of_cells() {
        use rand::{RngExt, SeedableRng};
        let mut random = rand::rngs::StdRng::seed_from_u64(7);
        for round in 0..300 {
            let density = 0.3 + 0.1 * f64::from(round % 7);
            let drawn: Vec<bool> = (0..56).map(|_| random.random_bool(density)).collect();
            assert_covers(&Cells::of(8, 7, |x, y| drawn[(y * 8 + x) as usize]));
        }
    }
}
