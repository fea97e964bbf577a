//! `skysink new --terrain`: no-fly zones over high ground, and links by place without those that the ground hides
//! (decision D37).

use std::path::Path;

use skysink_common::airspace::{KeptGround, Polygon, simplify};
use skysink_common::channel::{Channel, ChannelModel, LinkMap};
use skysink_common::error::InputError;
use skysink_common::geometry::{Position, above, distance_squared};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_lab::import::{Frame, GROUND, HeightGrid, Imported, MapGrid, outlines};

use super::additions::{Additions, LINKS, MOST_OF_NODE, MOST_POINTS};
use super::presets::Lines;

/// Corners of zones up to which they are as exact as the cells.
const EXACT_CORNERS: usize = 100;

/// The ground of a new scenario.
pub struct Terrain<'a> {
    path: &'a Path,
    grid: HeightGrid,
    /// Least height of the UAV above all ground [m].
    clearance_m: f64,
}

impl<'a> Terrain<'a> {
    /// Reads the grid in the file `path`.
    pub fn read(path: &'a Path, clearance_m: f64) -> Result<Self, InputError> {
        Ok(Self { path, grid: HeightGrid::read(path)?, clearance_m })
    }

    fn refuse(&self, message: &str) -> InputError {
        InputError::new("terrain", self.path, message)
    }

    /// Adds the ground at the sensor nodes of the file `path` as a column, unless it has one.
    ///
    /// # Errors
    /// If positions are no metres, or there is no ground at one.
    pub fn add_ground(&self, imported: &mut Imported, path: &Path) -> Result<(), InputError> {
        if imported.frame != Frame::Plane {
            let expected = "latitudes and longitudes: expected metres in the reference system of the terrain";
            return Err(InputError::new("sensor positions", path, expected));
        }
        if imported.others.contains(&GROUND) {
            return Ok(());
        }
        imported.others.push(GROUND);
        for sensor in &mut imported.sensors {
            let height_m = self.grid.height_m(&Position::from(sensor.position)).ok_or_else(|| {
                let expected = format!("expected a place with a height in {}", self.path.display());
                InputError::new("sensor positions", path, format_args!("{}: {expected}", sensor.place))
            })?;
            sensor.others.push(in_mm(height_m).to_string());
        }
        Ok(())
    }

    /// The zones and the map over the area of `draft`, which lies by `shift` [m] beside the grid; with their `lines`.
    ///
    /// # Errors
    /// If there is not a height in all of the area, or the start is not free.
    pub fn additions(
        &self,
        draft: &Scenario,
        list: &SensorList,
        shift: [f64; 2],
        lines: &mut Lines,
    ) -> Result<Additions, InputError> {
        let sides_m = [draft.area.width_m(), draft.area.height_m()];
        let grid = self.grid.over(sides_m, shift).map_err(|message| self.refuse(&message))?;
        let start = draft.start().xy();
        let start_m = grid.height_m(&start).expect("the start is in the area");
        let altitude_m = start_m + draft.uav.altitude_m;
        let mut additions = Additions::default();
        if grid.is_flat() {
            return Ok(additions);
        }
        self.add_zones(&grid, altitude_m, &start, &mut additions)?;
        additions.notes.push(format!(
            "terrain: {:.1} m at the start, {altitude_m:.1} m in flight, {} no-fly zones where the ground is above {:.1} m",
            start_m,
            additions.zones.matches("[[area.no_fly]]").count(),
            altitude_m - self.clearance_m
        ));
        add_links(&grid, altitude_m, draft, list, &mut additions).map_err(|message| self.refuse(&message))?;
        let link = &draft.link;
        let setup = link.setup_s.map(|setup_s| format!("setup_s = {setup_s:?}\n")).unwrap_or_default();
        lines.set_map(format!(
            "model = \"map\"                     # none where the ground hides an SN\nfile = \"{LINKS}\"\n{setup}"
        ));
        // Those of a preset, which a map does not have.
        let radius = format!("comm_radius_m = {:?}", link.comm_radius_m);
        lines.set("link.comm_radius_m", &radius, "Communication radius on the ground, d_c [m]");
        let blocks = format!("resource_blocks = {}", link.resource_blocks);
        lines.set("link.resource_blocks", &blocks, "Resource blocks, n, the most SNs served in a slot");
        Ok(additions)
    }

