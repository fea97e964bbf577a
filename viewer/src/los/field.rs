//! Line of sight around the UAV: a horizontal slice of its probability at its altitude, or of what is seen from there
//! where it stays for the mission, and above each served sensor
//! node the funnel in which the probability is high.
//!
//! All funnels have the same shape, so that a slot only logs its position: 12 bytes instead of a thousand voxels.

use nalgebra::{Point3, Vector2};
use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{GridMap, VoxelGridMap};
use re_sdk_types::components::{Colormap, ImageFormat};
use re_sdk_types::datatypes::{ChannelDatatype, ColorModel};
use skysink_common::channel::{LineOfSight, Uplink};
use skysink_common::geometry::{Position, above};

use crate::canvas::Canvas;
use crate::files::Part;
use crate::shapes::drawn;
use crate::sizes::Sizes;

/// The slice: mean over the served sensor nodes of the probability, or of what is seen.
pub const SLICE: &str = "los/slice";
/// Root of the funnels: one per served link, numbered in the order of the report.
pub const FUNNELS: &str = "los/funnels";

/// Half the extent of the slice, in communication radii.
const SLICE_RADII: f32 = 1.25;
/// Cells of the slice, in x and in y.
const SLICE_CELLS: u16 = 32;
/// Voxels of a funnel, in x and in y; odd, so that the sensor node is below the centre of one.
const FUNNEL_CELLS: u16 = 15;
/// Voxels of a funnel, in z, up to the highest altitude.
const FUNNEL_LAYERS: u16 = 15;
/// Minimum probability in a funnel, as a fraction of that directly below the UAV.
const FUNNEL_FRACTION: f64 = 0.8;

/// Minimum probability of line of sight in a funnel.
pub(crate) fn funnel_probability(link: &LineOfSight) -> f64 {
    FUNNEL_FRACTION * link.los_probability(&Uplink::at(1.0, 0.0, 1.0))
}

/// Slice and funnels of the scene.
pub(crate) struct Surroundings {
    slice_half_m: f32,
    shape: Funnel,
    most_funnels: usize,
    /// Number of funnels that this file has drawn last.
    funnels: usize,
    /// Number of funnels that may be visible, including those of an earlier file.
    visible: usize,
}

impl Surroundings {
    pub(crate) fn open(
        canvas: &Canvas,
        link: &LineOfSight,
        most_funnels: usize,
        sizes: &Sizes,
        part: Part,
    ) -> RecordingStreamResult<Self> {
        let slice_half_m = SLICE_RADII * sizes.radius_m;
        let cells = u32::from(SLICE_CELLS);
        let slice = GridMap::update_fields()
            .with_format(ImageFormat::from_color_model([cells; 2], ColorModel::L, ChannelDatatype::U8))
            .with_cell_size(2.0 * slice_half_m / f32::from(SLICE_CELLS))
            .with_colormap(Colormap::Grayscale)
            .with_opacity(0.3);
        canvas.log_static(SLICE, &slice)?;
        let shape = Funnel::of(link, sizes.radius_m, sizes.highest_m);
        for place in 0..most_funnels {
            let style = VoxelGridMap::update_fields()
                .with_voxel_size(shape.voxel_m)
                .with_value_range([0.0, 1.0])
                .with_colormap(Colormap::Grayscale)
                .with_opacity(0.13);
            canvas.log_static(format!("{FUNNELS}/{place}"), &style)?;
        }
        let visible = if part == Part::Later { most_funnels } else { 0 };
        Ok(Self { slice_half_m, shape, most_funnels, funnels: 0, visible })
    }

    /// Shows the slice of `visible`, over the positions of both ends, around the UAV, and a funnel above each served
    /// sensor node; at least one.
    pub(crate) fn log(
        &mut self,
        canvas: &Canvas,
        visible: &dyn Fn(&Position, &Point3<f64>) -> f64,
        uav: Point3<f64>,
        served: &[Position],
    ) -> RecordingStreamResult<()> {
        let [x_m, y_m, z_m] = drawn(uav);
        let slice = GridMap::update_fields()
            .with_data(slice(visible, uav, f64::from(self.slice_half_m), served))
            .with_translation([x_m - self.slice_half_m, y_m - self.slice_half_m, z_m]);
        canvas.show(SLICE, &slice)?;
        self.log_funnels(canvas, served)
    }

    /// Clears the slice and the funnels.
    pub(crate) fn clear(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        canvas.clear(SLICE)?;
        self.log_funnels(canvas, &[])
    }

    fn log_funnels(&mut self, canvas: &Canvas, served: &[Position]) -> RecordingStreamResult<()> {
        let served = &served[..served.len().min(self.most_funnels)];
        for (place, sensor) in served.iter().enumerate() {
            let corner_m = [sensor.x as f32 - self.shape.radius_m, sensor.y as f32 - self.shape.radius_m, 0.0];
            let mut funnel = VoxelGridMap::update_fields().with_translation(corner_m);
            if place >= self.funnels {
                funnel = funnel
                    .with_voxel_indices(self.shape.voxels.iter().copied())
                    .with_values(self.shape.probabilities.iter().copied());
            }
            canvas.show(format!("{FUNNELS}/{place}"), &funnel)?;
        }
        for place in served.len()..self.visible {
            canvas.clear(format!("{FUNNELS}/{place}"))?;
        }
        self.funnels = served.len();
        self.visible = self.funnels;
        Ok(())
    }
}

