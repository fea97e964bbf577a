//! The no-fly zones and the buildings of the scenario, as solids, and the shadows of the buildings.

use std::f64::consts::TAU;

use earcut::Earcut;
use nalgebra::Vector2;
use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{GridMap, LineStrips3D, Mesh3D};
use re_sdk_types::components::{AlbedoFactor, Colormap, ImageFormat};
use re_sdk_types::datatypes::{ChannelDatatype, ColorModel, Rgba32};
use skysink_common::airspace::Polygon;
use skysink_common::base::Base;
use skysink_common::geometry::{Position, above};
use skysink_common::scenario::{Area, Scenario};
use skysink_common::sensors::Sensors;

use crate::canvas::Canvas;
use crate::colour::{self, Rgb};
use crate::shapes::line_style;

/// The no-fly zones, numbered.
const NO_FLY: &str = "world/no-fly";

/// The buildings, numbered.
const BUILDINGS: &str = "world/buildings";

/// The boundary of the area.
const BOUNDARY: &str = "world/boundary";

/// Where buildings hide the UAV, over the area at its altitude: the share of the sensor nodes in range that see it.
pub const SHADOWS: &str = "world/shadows";

/// Cells of the longer side of the shadows.
const SHADOW_CELLS: u32 = 160;

/// Opacity of the shadows.
const SHADOW_OPACITY: f32 = 0.3;

/// Opacity of a no-fly zone, which has no walls to see.
const NO_FLY_OPACITY: u8 = 70;

/// Corners of the base on maps, where it is a disk.
const DISK_CORNERS: u32 = 48;

/// Draws the boundary, the no-fly zones up to the highest altitude of the UAV, and the buildings.
pub(crate) fn log_zones(canvas: &Canvas, scenario: &Scenario) -> RecordingStreamResult<()> {
    let area = &scenario.area;
    if let Some(border) = area.border() {
        canvas.log_static(BOUNDARY, &outline(border.corners(), 0.0, colour::NO_FLY))?;
    }
    let top_m = scenario.uav.climb().map_or(scenario.uav.altitude_m, |climb| climb.max_altitude_m);
    for (index, zone) in area.no_fly.iter().flatten().enumerate() {
        draw(canvas, &format!("{NO_FLY}/{index}"), zone.corners(), top_m, [colour::NO_FLY; 2], NO_FLY_OPACITY)?;
    }
    for (index, building) in area.building.iter().flatten().enumerate() {
        let name = format!("{BUILDINGS}/{index}");
        draw(canvas, &name, &building.polygon_m, building.height_m, [colour::BUILDING, colour::EDGE], u8::MAX)?;
    }
    Ok(())
}

/// Draws the shadows of the buildings among `sensors`; nothing if line of sight does not depend on buildings.
pub(crate) fn log_shadows(canvas: &Canvas, scenario: &Scenario, sensors: &Sensors) -> RecordingStreamResult<()> {
    let Some(buildings) = &scenario.link.buildings else { return Ok(()) };
    let share = |at: Position| {
        let mut in_range = 0;
        let mut seen = 0;
        sensors.grid.visit_within(&at, scenario.link.comm_radius_m, |node| {
            in_range += 1;
            seen += u32::from(buildings.sees(&node.position, &above(&at, scenario.uav.altitude_m)));
        });
        (255 * seen).checked_div(in_range).map_or(u8::MAX, |share| share as u8)
    };
    let raster = Raster::over(&scenario.area, SHADOW_CELLS);
    let map = raster.map(raster.centres().map(share).collect(), ColorModel::L);
    canvas.log_static(SHADOWS, &map.with_colormap(Colormap::Grayscale).with_opacity(SHADOW_OPACITY))
}

/// Square cells over the area, row by row from the north-west.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Raster {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    /// Side of a cell [m].
    pub(crate) cell_m: f64,
    /// Extent of the area in y [m].
    pub(crate) depth_m: f64,
}

