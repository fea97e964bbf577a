//! Paths as the viewer gets them.

use skysink_common::message::{PathPoint, is_possible_path};

use super::world::WORLDS;
use crate::cursor::Cursor;

/// A path of any numbers is refused, or all of it can be drawn: few points, each of them over the area.
///
/// # Panics
/// If not.
pub fn path_message(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    let area = WORLDS[usize::from(input.u8()) % WORLDS.len()].scenario.area;
    while !input.is_empty() {
        let count = input.u8() % 80;
        let path: Vec<_> =
            (0..count).map(|_| PathPoint { x_m: input.f64(), y_m: input.f64(), z_m: input.f64() }).collect();
        if is_possible_path(&path, &area) {
            assert!((1..=64).contains(&path.len()), "{path:?}");
            for point in &path {
                let [x_m, y_m, z_m] = [point.x_m, point.y_m, point.z_m].map(|coordinate_m| coordinate_m as f32);
                assert!((-1e-3..=1.001 * area.width_m() as f32).contains(&x_m), "{point:?}");
                assert!((-1e-3..=1.001 * area.height_m() as f32).contains(&y_m) && z_m.is_finite(), "{point:?}");
            }
        }
    }
}
