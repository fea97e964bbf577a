//! The cameras of the views, and the frames in which they stand.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{Pinhole, Transform3D};
use re_sdk_types::blueprint::archetypes::EyeControls3D;
use re_sdk_types::blueprint::components::Eye3DKind;
use re_sdk_types::datatypes::{Angle, RotationAxisAngle};

use crate::canvas::Canvas;
use crate::queues;
use crate::sizes::Sizes;

/// Frame of the 3D view of a whole area with a side longer than 100 m, in units of 10 m, 100 m and so on.
pub const REDUCED: &str = "cameras/field";
/// The camera of the views from above.
pub const TOP: &str = "cameras/top";

/// Height of the camera of the views from above, in longer sides of the area, or in heights that it has to show. From
/// so far away the perspective moves a UAV at an altitude of a tenth of the longer side by less than 1 % of its
/// distance from the middle.
const TOP_SIDES: f32 = 20.0;

/// Near clip plane of the views from above: 0.8 of the way down to the ground, so that depths are fine enough for the
/// layers on it. rerun counts in 1/500 of the focal length, which is the height of the camera.
pub(crate) const TOP_NEAR: f32 = 0.8 * 500.0;

/// The frame of the views of the whole area.
pub(crate) fn field_frame(sizes: &Sizes) -> &'static str {
    if sizes.unit_m > 1.0 { REDUCED } else { queues::WORLD }
}

/// Logs the frames.
pub(crate) fn log(canvas: &Canvas, sizes: &Sizes) -> RecordingStreamResult<()> {
    if sizes.unit_m > 1.0 {
        canvas.log_static(REDUCED, &Transform3D::from_scale([sizes.unit_m; 3]))?;
    }
    let [x_m, y_m] = middle_m(sizes);
    let z_m = TOP_SIDES * seen_m(sizes);
    // It looks down; a pixel is a metre of the ground, counted from the north-west corner.
    let down = RotationAxisAngle::new([1.0, 0.0, 0.0], Angle::from_degrees(180.0));
    canvas.log_static(TOP, &Transform3D::from_translation_rotation([x_m, y_m, z_m], down))?;
    let pinhole = Pinhole::from_focal_length_and_resolution([z_m; 2], [sizes.width_m, sizes.depth_m]);
    canvas.log_static(TOP, &pinhole)
}

/// The bounds of a view from above in x and y (down) [m]: the area, and the numbers at its axes.
pub(crate) fn top_bounds(sizes: &Sizes) -> [[f64; 2]; 2] {
    let [width_m, depth_m, longer_m] = [sizes.width_m, sizes.depth_m, sizes.longer_m()].map(f64::from);
    [[-0.12 * longer_m, width_m + 0.12 * longer_m], [-0.04 * longer_m, depth_m + 0.1 * longer_m]]
}

/// Extent of what a camera has to show [m]: the area and the flown altitudes.
fn seen_m(sizes: &Sizes) -> f32 {
    sizes.longer_m().max(1.8 * sizes.highest_m)
}

/// The middle of the area: x, y [m].
fn middle_m(sizes: &Sizes) -> [f32; 2] {
    [sizes.width_m / 2.0, sizes.depth_m / 2.0]
}

fn camera(eye: [f32; 3], target: [f32; 3], up: [f32; 3]) -> EyeControls3D {
    EyeControls3D::new().with_kind(Eye3DKind::Orbital).with_position(eye).with_look_target(target).with_eye_up(up)
}

/// The whole area from the south, at about 45 degrees, in the frame of [`field_frame`].
pub(crate) fn overview(sizes: &Sizes) -> EyeControls3D {
    let [x_m, y_m] = middle_m(sizes);
    let seen_m = seen_m(sizes);
    let eye_m = [x_m, y_m - 0.5 * sizes.depth_m - 0.42 * seen_m, 0.68 * seen_m];
    let target_m = [x_m, y_m - 0.08 * seen_m, 0.0];
    let in_frame = |at_m: [f32; 3]| at_m.map(|coordinate_m| coordinate_m / sizes.unit_m);
    camera(in_frame(eye_m), in_frame(target_m), [0.0, 0.0, 1.0])
}

/// In the UAV's frame, so that the camera follows.
pub(crate) fn beside_uav(sizes: &Sizes) -> EyeControls3D {
    let near_m = sizes.radius_m + 0.5 * sizes.highest_m;
    let eye = [-1.2 * near_m, -1.9 * near_m, 0.9 * near_m];
    camera(eye, [0.0, 0.0, -0.55 * sizes.altitude_m], [0.0, 0.0, 1.0])
}

/// In a frame that follows the UAV horizontally only, so that its altitude is visible.
pub(crate) fn around_uav(sizes: &Sizes) -> EyeControls3D {
    let far_m = (1.5 * sizes.radius_m).max(0.75 * sizes.highest_m);
    camera([-0.9 * far_m, -2.1 * far_m, 1.35 * far_m], [0.0, 0.0, 0.3 * sizes.highest_m], [0.0, 0.0, 1.0])
}
