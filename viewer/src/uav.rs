//! The UAV: body and heading, flown path, planned waypoint, and coverage circle on the ground.

use std::f32::consts::FRAC_1_SQRT_2;

use nalgebra::Vector3;
use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{Arrows3D, Boxes3D, Ellipsoids3D, LineStrips3D, Points2D, Points3D, Transform3D};
use re_sdk_types::components::{FillMode, Radius};
use re_sdk_types::datatypes::{Angle, RotationAxisAngle};
use skysink_common::message::{FlightReport, Plan};

use crate::canvas::Canvas;
use crate::colour;
use crate::shapes::{Point, circle, drawn, line_style, show_circle, text_style};
use crate::sizes::Sizes;

/// The UAVs after the first, by number.
pub const FLEET: &str = "world/uavs";
/// Frame of the UAV. It follows the position but not the heading, for cameras.
pub const UAV: &str = "world/uav";
/// Frame that follows the heading.
pub const BODY: &str = "world/uav/body";
/// A dot at the UAV's position, with the same size on the screen at every distance.
pub const DOT: &str = "world/uav/dot";
/// What is written at the UAV: altitude, speed, battery.
pub const LABEL: &str = "world/uav/label";
/// What is written at all UAVs, for the views from above, in which rerun draws no text of the scene.
pub const LABELS_ABOVE: &str = "cameras/top/uavs";
/// The path flown since the last drawn slot. Views select how many slots are visible.
pub const TRAIL: &str = "world/uav_trail";
/// The flown path on the ground, for the top view.
pub const TRACK: &str = "world/uav_track";
/// The planned waypoints of the UAVs after the first, by number.
pub const WAYPOINTS: &str = "world/waypoints";
/// The planned waypoint.
pub const WAYPOINT: &str = "world/waypoint";
/// The path to the planned waypoint.
pub const PLAN: &str = "world/plan";
/// The circle within communication radius, on the ground below the UAV.
pub const COVERAGE: &str = "world/uav/coverage";
/// The plumb line from the UAV to the ground.
pub const PLUMB: &str = "world/uav/plumb";

/// The entity of the UAV number `uav` instead of `first`, that of the first UAV, so that views and tests find those.
pub(crate) fn name_of(first: &str, uav: usize) -> String {
    let inside = first.strip_prefix(UAV).filter(|rest| rest.is_empty() || rest.starts_with('/'));
    match (uav, inside) {
        (0, _) => first.to_owned(),
        (_, Some(rest)) => format!("{FLEET}/{uav}{rest}"), // below the frame, with which it moves
        // Not below that of the first, whose frame is where it is.
        _ if first == WAYPOINT => format!("{WAYPOINTS}/{uav}"),
        _ => format!("{first}/{uav}"),
    }
}

/// A UAV of the scene.
pub(crate) struct UavShape {
    /// Its number.
    uav: usize,
    ring_m: f32,
    track_z_m: f32,
    /// Positions since the last drawn slot, that slot first.
    flown: Vec<Point>,
}

impl UavShape {
    /// Builds the UAV number `uav` and styles what moves with it.
    pub(crate) fn open(canvas: &Canvas, sizes: &Sizes, uav: usize) -> RecordingStreamResult<Self> {
        let paint = colour::of_uav(uav);
        log_body(canvas, uav, sizes.arm_m, paint)?;
        log_coverage(canvas, uav, sizes)?;
        canvas.log_static(name_of(TRAIL, uav), &line_style(if uav == 0 { colour::TRAIL } else { paint }, 1.2))?;
        canvas.log_static(name_of(TRACK, uav), &line_style(if uav == 0 { colour::TRACK } else { paint }, 0.7))?;
        for entity in [WAYPOINT, PLAN] {
            canvas.log_static(name_of(entity, uav), &line_style(colour::PLAN, 1.5))?;
        }
        canvas.log_static(name_of(LABEL, uav), &text_style(paint).with_positions([[0.0; 3]]))?;
        canvas.log_static(name_of(PLUMB, uav), &line_style(colour::COVERAGE, 0.7))?;
        Ok(Self { uav, ring_m: 1.8 * sizes.arm_m, track_z_m: -0.6 * sizes.layer_m, flown: Vec::new() })
    }

    /// Adds the position after a slot.
    pub(crate) fn observe(&mut self, flight: &FlightReport) {
        self.flown.push(drawn(flight.position()));
    }

    /// Length of the path in the last observed slot [m]; `None` if the position before it is unknown.
    pub(crate) fn flown_m(&self) -> Option<f64> {
        let [.., before, here] = self.flown[..] else { return None };
        Some(f64::from(Vector3::from(here).metric_distance(&Vector3::from(before))))
    }

    /// Draws the UAV at its position after the last observed slot, and writes `label` at it.
    pub(crate) fn draw(
        &mut self,
        canvas: &Canvas,
        flight: &FlightReport,
        plan: Option<&Plan>,
        label: &str,
    ) -> RecordingStreamResult<()> {
        let here = drawn(flight.position());
        let before = self.flown.iter().rev().nth(1).copied();
        canvas.show(name_of(UAV, self.uav), &Transform3D::update_fields().with_translation(here))?;
        canvas.show(name_of(LABEL, self.uav), &Points3D::update_fields().with_labels([label]))?;
        let foot = [0.0, 0.0, -here[2]];
        canvas.show(name_of(COVERAGE, self.uav), &Transform3D::update_fields().with_translation(foot))?;
        canvas.show(name_of(PLUMB, self.uav), &LineStrips3D::update_fields().with_strips([[[0.0; 3], foot]]))?;
        if let Some(before) = before.filter(|before| before[..2] != here[..2]) {
            let heading = Angle::from_radians((here[1] - before[1]).atan2(here[0] - before[0]));
            let turn = RotationAxisAngle::new([0.0, 0.0, 1.0], heading);
            canvas.show(name_of(BODY, self.uav), &Transform3D::update_fields().with_rotation_axis_angle(turn))?;
        }
        self.log_flown(canvas)?;
        self.flown.push(here);
        self.log_plan(canvas, plan, before.unwrap_or(here))
    }

