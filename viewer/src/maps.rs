//! Maps of the area in metres, each with a legend: data lost by sensor node (SN), time until each SN overflows, and
//! time since each cell was in range.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{Ellipses2D, LineStrips2D, Points2D, SegmentationImage, Transform3D};
use re_sdk_types::components::{ImageBuffer, ImageFormat, Radius};
use re_sdk_types::datatypes::{ChannelDatatype, ColorModel};
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::canvas::Canvas;
use crate::colour;
use crate::history::SensorHistory;
use crate::names::SensorNames;
use crate::rhythm::Rhythm;
use crate::shapes::writing;
use crate::sizes::{MAX_BARS, Sizes};
use crate::steps::{ScaleStep, Steps};
use crate::zones::{Raster, outlines};

/// Root of the entities that all maps share: frame, grid, numbers at the axes, outlines of zones and base.
pub const AREA: &str = "maps/area";
/// The UAV and its range.
pub const UAV: &str = "maps/uav";
/// Data lost so far, by SN.
pub const LOSS: &str = "maps/loss";
/// Time until each SN overflows.
pub const OVERFLOW: &str = "maps/overflow";
/// Time since each cell was in range.
pub const COVERAGE: &str = "maps/coverage";
/// Below each map: the changing entity.
pub const SHOWN: &str = "shown";

/// Number of slots between two updates of the coverage.
const EVERY: u64 = 10;

/// The coordinates of a map: x east, y down.
#[derive(Debug, Clone)]
pub(crate) struct MapFrame {
    sizes: Sizes,
    positions: Vec<[f32; 2]>,
    names: SensorNames,
}

impl MapFrame {
    pub(crate) fn of(sensors: &Sensors, sizes: &Sizes, names: &SensorNames) -> Self {
        let positions = sensors.positions.iter().map(|position| sizes.on_map(position)).collect();
        Self { sizes: *sizes, positions, names: names.clone() }
    }

    /// Draws frame, grid, the numbers at the axes, and the areas of the scenario.
    pub(crate) fn log(&self, canvas: &Canvas, scenario: &Scenario) -> RecordingStreamResult<()> {
        let sizes = &self.sizes;
        let Sizes { width_m, depth_m, .. } = *sizes;
        let north = sizes.grid_lines(width_m).map(|x_m| [[x_m, 0.0], [x_m, depth_m]]);
        let east = sizes.grid_lines(depth_m).map(|y_m| depth_m - y_m).map(|y_m| [[0.0, y_m], [width_m, y_m]]);
        let grid = LineStrips2D::new(north.chain(east)).with_colors([colour::GRID]);
        canvas.log_static(AREA, &grid.with_radii([Radius::new_ui_points(0.5)]).with_draw_order(-10.0))?;
        canvas.log_static(format!("{AREA}/numbers"), &writing(sizes.numbers_on_map()))?;
        self.log_areas(canvas, scenario)?;
        let range = Ellipses2D::update_fields()
            .with_half_sizes([[sizes.radius_m; 2]])
            .with_colors([colour::COVERAGE])
            .with_line_radii([Radius::new_ui_points(1.0)])
            .with_draw_order(40.0);
        canvas.log_static(UAV, &range)
    }

    /// Draws the outlines of boundary, zones, buildings and base, if there are any.
    fn log_areas(&self, canvas: &Canvas, scenario: &Scenario) -> RecordingStreamResult<()> {
        for (name, outlines, colour) in outlines(scenario) {
            let on_map = |outline: &Vec<Position>| outline.iter().map(|at| self.sizes.on_map(at)).collect::<Vec<_>>();
            let lines = LineStrips2D::new(outlines.iter().map(on_map)).with_colors([colour]);
            let lines = lines.with_radii([Radius::new_ui_points(1.0)]).with_draw_order(-5.0);
            canvas.log_static(format!("{AREA}/{name}"), &lines)?;
        }
        Ok(())
    }

    /// Draws the legend at the right of a map, with the first step at the top.
    fn log_legend(&self, canvas: &Canvas, map: &str, steps: &Steps) -> RecordingStreamResult<()> {
        let longer_m = self.sizes.longer_m();
        let x_m = self.sizes.width_m + 0.09 * longer_m;
        let y_m = |step: usize| (0.08 + 0.105 * step as f32) * longer_m;
        let entries = &steps.entries;
        let patches = Points2D::new((0..entries.len()).map(|step| [x_m, y_m(step)]))
            .with_colors(entries.iter().map(|entry| entry.colour))
            .with_radii([Radius::new_ui_points(6.0)]);
        canvas.log_static(format!("{map}/legend"), &patches)?;
        let place = |step: usize| [x_m + 0.24 * longer_m, y_m(step) - 0.03 * longer_m];
        let names = entries.iter().enumerate().map(|(step, entry)| (place(step), entry.name.clone()));
        canvas.log_static(format!("{map}/legend/names"), &writing(names))
    }
}

/// The bounds of a map in x and y (down) [m]: the area, the numbers at its axes, and the legend.
pub(crate) fn bounds(sizes: &Sizes) -> [[f64; 2]; 2] {
    let [width_m, longer_m] = [sizes.width_m, sizes.longer_m()].map(f64::from);
    [[-0.12 * longer_m, width_m + 0.52 * longer_m], [-0.05 * longer_m, 1.1 * longer_m]]
}

/// A map of SNs or cells, coloured by the steps of a scale.
#[derive(Debug)]
pub(crate) struct SteppedMap {
    shown: String,
    steps: Steps,
}