impl Raster {
    /// So many cells along the longer side of the area.
    pub(crate) fn over(area: &Area, cells: u32) -> Self {
        let sides_m = [area.width_m(), area.height_m()];
        let cell_m = sides_m[0].max(sides_m[1]) / f64::from(cells);
        let [columns, rows] = sides_m.map(|side_m| (side_m / cell_m).ceil().max(1.0) as u32);
        Self { columns, rows, cell_m, depth_m: sides_m[1] }
    }

    /// The middle of a cell [m].
    pub(crate) fn centre(&self, column: u32, row: u32) -> Position {
        let [east_m, south_m] = [column, row].map(|cell| (f64::from(cell) + 0.5) * self.cell_m);
        Position::new(east_m, self.depth_m - south_m)
    }

    /// The middles of the cells [m].
    pub(crate) fn centres(&self) -> impl Iterator<Item = Position> {
        (0..self.rows).flat_map(move |row| (0..self.columns).map(move |column| self.centre(column, row)))
    }

    /// The image on the ground with these pixels.
    pub(crate) fn map(&self, pixels: Vec<u8>, colours: ColorModel) -> GridMap {
        let format = ImageFormat::from_color_model([self.columns, self.rows], colours, ChannelDatatype::U8);
        let lowest_m = self.depth_m - f64::from(self.rows) * self.cell_m;
        GridMap::new(pixels, format, self.cell_m as f32).with_translation([0.0, lowest_m as f32, 0.0])
    }
}

/// The closed outlines on maps [m], by kind: its name and its colour. Kinds that the scenario lacks are left out.
pub(crate) fn outlines(scenario: &Scenario) -> impl Iterator<Item = (&'static str, Vec<Vec<Position>>, Rgb)> {
    let area = &scenario.area;
    let closed = |corners: &[Position]| corners.iter().chain(corners.first()).copied().collect::<Vec<_>>();
    let of_keys = |corners: &[[f64; 2]]| closed(&corners.iter().copied().map(Position::from).collect::<Vec<_>>());
    let boundary = area.boundary_m.iter().map(|corners| of_keys(corners));
    let no_fly = area.no_fly.iter().flatten().map(|zone| of_keys(zone.corners()));
    let buildings = area.building.iter().flatten().map(|building| of_keys(&building.polygon_m));
    let of_shape = |shape: &Base| -> Vec<Vec<Position>> {
        match shape {
            Base::Areas(areas) => areas.iter().map(|area| closed(area.polygon.corners())).collect(),
            Base::Disk { centre, radius_m } => {
                let angle = |corner: u32| TAU * f64::from(corner) / f64::from(DISK_CORNERS);
                let rim = |corner: u32| centre + Vector2::from(<[f64; 2]>::from(angle(corner).sin_cos())) * *radius_m;
                vec![(0..=DISK_CORNERS).map(rim).collect()]
            }
            Base::Sites(_) => Vec::new(), // a shape is none
        }
    };
    let base = scenario.landing_base().iter().flat_map(Base::shapes).flat_map(of_shape).collect();
    let kinds = [
        ("boundary", boundary.collect(), colour::NO_FLY),
        ("no-fly", no_fly.collect(), colour::NO_FLY),
        ("buildings", buildings.collect(), colour::EDGE),
        ("base", base, colour::CHARGE),
    ];
    kinds.into_iter().filter(|(_, outlines, _): &(_, Vec<Vec<Position>>, _)| !outlines.is_empty())
}

fn draw(
    canvas: &Canvas,
    name: &str,
    corners: &[[f64; 2]],
    top_m: f64,
    [colour, edge]: [Rgb; 2],
    opacity: u8,
) -> RecordingStreamResult<()> {
    let Ok(ring) = Polygon::of(corners, false) else { return Ok(()) };
    canvas.log_static(name, &solid(ring.corners(), top_m, colour, opacity))?;
    canvas.log_static(format!("{name}/top"), &outline(ring.corners(), top_m, edge))
}

