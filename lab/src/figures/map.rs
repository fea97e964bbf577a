//! Where the UAV flew and what that left at the sensors: a panel per mission on one sheet, with a shared colour bar.

use std::path::Path;

use plotters::style::{RGBColor, WHITE};

use super::axis::Axis;
use super::canvas::{Canvas, FontTransform, HPos, Text};
use super::error::FigureError;
use super::panel::{Grid, Panel, draw_footer, footer_height, footer_lines};
use super::style::{AXIS_WIDTH, INK, PATH, TITLE_EM, fitting, shade};
use crate::error::LabError;

/// Width of a sheet [units, pixels of the PNG]; its height depends on the panels.
const WIDTH: f64 = 1600.0;
/// Distance of everything from the edge of the sheet [units].
const MARGIN: f64 = 30.0;
/// Em of everything but title and footer [units].
const EM: f64 = 24.0;
/// About so far apart are ticks [units].
const TICK_SPACING: [f64; 2] = [85.0, 85.0];
/// Space [units] left of a panel (tick and axis labels) and right of it.
const BESIDE: [f64; 2] = [110.0, 20.0];
/// Space [units] above a panel (its title) and below it (tick and axis labels).
const AROUND: [f64; 2] = [46.0, 84.0];
/// Radius [units] of a sensor.
const SENSOR: f64 = 8.0;
/// Half the width [units] of the sign at the start.
const START: f64 = 12.0;

/// A sensor of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSensor {
    /// Where it is: x, y [m].
    pub position_m: [f64; 2],
    /// What its colour shows, a fraction from 0 to 1.
    pub fraction: f64,
}

/// The trajectory of one mission.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryMap {
    /// Above the panel.
    pub title: String,
    /// Extent of the area in x [m].
    pub width_m: f64,
    /// Extent of the area in y [m].
    pub height_m: f64,
    /// The sensors.
    pub sensors: Vec<MapSensor>,
    /// Where the UAV began: x, y [m].
    pub start_m: [f64; 2],
    /// Where it was after each slot: x, y [m].
    pub path_m: Vec<[f64; 2]>,
}

/// Maps side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct MapSheet {
    /// Above everything.
    pub title: String,
    /// The maps, row by row.
    pub maps: Vec<TrajectoryMap>,
    /// What the colours of the sensors show.
    pub fraction_label: String,
    /// Mission, seed, version, command.
    pub footer: String,
}

impl MapSheet {
    /// Writes `stem`.svg and `stem`.png; the same sheet gives the same bytes.
    ///
    /// # Errors
    /// No map, a number that cannot be placed, a character that the embedded font lacks, a file that cannot be written.
    pub fn draw(&self, stem: &Path) -> Result<(), LabError> {
        if self.maps.is_empty() {
            return Err(FigureError::Nothing { place: format!("map sheet {:?}", self.title), what: "maps" }.into());
        }
        self.maps.iter().try_for_each(TrajectoryMap::check)?;

        let cells = self.maps.len() + 1; // the last is for colour bar and signs
        let columns = if cells == 2 || cells == 4 { 2 } else { 3 };
        let rows = cells.div_ceil(columns);
        let cell_width = (WIDTH - 2.0 * MARGIN) / columns as f64;
        let panel_width = cell_width - BESIDE[0] - BESIDE[1];
        let slimness = self.maps.iter().map(TrajectoryMap::slimness).fold(0.0, f64::max).clamp(0.65, 1.5);
        let cell_height = panel_width * slimness + AROUND[0] + AROUND[1];
        let top = MARGIN + 1.5 * TITLE_EM;
        let footer = footer_lines(&self.footer, WIDTH - 2.0 * MARGIN);
        let height = top + cell_height * rows as f64 + footer_height(&footer) + MARGIN;

        let mut canvas = Canvas::new(WIDTH as u32, height.ceil() as u32);
        let em = fitting(&self.title, TITLE_EM, WIDTH - 2.0 * MARGIN);
        canvas.text(Text::new(&self.title, [MARGIN, MARGIN + 0.8 * TITLE_EM], em, HPos::Left));
        let cell = |i: usize| [MARGIN + cell_width * (i % columns) as f64, top + cell_height * (i / columns) as f64];
        let room = [panel_width, panel_width * slimness];
        let highest = self.highest();
        for (i, map) in self.maps.iter().enumerate() {
            map.draw(&mut canvas, cell(i), room, highest);
        }
        self.draw_key(&mut canvas, cell(self.maps.len()), room, highest);
        draw_footer(&mut canvas, footer, [MARGIN, height.ceil() - MARGIN]);
        canvas.write(stem)
    }