impl SteppedMap {
    /// Logs the legend.
    fn open(canvas: &Canvas, map: &str, frame: &MapFrame, steps: Steps) -> RecordingStreamResult<Self> {
        frame.log_legend(canvas, map, &steps)?;
        let shown = format!("{map}/{SHOWN}");
        canvas.log_static(&shown, &steps.classes())?;
        Ok(Self { shown, steps })
    }

    /// A map with a point per SN. Logs the static entities.
    pub(crate) fn of_sensors(
        canvas: &Canvas,
        map: &str,
        frame: &MapFrame,
        steps: Steps,
    ) -> RecordingStreamResult<Self> {
        let map = Self::open(canvas, map, frame, steps)?;
        let size_ui = match frame.positions.len() {
            ..=500 => 4.0,
            501..=MAX_BARS => 2.2,
            _ => 1.5,
        };
        let points = Points2D::new(frame.positions.iter().copied())
            .with_radii([Radius::new_ui_points(size_ui)])
            .with_show_labels(false)
            .with_draw_order(30.0);
        canvas.log_static(&map.shown, &points)?;
        if let Some(names) = frame.names.component() {
            canvas.log_static(&map.shown, &names)?;
        }
        Ok(map)
    }

    /// A map with a pixel per cell of the grid. Logs the static entities.
    fn of_cells(
        canvas: &Canvas,
        map: &str,
        frame: &MapFrame,
        steps: Steps,
        grid: Raster,
    ) -> RecordingStreamResult<Self> {
        let map = Self::open(canvas, map, frame, steps)?;
        let format = ImageFormat::from_color_model([grid.columns, grid.rows], ColorModel::L, ChannelDatatype::U8);
        let image = SegmentationImage::update_fields().with_format(format).with_opacity(1.0).with_draw_order(-20.0);
        canvas.log_static(&map.shown, &image)?;
        canvas.log_static(&map.shown, &Transform3D::from_scale([grid.cell_m as f32; 3]))?;
        Ok(map)
    }

    /// Shows the SNs by these values; `None` is the last step.
    pub(crate) fn show_sensors(
        &self,
        canvas: &Canvas,
        values: impl Iterator<Item = Option<f64>>,
    ) -> RecordingStreamResult<()> {
        let steps = values.map(|value| self.steps.step(value));
        canvas.show(&self.shown, &Points2D::update_fields().with_class_ids(steps))
    }

    /// Shows the cells by these values; `None` is the last step.
    fn show_cells(&self, canvas: &Canvas, values: impl Iterator<Item = Option<f64>>) -> RecordingStreamResult<()> {
        let pixels: Vec<u8> = values.map(|value| self.steps.step(value) as u8).collect();
        canvas.show(&self.shown, &SegmentationImage::update_fields().with_buffer(ImageBuffer::from(pixels)))
    }
}

/// The maps of a mission.
#[derive(Debug)]
pub(crate) struct Maps {
    loss: SteppedMap,
    overflow: SteppedMap,
    coverage: SteppedMap,
    sizes: Sizes,
    slot_s: f64,
    sensors_rhythm: Rhythm,
    coverage_rhythm: Rhythm,
}

impl Maps {
    /// Logs the static entities.
    pub(crate) fn open(
        canvas: &Canvas,
        scenario: &Scenario,
        frame: &MapFrame,
        history: &SensorHistory,
    ) -> RecordingStreamResult<Self> {
        frame.log(canvas, scenario)?;
        let entry = |name: &str, colour| ScaleStep { name: name.to_owned(), colour };
        let most_kbit = history.most_sampled_bits(scenario.slots) / 1e3;
        let loss = Steps::of(most_kbit, "kbit", entry("nothing lost", colour::GRID), colour::of_loss);
        let urgency = |fraction: f64| colour::of_fill(0.85 * (1.0 - fraction));
        let overflow = Steps::of(history.longest_fill_s(), "s", entry("full", colour::of_fill(1.0)), urgency)
            .with_last(entry("loses data", colour::LOSS));
        let mission_s = scenario.slots as f64 * scenario.slot_s;
        let coverage = Steps::of(mission_s, "s ago", entry("in range", colour::COVERAGE), colour::of_age)
            .with_last(entry("never", colour::GROUND));
        Ok(Self {
            loss: SteppedMap::of_sensors(canvas, LOSS, frame, loss)?,
            overflow: SteppedMap::of_sensors(canvas, OVERFLOW, frame, overflow)?,
            coverage: SteppedMap::of_cells(canvas, COVERAGE, frame, coverage, history.grid)?,
            sizes: frame.sizes,
            slot_s: scenario.slot_s,
            sensors_rhythm: Rhythm::of_sensors(frame.positions.len(), scenario.slots),
            coverage_rhythm: Rhythm::every(EVERY, scenario.slots),
        })
    }

    /// Draws a slot.
    pub(crate) fn log_slot(
        &mut self,
        canvas: &Canvas,
        slot: u64,
        history: &SensorHistory,
        uav: Position,
    ) -> RecordingStreamResult<()> {
        canvas.show(UAV, &Ellipses2D::update_fields().with_centers([self.sizes.on_map(&uav)]))?;
        if self.sensors_rhythm.is_due(slot) {
            let lost_kbit = history.sums.lost_bits.iter().map(|&lost_bits| Some(lost_bits as f64 / 1e3));
            self.loss.show_sensors(canvas, lost_kbit)?;
            let left_s = history.overflow_s().zip(history.overflows());
            let left_s = left_s.map(|(overflow_s, overflows)| (!overflows).then_some(overflow_s));
            self.overflow.show_sensors(canvas, left_s)?;
        }
        if self.coverage_rhythm.is_due(slot) {
            let ages_s = history.ages().map(|age| age.map(|slots| slots as f64 * self.slot_s));
            self.coverage.show_cells(canvas, ages_s)?;
        }
        Ok(())
    }
}
