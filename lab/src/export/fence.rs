//! The geofence: the boundary of the area, or a wider one.

use geo::algorithm::buffer::{Buffer, BufferStyle, LineJoin};
use geo::{LineString, MultiPolygon, Polygon};
use skysink_common::geometry::Position;
use skysink_common::interpolation::interpolate;
use skysink_common::scenario::Area;

/// Maximum length of a side of the fence [m]. A straight line of the tangent plane deviates from a rhumb line by about
/// `L² tan φ/8R`, half a metre at mid-latitudes.
const FENCE_SIDE_M: f64 = 5000.0;

/// Maximum number of fence sides along one side of the area. Vehicles support about 60 corners.
const MAX_FENCE_SIDES: f64 = 15.0;

/// Sharper corners of a wider fence are cut [rad].
const SHARPEST: f64 = 0.5;

/// Points along the boundary of the area, `margin_m` [m] outside of it, counter-clockwise: the corners of its polygon,
/// or points on the sides of its rectangle from the south-west corner.
pub fn border(area: &Area, margin_m: f64) -> Vec<Position> {
    if let Some(border) = area.border() {
        return widened(border.corners().iter().rev().copied().collect(), margin_m);
    }
    let [right_m, top_m] = [area.width_m() + margin_m, area.height_m() + margin_m];
    let [left_m, bottom_m] = [-margin_m; 2];
    let corners = [[left_m, bottom_m], [right_m, bottom_m], [right_m, top_m], [left_m, top_m]].map(Position::from);
    let side = |index: usize| {
        let from = corners[index];
        let to = corners[(index + 1) % 4];
        let parts = ((to - from).norm() / FENCE_SIDE_M).ceil().clamp(1.0, MAX_FENCE_SIDES) as u32;
        (0..parts).map(move |part| interpolate(from, to, f64::from(part) / f64::from(parts)))
    };
    (0..4).flat_map(side).collect()
}

/// The outline of the polygon with these corners, `margin_m` [m] outside of it.
fn widened(corners: Vec<Position>, margin_m: f64) -> Vec<Position> {
    if margin_m == 0.0 {
        return corners;
    }
    let style = BufferStyle::new(margin_m).line_join(LineJoin::Miter(SHARPEST));
    let MultiPolygon(outlines) = polygon(&corners).buffer_with_style(style);
    let outline = outlines.first().expect("a wider polygon is one polygon");
    let corners = outline.exterior().points().skip(1); // the first is the last, too
    corners.map(|corner| Position::new(corner.x(), corner.y())).collect()
}

/// The polygon with these corners [m].
pub fn polygon(corners: &[Position]) -> Polygon {
    Polygon::new(corners.iter().map(|corner| (corner.x, corner.y)).collect::<LineString>(), vec![])
}
