//! Shapes and styles that several parts of the picture draw.

use std::f32::consts::TAU;

use nalgebra::Point3;
use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{LineStrips3D, Points2D, Points3D, SeriesLines, SeriesPoints, Transform3D};
use re_sdk_types::components::{MarkerShape, Radius};

use crate::canvas::Canvas;
use crate::colour::{self, Rgb};

/// A position in the scene [m].
pub(crate) type Point = [f32; 3];

/// Converts a position to single precision, as rerun draws.
pub(crate) fn drawn(point: Point3<f64>) -> Point {
    point.coords.map(|coordinate_m| coordinate_m as f32).into()
}

/// A closed horizontal circle.
pub(crate) fn circle(centre_m: Point, radius_m: f32) -> Vec<Point> {
    circle_of(centre_m, radius_m, 64)
}

/// A closed horizontal circle with so many corners.
pub(crate) fn circle_of([x_m, y_m, z_m]: Point, radius_m: f32, corners: u16) -> Vec<Point> {
    (0..=corners)
        .map(|corner| f32::from(corner) / f32::from(corners) * TAU)
        .map(|angle| [x_m + radius_m * angle.cos(), y_m + radius_m * angle.sin(), z_m])
        .collect()
}

/// Moves a horizontal circle, whose line is static, by a transform. `None` hides it.
pub(crate) fn show_circle(
    canvas: &Canvas,
    entity: &str,
    centre_m: Option<Point>,
    radius_m: f32,
) -> RecordingStreamResult<()> {
    let line = centre_m.map(|_| circle([0.0; 3], radius_m));
    canvas.show(entity, &LineStrips3D::update_fields().with_strips(line))?;
    let Some(centre_m) = centre_m else { return Ok(()) };
    canvas.show(entity, &Transform3D::update_fields().with_translation(centre_m))
}

/// Lines of one colour and width, in points of the screen.
pub(crate) fn line_style(colour: Rgb, width_ui: f32) -> LineStrips3D {
    LineStrips3D::update_fields().with_colors([colour]).with_radii([Radius::new_ui_points(width_ui)])
}

/// A curve of one colour, under the name `name`.
pub(crate) fn curve_style(name: &str, colour: Rgb) -> SeriesLines {
    SeriesLines::new().with_names([name]).with_colors([colour]).with_widths([1.5])
}

/// A point for each value in a plot, under the name `name`.
pub(crate) fn point_style(name: &str, colour: Rgb, marker: MarkerShape, size: f32) -> SeriesPoints {
    SeriesPoints::new().with_names([name]).with_colors([colour]).with_markers([marker]).with_marker_sizes([size])
}

/// Text in the scene, below points that are not seen themselves.
pub(crate) fn text_style(colour: Rgb) -> Points3D {
    Points3D::update_fields().with_show_labels(true).with_radii([Radius::new_ui_points(0.1)]).with_colors([colour])
}

/// Text in a 2D view, each below its point.
pub(crate) fn writing(texts: impl IntoIterator<Item = ([f32; 2], String)>) -> Points2D {
    let (points, texts): (Vec<_>, Vec<_>) = texts.into_iter().unzip();
    Points2D::new(points)
        .with_labels(texts)
        .with_show_labels(true)
        .with_radii([Radius::new_ui_points(0.1)])
        .with_colors([colour::WRITING])
}