/// The closed line through `corners` at an altitude.
fn outline(corners: &[Position], z_m: f64, colour: Rgb) -> LineStrips3D {
    let closed = corners.iter().chain(corners.first());
    let strip: Vec<[f32; 3]> = closed.map(|corner| [corner.x as f32, corner.y as f32, z_m as f32]).collect();
    line_style(colour, 1.5).with_strips([strip])
}

/// Walls and roof over `corners`, counter-clockwise.
fn solid(corners: &[Position], top_m: f64, colour: Rgb, opacity: u8) -> Mesh3D {
    let at = |z_m: f64| corners.iter().map(move |corner| [corner.x as f32, corner.y as f32, z_m as f32]);
    let mut roof: Vec<u32> = Vec::new();
    Earcut::new().earcut(corners.iter().map(|corner| [corner.x, corner.y]), &[], &mut roof);
    let count = corners.len() as u32;
    let roof =
        roof.chunks_exact(3).map(|triangle| [triangle[0], triangle[1], triangle[2]].map(|corner| corner + count));
    let walls = (0..count).flat_map(|corner| {
        let next = (corner + 1) % count;
        [[corner, next, next + count], [corner, next + count, corner + count]]
    });
    let triangles: Vec<[u32; 3]> = walls.chain(roof).collect();
    let [red, green, blue] = colour;
    Mesh3D::new(at(0.0).chain(at(top_m)))
        .with_triangle_indices(triangles)
        .with_albedo_factor(AlbedoFactor(Rgba32::from_unmultiplied_rgba(red, green, blue, opacity)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_outline_what_the_scenario_has_and_close_each_outline() {
        let of = |keys: &str| {
            let text = format!("name = 'x'\n{keys}");
            let scenario = Scenario::parse(&text, std::path::Path::new("x.toml"), Default::default()).unwrap();
            outlines(&scenario).map(|(name, outlines, _)| (name, outlines)).collect::<Vec<_>>()
        };
        assert!(of("").is_empty());
        let zones = "[area]\nno_fly = [{ polygon_m = [[60.0, 45.0], [70.0, 45.0], [70.0, 55.0]] }]\n\
                     building = [{ polygon_m = [[30.0, 45.0], [40.0, 45.0], [40.0, 55.0]], height_m = 9.0 }]\n\
                     [base]\nradius_m = 5.0\n";
        let found = of(zones);
        assert_eq!(found.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["no-fly", "buildings", "base"]);
        assert!(
            found
                .iter()
                .flat_map(|(_, outlines)| outlines)
                .all(|outline| { (outline[0] - outline[outline.len() - 1]).norm() < 1e-9 })
        );
        let rim = &found[2].1[0];
        assert!(rim.iter().all(|at| ((at - Position::new(50.0, 50.0)).norm() - 5.0).abs() < 1e-9));
    }

    #[test]
    fn a_solid_has_two_triangles_for_each_wall_and_covers_its_ground_plan() {
        let corners = [[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [20.0, 30.0], [20.0, 10.0], [0.0, 10.0]];
        let ring = Polygon::of(&corners, false).unwrap();
        let mut roof: Vec<u32> = Vec::new();
        Earcut::new().earcut(ring.corners().iter().map(|corner| [corner.x, corner.y]), &[], &mut roof);
        let at = |index: u32| ring.corners()[index as usize];
        let twice_m2 = |of: &[u32]| (at(of[1]) - at(of[0])).perp(&(at(of[2]) - at(of[0]))).abs();
        assert_eq!(roof.chunks_exact(3).map(twice_m2).sum::<f64>() / 2.0, 30.0 * 10.0 + 10.0 * 20.0);
        let mesh = solid(ring.corners(), 20.0, colour::BUILDING, 255);
        assert_eq!(mesh.vertex_positions.unwrap().array.len(), 12);
        assert_eq!(mesh.triangle_indices.unwrap().array.len(), 12 + 4);
    }
}
