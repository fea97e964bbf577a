//! The sensor nodes, coloured by how full their queues are: a point each, and a bar each where they are few enough.

use rerun::components::ClassId;
use rerun::{
    AnnotationContext, AnnotationInfo, Boxes3D, FillMode, Points3D, Radius, RecordingStream, RecordingStreamResult,
    Rgba32,
};
use skysink_common::message::SensorNode;

use crate::colour::{self, FULL_LEVEL};
use crate::sizes::{MAX_BARS, Sizes};

/// Root of the 3D scene; it holds the queue scale.
pub const WORLD: &str = "world";
/// The points.
pub const POINTS: &str = "world/sensors";
/// The bars.
pub const BARS: &str = "world/queues";

/// Fraction of the buffers in use, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fill {
    /// Mean over the sensor nodes.
    pub mean: f64,
    /// Of the fullest.
    pub max: f64,
}

/// The sensor nodes of the scene.
pub struct Queues {
    capacities_bits: Vec<u32>,
    bars: Option<Bars>,
}

/// Where the bars stand and how large they are.
struct Bars {
    feet_m: Vec<[f32; 2]>,
    half_side_m: f32,
    full_m: f32,
}

impl Queues {
    /// Places the sensor nodes and names the levels of the queue scale.
    pub(crate) fn open(stream: &RecordingStream, sensors: &[SensorNode], sizes: &Sizes) -> RecordingStreamResult<Self> {
        stream.log_static(WORLD, &AnnotationContext::new((0..=FULL_LEVEL).map(describe)))?;
        let feet_m: Vec<_> = sensors.iter().map(|sensor| [sensor.x_m as f32, sensor.y_m as f32]).collect();
        let points = Points3D::new(feet_m.iter().map(|&[x_m, y_m]| [x_m, y_m, 0.0]))
            .with_radii([Radius::new_ui_points(sizes.point_ui)])
            .with_show_labels(false);
        stream.log_static(POINTS, &points)?;
        let bars =
            (sensors.len() <= MAX_BARS).then_some(Bars { feet_m, half_side_m: sizes.bar_half_m, full_m: sizes.bar_m });
        if bars.is_some() {
            let style = Boxes3D::update_fields().with_fill_mode(FillMode::Solid).with_show_labels(false);
            stream.log_static(BARS, &style)?;
        }
        Ok(Self { capacities_bits: sensors.iter().map(|sensor| sensor.capacity_bits).collect(), bars })
    }

    /// How many sensor nodes there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.capacities_bits.len()
    }

    /// Colours the sensor nodes of one slot; one queue [bit] per sensor node.
    pub(crate) fn log_slot(&self, stream: &RecordingStream, queues_bits: &[u32]) -> RecordingStreamResult<Fill> {
        let pairs = || queues_bits.iter().copied().zip(self.capacities_bits.iter().copied());
        let levels: Vec<_> = pairs().map(|(queue, capacity)| ClassId::from(colour::level(queue, capacity))).collect();
        let fills = || pairs().map(|(queue, capacity)| fill(queue, capacity));
        if let Some(bars) = &self.bars {
            stream.log(BARS, &bars.at(fills()).with_class_ids(levels.iter().copied()))?;
        }
        stream.log(POINTS, &Points3D::update_fields().with_class_ids(levels))?;
        Ok(Fill { mean: fills().sum::<f64>() / self.count().max(1) as f64, max: fills().fold(0.0, f64::max) })
    }
}

impl Bars {
    /// Bars of the given fills, standing on the ground; an empty queue keeps a thin tile.
    fn at(&self, fills: impl Iterator<Item = f64>) -> Boxes3D {
        let halves_m = fills.map(|fill| 0.5 * self.full_m * (fill as f32).max(0.02));
        let (centres_m, sizes_m): (Vec<_>, Vec<_>) = std::iter::zip(&self.feet_m, halves_m)
            .map(|(&[x_m, y_m], half_m)| ([x_m, y_m, half_m], [self.half_side_m, self.half_side_m, half_m]))
            .unzip();
        Boxes3D::update_fields().with_centers(centres_m).with_half_sizes(sizes_m)
    }
}

/// Fraction of a buffer in use.
fn fill(queue_bits: u32, capacity_bits: u32) -> f64 {
    if queue_bits >= capacity_bits { 1.0 } else { f64::from(queue_bits) / f64::from(capacity_bits) }
}

/// Name and colour of a level, which the viewer shows on hovering.
fn describe(level: u16) -> AnnotationInfo {
    let fraction = f64::from(level) / f64::from(FULL_LEVEL);
    let [r, g, b] = colour::of_fill(fraction);
    AnnotationInfo {
        id: level,
        label: Some(format!("queue {:.0} % full", 100.0 * fraction).into()),
        color: Some(Rgba32::from_unmultiplied_rgba(r, g, b, 255)),
    }
}