    /// Clears what is outdated in a missed slot, and interrupts the path.
    pub(crate) fn log_missed(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        self.log_flown(canvas)?;
        self.log_plan(canvas, None, [0.0; 3])
    }

    /// Logs the path since the last drawn slot, and starts the next one.
    fn log_flown(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        let flown = std::mem::take(&mut self.flown);
        let trail = (flown.len() > 1).then_some(flown);
        let track = trail.iter().map(|flown| flown.iter().map(|&[x_m, y_m, _]| [x_m, y_m, self.track_z_m]));
        let track: Vec<Vec<_>> = track.map(Iterator::collect).collect();
        canvas.append(name_of(TRAIL, self.uav), &LineStrips3D::update_fields().with_strips(trail))?;
        canvas.append(name_of(TRACK, self.uav), &LineStrips3D::update_fields().with_strips(track))
    }

    fn log_plan(&self, canvas: &Canvas, plan: Option<&Plan>, from: Point) -> RecordingStreamResult<()> {
        let waypoint = plan.map(|plan| drawn(plan.waypoint()));
        let waypoint = waypoint.filter(|waypoint| waypoint.iter().all(|coordinate| coordinate.is_finite()));
        show_circle(canvas, &name_of(WAYPOINT, self.uav), waypoint, self.ring_m)?;
        let path = waypoint.map(|waypoint| [from, waypoint]);
        canvas.show(name_of(PLAN, self.uav), &LineStrips3D::update_fields().with_strips(path))
    }
}

/// Styles the labels of `uavs` UAVs for the views from above.
pub(crate) fn log_labels_above(canvas: &Canvas, uavs: usize) -> RecordingStreamResult<()> {
    let style = Points2D::update_fields()
        .with_show_labels(true)
        .with_radii([Radius::new_ui_points(0.1)])
        .with_colors((0..uavs).map(colour::of_uav));
    canvas.log_static(LABELS_ABOVE, &style)
}

/// Writes the labels for the views from above, at positions in the pixels of [`crate::cameras::TOP`].
pub(crate) fn show_labels_above(
    canvas: &Canvas,
    places: impl IntoIterator<Item = [f32; 2]>,
    labels: &[String],
) -> RecordingStreamResult<()> {
    let labels = labels.iter().map(String::as_str);
    canvas.show(LABELS_ABOVE, &Points2D::update_fields().with_positions(places).with_labels(labels))
}

/// A quadrotor with arms of length `arm_m` [m] and heading along x, and its dot.
fn log_body(canvas: &Canvas, uav: usize, arm_m: f32, paint: colour::Rgb) -> RecordingStreamResult<()> {
    let hub = [0.38 * arm_m, 0.3 * arm_m, 0.13 * arm_m];
    let arm = [arm_m, 0.07 * arm_m, 0.05 * arm_m];
    let turns_deg = [0.0, 45.0, -45.0].map(|deg| RotationAxisAngle::new([0.0, 0.0, 1.0], Angle::from_degrees(deg)));
    let body = Boxes3D::from_half_sizes([hub, arm, arm])
        .with_rotation_axis_angles(turns_deg)
        .with_colors([paint])
        .with_fill_mode(FillMode::Solid);
    let frame = name_of(BODY, uav);
    canvas.log_static(&frame, &body)?;
    let reach_m = arm_m * FRAC_1_SQRT_2;
    let rotors = [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]];
    let centres = rotors.map(|[x, y]| [x * reach_m, y * reach_m, 0.12 * arm_m]);
    let rotors = Ellipsoids3D::from_centers_and_half_sizes(centres, [[0.45 * arm_m, 0.45 * arm_m, 0.03 * arm_m]])
        .with_colors([colour::ROTOR])
        .with_fill_mode(FillMode::Solid);
    canvas.log_static(format!("{frame}/rotors"), &rotors)?;
    let heading = Arrows3D::from_vectors([[1.6 * arm_m, 0.0, 0.0]])
        .with_origins([[0.4 * arm_m, 0.0, 0.0]])
        .with_radii([0.1 * arm_m])
        .with_colors([paint]);
    canvas.log_static(format!("{frame}/heading"), &heading)?;
    let dot = Points3D::new([[0.0; 3]]).with_radii([Radius::new_ui_points(5.0)]).with_colors([paint]);
    canvas.log_static(name_of(DOT, uav), &dot)
}

/// A disc just below the sensor nodes, and its border.
fn log_coverage(canvas: &Canvas, uav: usize, sizes: &Sizes) -> RecordingStreamResult<()> {
    let Sizes { radius_m, layer_m, .. } = *sizes;
    let frame = name_of(COVERAGE, uav);
    let disc =
        Ellipsoids3D::from_centers_and_half_sizes([[0.0, 0.0, -0.4 * layer_m]], [[radius_m, radius_m, 0.1 * layer_m]])
            .with_colors([colour::COVERED])
            .with_fill_mode(FillMode::Solid);
    canvas.log_static(format!("{frame}/disc"), &disc)?;
    let rim = line_style(colour::COVERAGE, 1.2).with_strips([circle([0.0; 3], radius_m)]);
    canvas.log_static(format!("{frame}/rim"), &rim)
}