    /// Adds the cells that are too high as zones, of fewer corners where that lets them grow by less than a cell.
    fn add_zones(
        &self,
        grid: &HeightGrid,
        altitude_m: f64,
        start: &Position,
        additions: &mut Additions,
    ) -> Result<(), InputError> {
        let limit_m = altitude_m - self.clearance_m;
        let marked = grid.above(limit_m);
        let corner_m =
            |[x, y]: &[usize; 2]| (grid.corner + Position::new(*x as f64, *y as f64).coords * grid.cell_m).into();
        let rings = outlines(&marked, grid.cells, |cell| grid.heights_m[cell]);
        let polygon = |ring: &Vec<[usize; 2]>| {
            let corners_m: Vec<[f64; 2]> = ring.iter().map(corner_m).collect();
            Polygon::of(&corners_m, false).expect("outlines are simple")
        };
        let mut polygons: Vec<Polygon> = rings.iter().map(polygon).collect();
        if polygons.iter().any(|polygon| polygon.forbids(start, 0.0)) {
            return Err(self.refuse(&format!(
                "the ground at the start, ({}, {}) m in the area, is or lies within ground above {limit_m:.1} m: expected \
                 another --start, or less than --clearance {}",
                start.x, start.y, self.clearance_m
            )));
        }
        simplify(&mut polygons, EXACT_CORNERS, grid.cell_m, KeptGround { places: &[*start], areas: &[] });
        for polygon in &polygons {
            let corners_m: Vec<[f64; 2]> = polygon.corners().iter().map(|at| [in_mm(at.x), in_mm(at.y)]).collect();
            additions.zones += &format!("\n[[area.no_fly]]\npolygon_m = {corners_m:?}\n");
        }
        Ok(())
    }
}

/// A length rounded to millimetres [m].
fn in_mm(along_m: f64) -> f64 {
    (along_m * 1e3).round() / 1e3
}

/// Adds a map of the rates of the radio of `draft`, without links where the ground hides a sensor node.
fn add_links(
    grid: &HeightGrid,
    altitude_m: f64,
    draft: &Scenario,
    list: &SensorList,
    additions: &mut Additions,
) -> Result<(), String> {
    let nodes = list.nodes();
    let sides_m = [draft.area.width_m(), draft.area.height_m()];
    let most = (MOST_POINTS / nodes.len()).min(MOST_OF_NODE);
    let map_grid = MapGrid::over(sides_m, grid.cell_m.min(draft.link.comm_radius_m), most, draft.uav.altitude_m);
    let channel = Channel::of(&draft.link);
    // Cells of the map that begin farther away are of no use.
    let farthest_m = draft.link.comm_radius_m + 2.0 * map_grid.step_m;
    let count = map_grid.nodes[0] * map_grid.nodes[1];
    let (mut reached, mut hidden) = (0usize, 0usize);
    let mut rates_bps = Vec::with_capacity(nodes.len() * count);
    for node in &nodes {
        let sensor = Position::new(node.x_m, node.y_m);
        let ground_m = grid.height_m(&sensor).expect("sensor nodes are in the area");
        let from = above(&sensor, ground_m);
        let mut rate_bps = |index: usize| {
            let at = map_grid.position(index).inf(&Position::from(sides_m));
            let d2_m2 = distance_squared(&at, &sensor);
            if d2_m2 > farthest_m * farthest_m || altitude_m <= ground_m {
                return f64::NAN;
            }
            reached += 1;
            if !grid.is_in_sight(&from, &above(&at, altitude_m)) {
                hidden += 1;
                return f64::NAN;
            }
            let uplink = channel.uplink_at(node.gain, d2_m2, altitude_m - ground_m);
            channel.expected_rate_bps(&uplink).round()
        };
        rates_bps.extend((0..count).map(&mut rate_bps));
    }
    let shape = [nodes.len(), 1, map_grid.nodes[1], map_grid.nodes[0]];
    let map = LinkMap::of_arrays(map_grid.axes_m(), &shape, &rates_bps, None);
    additions.add_map(map.expect("rates are finite, and nodes ascend"), list)?;
    additions.notes.push(format!(
        "links: hidden by the ground from {:.1} % of the places in range, on a grid of {} m",
        100.0 * hidden as f64 / reached.max(1) as f64,
        map_grid.step_m
    ));
    Ok(())
}