    /// Upper end of the colour bar: the first of 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1 that no fraction exceeds.
    fn highest(&self) -> f64 {
        let fractions = self.maps.iter().flat_map(|map| &map.sensors).map(|sensor| sensor.fraction);
        let highest = fractions.fold(0.0, f64::max);
        [0.01, 0.02, 0.05, 0.1, 0.2, 0.5].into_iter().find(|&end| highest <= end).unwrap_or(1.0)
    }

    /// Draws colour bar and signs in the cell after the last map.
    fn draw_key(&self, canvas: &mut Canvas, [cell_x, cell_y]: [f64; 2], [width, height]: [f64; 2], highest: f64) {
        let [left, top] = [cell_x + BESIDE[0], cell_y + AROUND[0] + 0.1 * height];
        canvas.text(Text::new(&self.fraction_label, [left, top], fitting(&self.fraction_label, EM, width), HPos::Left));
        const STEPS: u32 = 64;
        let bar = Panel {
            corner: [left, top + 0.6 * EM],
            size: [width, 1.4 * EM],
            x: Axis::exact(0.0, highest),
            y: Axis::exact(0.0, 1.0),
        };
        for step in 0..STEPS {
            // Each step reaches to the end, under the next: no seams where a viewer smooths edges.
            let x0 = left + width * f64::from(step) / f64::from(STEPS);
            let (x1, y0, y1) = (left + width, bar.corner[1], bar.bottom());
            let colour = shade((f64::from(step) + 0.5) / f64::from(STEPS));
            canvas.area(vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]], colour, 1.0);
        }
        bar.draw_x_axis(canvas, EM, 0.8 * TICK_SPACING[0]);
        bar.draw_frame(canvas);

        let row = |i: f64| bar.bottom() + Panel::bottom_margin(EM) + 1.8 * EM * i;
        let sign = |i: f64| [left + 30.0, row(i)];
        draw_start(canvas, sign(1.0));
        draw_end(canvas, sign(2.0));
        canvas.line(vec![[left, row(3.0)], [left + 60.0, row(3.0)]], AXIS_WIDTH, PATH);
        draw_sensor(canvas, sign(4.0), shade(0.5));
        for (i, meaning) in ["start", "end", "path of the UAV", "sensor"].into_iter().enumerate() {
            canvas.text(Text::new(meaning, [left + 80.0, row(i as f64 + 1.0) + 0.36 * EM], EM, HPos::Left));
        }
    }
}

impl TrajectoryMap {
    fn check(&self) -> Result<(), FigureError> {
        let place = || format!("map {:?}", self.title);
        for (key, extent_m) in [("width_m", self.width_m), ("height_m", self.height_m)] {
            let expected = "a finite length above 0";
            FigureError::unless(extent_m.is_finite() && extent_m > 0.0, place, key, extent_m, expected)?;
        }
        let sensors = self.sensors.iter().map(|sensor| sensor.position_m);
        for position_m in self.path_m.iter().copied().chain(sensors).chain([self.start_m]) {
            for (key, value) in ["x", "y"].into_iter().zip(position_m) {
                FigureError::unless(value.is_finite(), place, key, value, "a finite position [m]")?;
            }
        }
        for sensor in &self.sensors {
            let fraction = sensor.fraction;
            FigureError::unless(
                (0.0..=1.0).contains(&fraction),
                place,
                "fraction",
                fraction,
                "a fraction from 0 to 1",
            )?;
        }
        Ok(())
    }

