//! The no-fly zones and the buildings of the scenario, as solids.

use earcut::Earcut;
use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{LineStrips3D, Mesh3D};
use re_sdk_types::components::AlbedoFactor;
use re_sdk_types::datatypes::Rgba32;
use skysink_common::airspace::Polygon;
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;

use crate::canvas::Canvas;
use crate::colour::{self, Rgb};
use crate::shapes::line_style;

/// The no-fly zones, numbered.
const NO_FLY: &str = "world/no-fly";

/// The buildings, numbered.
const BUILDINGS: &str = "world/buildings";

/// The boundary of the area.
const BOUNDARY: &str = "world/boundary";

/// Opacity of a no-fly zone, which has no walls to see.
const NO_FLY_OPACITY: u8 = 70;

/// Draws the boundary, the no-fly zones up to the highest altitude of the UAV, and the buildings.
pub(crate) fn log_zones(canvas: &Canvas, scenario: &Scenario) -> RecordingStreamResult<()> {
    let area = &scenario.area;
    if let Some(border) = area.border() {
        canvas.log_static(BOUNDARY, &outline(border.corners(), 0.0, colour::NO_FLY))?;
    }
    let top_m = scenario.uav.climb().map_or(scenario.uav.altitude_m, |climb| climb.max_altitude_m);
    for (index, zone) in area.no_fly.iter().flatten().enumerate() {
        draw(canvas, &format!("{NO_FLY}/{index}"), &zone.polygon_m, top_m, [colour::NO_FLY; 2], NO_FLY_OPACITY)?;
    }
    for (index, building) in area.building.iter().flatten().enumerate() {
        let name = format!("{BUILDINGS}/{index}");
        draw(canvas, &name, &building.polygon_m, building.height_m, [colour::BUILDING, colour::EDGE], u8::MAX)?;
    }
    Ok(())
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