/// Mean of `visible` in the cells around the UAV, in 255 steps, row by row from north to south.
fn slice(
    visible: &dyn Fn(&Position, &Point3<f64>) -> f64,
    uav: Point3<f64>,
    half_m: f64,
    served: &[Position],
) -> Vec<u8> {
    let offset_m = |cell: u16| half_m * (2.0 * (f64::from(cell) + 0.5) / f64::from(SLICE_CELLS) - 1.0);
    let mean = |at: Position| {
        let at = above(&at, uav.z);
        served.iter().map(|sensor| visible(sensor, &at)).sum::<f64>() / served.len() as f64
    };
    let row = |row: u16| (0..SLICE_CELLS).map(move |column| uav.xy() + Vector2::new(offset_m(column), -offset_m(row)));
    (0..SLICE_CELLS).flat_map(row).map(|at| (255.0 * mean(at)).round() as u8).collect()
}

/// The voxels at the surface of the region above a sensor node in which the probability is high. A solid funnel would
/// hide the UAV.
struct Funnel {
    voxel_m: [f32; 3],
    /// Offset of the grid from the sensor node, in x and in y [m].
    radius_m: f32,
    voxels: Vec<[i32; 3]>,
    probabilities: Vec<f32>,
}

impl Funnel {
    fn of(link: &LineOfSight, radius_m: f32, top_m: f32) -> Self {
        let side_m = 2.0 * radius_m / f32::from(FUNNEL_CELLS);
        let height_m = top_m / f32::from(FUNNEL_LAYERS);
        let least = funnel_probability(link);
        let middle = |cell: i32, cells: u16| f64::from(side_m) * (f64::from(cell) + 0.5 - 0.5 * f64::from(cells));
        let cell_middle_m = |[x, y, z]: [i32; 3]| {
            [middle(x, FUNNEL_CELLS), middle(y, FUNNEL_CELLS), f64::from(height_m) * (f64::from(z) + 0.5)]
        };
        let probability = |voxel: [i32; 3]| {
            let [x_m, y_m, z_m] = cell_middle_m(voxel);
            if z_m > 0.0 { link.los_probability(&Uplink::at(1.0, x_m * x_m + y_m * y_m, z_m)) } else { 0.0 }
        };
        let grid = (0..FUNNEL_LAYERS)
            .flat_map(|z| (0..FUNNEL_CELLS).flat_map(move |y| (0..FUNNEL_CELLS).map(move |x| [x, y, z])));
        let (voxels, probabilities) = grid
            .map(|voxel| voxel.map(i32::from))
            .filter(|&voxel| {
                let [x_m, y_m, _] = cell_middle_m(voxel);
                x_m.hypot(y_m) <= f64::from(radius_m) && probability(voxel) >= least
            })
            .filter(|&[x, y, z]| {
                let beside = [[x - 1, y, z], [x + 1, y, z], [x, y - 1, z], [x, y + 1, z], [x, y, z - 1]];
                beside.into_iter().any(|voxel| probability(voxel) < least)
            })
            .map(|voxel| (voxel, probability(voxel) as f32))
            .unzip();
        Self { voxel_m: [side_m, side_m, height_m], radius_m, voxels, probabilities }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::channel::{LosCurve, Sight};

    /// Dense urban surroundings.
    fn link() -> LineOfSight {
        LineOfSight {
            bandwidth_hz: 1e6,
            comm_s: 0.1,
            sight: Sight::Curve(LosCurve::Sigmoid { a: 12.08, b: 0.11 }),
            los_snr: 1e5,
            nlos_snr: 1e3,
            los_exponent: 2.5,
            nlos_exponent: 3.5,
            correlation_m: None,
            fading: None,
            shadowing: None,
        }
    }

    #[test]
    fn the_slice_contains_the_mean_probability_from_north_west_to_south_east() {
        // 32 cells of 2 m around (100, 200): the first one's middle is (69, 231), the last one's (131, 169).
        let served = [Position::new(69.0, 231.0), Position::new(80.0, 200.0)];
        let probability = |sensor: &Position, at: &Point3<f64>| link().los_probability(&Uplink::new(1.0, sensor, at));
        let found = slice(&probability, Point3::new(100.0, 200.0, 40.0), 32.0, &served);
        let mean = |d2_m2: [f64; 2]| {
            d2_m2.map(|d2_m2| link().los_probability(&Uplink::at(1.0, d2_m2, 40.0))).iter().sum::<f64>() / 2.0
        };
        let bytes = |probability: f64| (255.0 * probability).round() as u8;
        assert_eq!(found.len(), 32 * 32);
        assert_eq!(found[0], bytes(mean([0.0, 11.0 * 11.0 + 31.0 * 31.0])));
        assert_eq!(found[31], bytes(mean([62.0 * 62.0, 51.0 * 51.0 + 31.0 * 31.0])));
        assert_eq!(found[32 * 32 - 1], bytes(mean([2.0 * 62.0 * 62.0, 51.0 * 51.0 + 31.0 * 31.0])));
    }

    #[test]
    fn a_funnel_widens_upward_and_contains_only_high_probabilities() {
        let funnel = Funnel::of(&link(), 60.0, 120.0);
        let widest = |layer: i32| {
            let layer = funnel.voxels.iter().filter(|voxel| voxel[2] == layer);
            layer.map(|voxel| (voxel[0] - i32::from(FUNNEL_CELLS) / 2).abs()).max().unwrap()
        };
        assert!(widest(1) < widest(3) && widest(3) < widest(6), "{} {} {}", widest(1), widest(3), widest(6));
        let least = funnel_probability(&link()) as f32;
        assert!(funnel.probabilities.iter().all(|&probability| probability >= least));
        assert!(funnel.voxels.len() < 1_000, "{} voxels", funnel.voxels.len());
    }
}