    /// Low and high end [m] of what the map shows in x and y: the area, and all that lies outside of it.
    fn extent_m(&self) -> [[f64; 2]; 2] {
        let positions = self.sensors.iter().map(|sensor| sensor.position_m).chain(self.path_m.iter().copied());
        let area = [[0.0, self.width_m], [0.0, self.height_m]];
        positions
            .chain([self.start_m])
            .fold(area, |[x_m, y_m], [x, y]| [[x_m[0].min(x), x_m[1].max(x)], [y_m[0].min(y), y_m[1].max(y)]])
    }

    /// Height over width of what the map shows.
    fn slimness(&self) -> f64 {
        let [x_m, y_m] = self.extent_m();
        (y_m[1] - y_m[0]) / (x_m[1] - x_m[0])
    }

    /// Draws the map to scale in the upper middle of its cell.
    fn draw(&self, canvas: &mut Canvas, [cell_x, cell_y]: [f64; 2], room: [f64; 2], highest: f64) {
        let [x_m, y_m] = self.extent_m();
        let (width_m, height_m) = (x_m[1] - x_m[0], y_m[1] - y_m[0]);
        let units_per_m = (room[0] / width_m).min(room[1] / height_m);
        let size = [width_m * units_per_m, height_m * units_per_m];
        let corner = [cell_x + BESIDE[0] + (room[0] - size[0]) / 2.0, cell_y + AROUND[0]];
        let panel = Panel { corner, size, x: Axis::exact(x_m[0], x_m[1]), y: Axis::exact(y_m[0], y_m[1]) };
        panel.draw(canvas, EM, TICK_SPACING, Grid::None);
        let [left, top] = corner;
        let em = fitting(&self.title, 1.1 * EM, size[0]);
        canvas.text(Text::new(&self.title, [left, top - 0.6 * EM], em, HPos::Left));
        let base = panel.bottom() + Panel::bottom_margin(EM) + EM;
        canvas.text(Text::new("x [m]", [left + size[0] / 2.0, base], EM, HPos::Center));
        let at = [left - panel.left_margin(EM, TICK_SPACING[1]) - 0.5 * EM, top + size[1] / 2.0];
        canvas.text(Text { turn: FontTransform::Rotate270, ..Text::new("y [m]", at, EM, HPos::Center) });

        let positions_m = std::iter::once(self.start_m).chain(self.path_m.iter().copied());
        let path: Vec<_> = positions_m.map(|[x, y]| panel.at(x, y)).collect();
        let end = path[path.len() - 1];
        canvas.line(path, AXIS_WIDTH, PATH);
        for sensor in &self.sensors {
            let [x, y] = sensor.position_m;
            draw_sensor(canvas, panel.at(x, y), shade(sensor.fraction / highest));
        }
        draw_start(canvas, panel.at(self.start_m[0], self.start_m[1]));
        draw_end(canvas, end);
    }
}

/// A disc with a dark edge, so that a light one is seen on white.
fn draw_sensor(canvas: &mut Canvas, [x, y]: [f64; 2], colour: RGBColor) {
    let corner = |i: u32| {
        let (sin, cos) = (f64::from(i) / 24.0 * std::f64::consts::TAU).sin_cos();
        [x + SENSOR * sin, y - SENSOR * cos]
    };
    let edge: Vec<_> = (0..=24).map(corner).collect();
    canvas.area(edge.clone(), colour, 1.0);
    canvas.line(edge, 1.0, INK);
}

/// A square on white.
fn draw_start(canvas: &mut Canvas, [x, y]: [f64; 2]) {
    let square = |r: f64| vec![[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r], [x - r, y - r]];
    canvas.line(square(START), 7.0, WHITE);
    canvas.line(square(START), 3.5, INK);
}

/// A cross on white.
fn draw_end(canvas: &mut Canvas, [x, y]: [f64; 2]) {
    for (width, colour) in [(8.0, WHITE), (4.0, INK)] {
        for r in [START, -START] {
            canvas.line(vec![[x - START, y - r], [x + START, y + r]], width, colour);
        }
    }
}
