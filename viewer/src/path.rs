//! The planned paths: from the planned waypoint to the following ones, for planners with a path. That of the first UAV
//! fades with distance; those of the others have the colours of their UAVs.
//!
//! A recording of a planner without a path contains none of these entities. From the first path on, every slot logs a
//! path, which may be empty, so that no earlier path stays visible.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{LineStrips3D, Points3D};
use re_sdk_types::components::Radius;
use skysink_common::message::{MAX_PATH_POINTS, PathPoint};

use crate::canvas::Canvas;
use crate::colour;
use crate::files::Part;
use crate::shapes::Point;
use crate::sizes::Sizes;

/// The planned path.
pub const PATH: &str = "world/path";
/// The waypoints of the planned path, without the slot's own.
pub const STOPS: &str = "world/path/stops";
/// The path on the ground, for the view from above.
pub const TRACK: &str = "world/path_track";
/// The waypoints of the path on the ground.
pub const TRACK_STOPS: &str = "world/path_track/stops";

/// The paths of the other UAVs, and on the ground.
pub const OTHERS: [&str; 2] = ["world/path/others", "world/path_track/others"];

/// Number of legs of each band of the path. Later bands are fainter, because later legs are more likely to change.
const BANDS: [usize; 4] = [4, 8, 16, MAX_PATH_POINTS];

/// The path of the scene.
pub(crate) struct Path {
    /// Whether an earlier slot, possibly in an earlier file, had a path.
    begun: bool,
    /// Whether an earlier slot had one of another UAV.
    others_begun: bool,
    /// Height of a band above the next one [m], so that earlier legs are visible where a path crosses itself.
    step_m: f32,
}

impl Path {
    /// Styles the path.
    pub(crate) fn open(canvas: &Canvas, sizes: &Sizes, uavs: usize, part: Part) -> RecordingStreamResult<Self> {
        let colours = |[near, far]: [colour::Rgb; 2]| {
            (0..BANDS.len()).map(move |band| colour::between(near, far, band as f64 / (BANDS.len() - 1) as f64))
        };
        let line =
            LineStrips3D::update_fields().with_colors(colours(colour::PATH)).with_radii([Radius::new_ui_points(0.7)]);
        let each = BANDS.into_iter().zip(colours(colour::STOP)).flat_map(|(legs, colour)| vec![colour; legs]);
        let stops = Points3D::update_fields().with_colors(each).with_radii([Radius::new_ui_points(1.8)]);
        for (path, at) in [(PATH, STOPS), (TRACK, TRACK_STOPS)] {
            canvas.log_static(path, &line)?;
            canvas.log_static(at, &stops)?;
        }
        let thin = LineStrips3D::update_fields().with_radii([Radius::new_ui_points(0.7)]);
        OTHERS
            .into_iter()
            .take(if uavs > 1 { 2 } else { 0 })
            .try_for_each(|entity| canvas.log_static(entity, &thin))?;
        let begun = part == Part::Later;
        Ok(Self { begun, others_begun: begun && uavs > 1, step_m: 0.2 * sizes.layer_m })
    }

    /// Shows the paths of a slot, UAV by UAV. A single point is only the waypoint of the slot, and not shown.
    pub(crate) fn log<'a>(
        &mut self,
        canvas: &Canvas,
        mut paths: impl Iterator<Item = &'a [PathPoint]>,
    ) -> RecordingStreamResult<()> {
        let path = paths.next().unwrap_or_default();
        self.log_others(canvas, paths)?;
        self.begun |= path.len() > 1;
        if !self.begun {
            return Ok(());
        }
        let below_trail_m = (BANDS.len() + 1) as f32 * self.step_m;
        let above = self.strips(path.iter().map(|at| [at.x_m as f32, at.y_m as f32, at.z_m as f32 - below_trail_m]));
        let below = self.strips(path.iter().map(|at| [at.x_m as f32, at.y_m as f32, 0.0]));
        for (entity, at, strips) in [(PATH, STOPS, above), (TRACK, TRACK_STOPS, below)] {
            let stops: Vec<_> = strips.iter().flat_map(|strip| &strip[1..]).copied().collect();
            canvas.show(entity, &LineStrips3D::update_fields().with_strips(strips))?;
            canvas.show(at, &Points3D::update_fields().with_positions(stops))?;
        }
        Ok(())
    }

    /// Shows the paths of the other UAVs.
    fn log_others<'a>(
        &mut self,
        canvas: &Canvas,
        paths: impl Iterator<Item = &'a [PathPoint]>,
    ) -> RecordingStreamResult<()> {
        let paths: Vec<_> = paths.filter(|path| path.len() > 1).collect();
        self.others_begun |= !paths.is_empty();
        if !self.others_begun {
            return Ok(());
        }
        for (entity, is_on_ground) in OTHERS.into_iter().zip([false, true]) {
            let place = |at: &PathPoint| [at.x_m as f32, at.y_m as f32, if is_on_ground { 0.0 } else { at.z_m as f32 }];
            let strips = paths.iter().map(|path| path.iter().map(place).collect::<Vec<Point>>());
            let lines = LineStrips3D::update_fields()
                .with_strips(strips)
                .with_colors(paths.iter().map(|path| colour::of_uav(path[0].uav as usize)));
            canvas.show(entity, &lines)?;
        }
        Ok(())
    }

    /// The bands of the path, each slightly higher than the next.
    fn strips(&self, path: impl Iterator<Item = Point>) -> Vec<Vec<Point>> {
        let path: Vec<_> = path.collect();
        let rises_m = (1..=BANDS.len()).rev().map(|steps| steps as f32 * self.step_m);
        let raise =
            |(strip, rise_m): (&[Point], f32)| strip.iter().map(|&[x_m, y_m, z_m]| [x_m, y_m, z_m + rise_m]).collect();
        bands(&path).zip(rises_m).map(raise).collect()
    }
}

/// Splits a path into bands. Each starts where the previous one ends.
fn bands(path: &[Point]) -> impl Iterator<Item = &[Point]> {
    let mut begin = 0;
    BANDS.into_iter().map_while(move |legs| {
        let end = (begin + legs + 1).min(path.len());
        let band = path.get(begin..end).filter(|band| band.len() > 1)?;
        begin += legs;
        Some(band)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_every_leg_once() {
        for points in 0..=MAX_PATH_POINTS {
            let path: Vec<Point> = (0..points).map(|i| [i as f32, 0.0, 0.0]).collect();
            let legs: Vec<_> = bands(&path).flat_map(|band| band.windows(2)).map(|leg| (leg[0], leg[1])).collect();
            let expected: Vec<_> = path.windows(2).map(|leg| (leg[0], leg[1])).collect();
            assert_eq!(legs, expected, "{points} points");
            assert!(bands(&path).count() <= BANDS.len());
        }
    }
}
