//! The sensor nodes, coloured by queue fill: a point each, and a bar each if they are few enough. A sensor node that
//! loses data in the slot has a separate colour; one that has lost data in the mission has a mark above it.

use std::sync::Arc;

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{AnnotationContext, Boxes3D, Points3D};
use re_sdk_types::components::ClassId;
use re_sdk_types::components::{FillMode, Radius};
use re_sdk_types::datatypes::AnnotationInfo;
use skysink_common::message::Totals;
use skysink_common::sensors::Sensors;

use crate::canvas::Canvas;
use crate::colour;
use crate::history::SensorHistory;
use crate::names::SensorNames;
use crate::sizes::{MAX_BARS, Sizes};

/// Root of the 3D scene, with the queue scale.
pub const WORLD: &str = "world";
/// Sensor nodes as points.
pub const POINTS: &str = "world/sensors";
/// Queues as bars.
pub const BARS: &str = "world/queues";
/// Marks above the sensor nodes that have lost data, where there are bars.
pub const LOST: &str = "world/lost";

/// Marks at the sensor nodes that have sampled much more than on average in the slot; only of arrivals at random.
pub const BURSTS: &str = "world/bursts";

/// Number of levels of the queue scale above empty, 5 % each. More levels look the same and compress worse.
const FULL_LEVEL: u16 = 20;
/// The level of a sensor node that has lost data in the slot.
const OVERFLOW_LEVEL: u16 = FULL_LEVEL + 1;

/// Fraction of the buffers in use, 0 to 1, and what was lost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fill {
    /// Mean over the sensor nodes.
    pub(crate) mean: f64,
    /// The maximum.
    pub(crate) max: f64,
    /// The loss rate so far, `η`.
    pub(crate) loss_rate: f64,
}

/// The sensor nodes of the scene.
pub(crate) struct QueueShapes {
    sensors: Arc<Sensors>,
    bars: Option<Bars>,
    /// Whether points are drawn: instead of bars, or for views without bars, because these are too tall.
    has_points: bool,
}

/// Positions and sizes of the bars.
struct Bars {
    feet_m: Vec<[f32; 2]>,
    /// Height of the bar of a full queue.
    full_m: f32,
}

impl QueueShapes {
    /// Places and labels the sensor nodes, and names the levels of the queue scale. Larger buffers are drawn wider.
    pub(crate) fn open(
        canvas: &Canvas,
        sensors: &Arc<Sensors>,
        sizes: &Sizes,
        names: &SensorNames,
    ) -> RecordingStreamResult<Self> {
        let labels = names.labels(sensors);
        let widths = widths(sensors);
        let shows_labels = names.are_always_shown(sensors);
        canvas.log_static(WORLD, &AnnotationContext::new((0..=OVERFLOW_LEVEL).map(describe)))?;
        if sensors.sampling.is_drawn() {
            let marks = Points3D::update_fields().with_colors([colour::BURST]).with_radii([Radius::new_ui_points(3.5)]);
            canvas.log_static(BURSTS, &marks)?;
        }
        let feet_m: Vec<_> = sensors.positions.iter().map(|foot| [foot.x as f32, foot.y as f32]).collect();
        let has_bars = sensors.count() <= MAX_BARS;
        let has_points = !has_bars || sizes.has_tall_bars;
        if has_points {
            let points = Points3D::new(feet_m.iter().map(|&[x_m, y_m]| [x_m, y_m, 0.0]))
                .with_radii(widths.iter().map(|width| Radius::new_ui_points(sizes.point_ui * width)))
                .with_show_labels(!has_bars && shows_labels);
            let points = match &labels {
                Some(labels) => points.with_labels(labels.iter().map(String::as_str)),
                None => points,
            };
            canvas.log_static(POINTS, &points)?;
        }
        if !has_bars {
            return Ok(Self { sensors: Arc::clone(sensors), bars: None, has_points });
        }
        // All bars are equally high; the part of the free buffer is below the ground. rerun shows the label of the bar
        // at the pointer only if at most three components differ from bar to bar: centre, level and label.
        let half = |width: &f32| [width * sizes.bar_half_m, width * sizes.bar_half_m, 0.5 * sizes.bar_m];
        let style = Boxes3D::update_fields()
            .with_half_sizes(widths.iter().map(half))
            .with_fill_mode(FillMode::Solid)
            .with_show_labels(shows_labels);
        let style = match &labels {
            Some(labels) => style.with_labels(labels.iter().map(String::as_str)),
            None => style,
        };
        canvas.log_static(BARS, &style)?;
        let marks = Points3D::update_fields().with_colors([colour::LOSS]).with_radii([Radius::new_ui_points(2.5)]);
        canvas.log_static(LOST, &marks)?;
        let bars = Bars { feet_m, full_m: sizes.bar_m };
        Ok(Self { sensors: Arc::clone(sensors), bars: Some(bars), has_points })
    }

    /// The number of sensor nodes.
    pub(crate) fn count(&self) -> usize {
        self.sensors.count()
    }

    /// Colours the sensor nodes of one slot, the last of `history`.
    pub(crate) fn log_slot(
        &self,
        canvas: &Canvas,
        history: &SensorHistory,
        totals: &Totals,
    ) -> RecordingStreamResult<Fill> {
        let sampling = &self.sensors.sampling;
        let pairs = history.sums.queues_bits.iter().enumerate();
        let fills = || pairs.clone().map(|(id, &queue_bits)| fill(queue_bits, sampling.of(id).capacity_bits));
        let levels: Vec<u16> = fills().map(level).collect();
        let colour = |(&level, overflows): (&u16, bool)| ClassId::from(if overflows { OVERFLOW_LEVEL } else { level });
        let colours: Vec<_> = levels.iter().zip(history.overflows()).map(colour).collect();
        if let Some(bars) = &self.bars {
            canvas.show(BARS, &bars.at(&levels).with_class_ids(colours.iter().copied()))?;
            canvas.show(LOST, &bars.marks(&history.sums.lost_bits))?;
        }
        if sampling.is_drawn() {
            let feet = history.bursts().map(|id| &self.sensors.positions[id]);
            let z_m = self.bars.as_ref().map_or(0.0, |bars| 1.15 * bars.full_m);
            let positions_m = feet.map(|foot| [foot.x as f32, foot.y as f32, z_m]);
            canvas.show(BURSTS, &Points3D::update_fields().with_positions(positions_m))?;
        }
        if self.has_points {
            canvas.show(POINTS, &Points3D::update_fields().with_class_ids(colours))?;
        }
        Ok(Fill {
            mean: fills().sum::<f64>() / self.count().max(1) as f64,
            max: fills().fold(0.0, f64::max),
            loss_rate: history.loss_rate(totals),
        })
    }
}

impl Bars {
    /// Bars that show the given levels above the ground; an empty queue keeps a thin tile.
    fn at(&self, levels: &[u16]) -> Boxes3D {
        let height_m = |level: u16| self.full_m * (f32::from(level) / f32::from(FULL_LEVEL)).max(0.02);
        let centre = |(&[x_m, y_m], &level): (&[f32; 2], &u16)| [x_m, y_m, height_m(level) - 0.5 * self.full_m];
        Boxes3D::update_fields().with_centers(self.feet_m.iter().zip(levels).map(centre))
    }

    /// Marks above the sensor nodes that have lost data.
    fn marks(&self, lost_bits: &[u64]) -> Points3D {
        let marked = self.feet_m.iter().zip(lost_bits).filter(|(_, lost_bits)| **lost_bits > 0);
        Points3D::update_fields().with_positions(marked.map(|(&[x_m, y_m], _)| [x_m, y_m, 1.3 * self.full_m]))
    }
}

/// Widths relative to that of the largest buffer: an area is proportional to the buffer. One for all if all are equal.
fn widths(sensors: &Sensors) -> Vec<f32> {
    let buffers_bits = || sensors.ids().map(|id| sensors.sampler(id).capacity_bits);
    let most_bits = buffers_bits().max().unwrap_or(0);
    if buffers_bits().all(|buffer_bits| buffer_bits == most_bits) {
        return vec![1.0];
    }
    buffers_bits().map(|buffer_bits| (f64::from(buffer_bits) / f64::from(most_bits)).sqrt() as f32).collect()
}

/// Fraction of a buffer in use; a buffer of 0 bits is full.
fn fill(queue_bits: u32, capacity_bits: u32) -> f64 {
    if queue_bits >= capacity_bits { 1.0 } else { f64::from(queue_bits) / f64::from(capacity_bits) }
}

/// Level of a fill on the queue scale, 0 to [`FULL_LEVEL`], rounded to the nearest.
fn level(fill: f64) -> u16 {
    (f64::from(FULL_LEVEL) * fill).round() as u16
}

/// Name and colour of a level, which the viewer shows on hovering.
fn describe(level: u16) -> AnnotationInfo {
    if level == OVERFLOW_LEVEL {
        let label = Some("full, loses data in this slot".into());
        return AnnotationInfo { id: level, label, color: Some(colour::LOSS.into()) };
    }
    let fill = f64::from(level) / f64::from(FULL_LEVEL);
    AnnotationInfo {
        id: level,
        label: Some(format!("queue {:.0} % full", 100.0 * fill).into()),
        color: Some(colour::of_fill(fill).into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_is_rounded_to_the_nearest_level() {
        let level_of = |queue_bits, capacity_bits| level(fill(queue_bits, capacity_bits));
        assert_eq!(level_of(0, 30_000), 0);
        assert_eq!(level_of(749, 30_000), 0); // 749 · 20 / 30 000 = 0.4993
        assert_eq!(level_of(751, 30_000), 1); // 751 · 20 / 30 000 = 0.5007
        assert_eq!(level_of(15_000, 30_000), 10);
        assert_eq!(level_of(u32::MAX - 1, u32::MAX), 20);
        assert_eq!(level_of(30_001, 30_000), 20);
        assert_eq!(level_of(0, 0), 20);
    }
}
