//! Maps of trajectories and final queues: one panel per mission on one sheet, with a shared colour bar.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use skysink_common::interpolation::interpolate;
use svg::Node;
use svg::node::element::{Circle, ClipPath, Group, Rectangle};

use super::axis::{Axis, Panel};
use super::levels::{BANDS, LevelMap, tint};
use super::page::{INK, Look, MARGIN, Page, SAMPLE, fitting, line, stroke, text, text_width};
use super::style::shade;
use crate::error::LabError;

/// Font size of everything but the title [units].
const EM: f64 = 24.0;
/// Space [units] left of a panel (tick and axis labels) and right of it.
const BESIDE: [f64; 2] = [110.0, 20.0];
/// Space [units] above a panel (its title) and below it (tick and axis labels).
const AROUND: [f64; 2] = [46.0, 84.0];
/// Minimum width of a map with its labels [units].
const NARROWEST: f64 = 400.0;
/// Marker at the start, as relative SVG path data: a square.
const START: &str = "m-12,-12h24v24h-24z";
/// Marker at the end: a cross.
const END: &str = "m-12,-12l24,24m0,-24l-24,24";
/// Marker in a dead sensor: a cross within it.
const CROSS: &str = "m-7,-7l14,14m0,-14l-14,14";
/// Colours of the energy that a battery has lost and has left, and of the cross.
const BATTERY: [&str; 2] = ["#d0d0d0", "#3f8f2f"];
const DEAD: &str = "#c03d3e";
/// Radius of the ring that shows a battery [units].
const RING: f64 = 13.0;
/// Colour of a path.
const PATH: &str = "#909090";

/// Outline and fill of each kind of area, and its name in the legend.
const AREAS: [(AreaKind, &str, &str, &str); 4] = [
    (AreaKind::Boundary, "#c03d3e", "none", "boundary"),
    (AreaKind::NoFly, "#c03d3e", "#f4d3d3", "no-fly zone"),
    (AreaKind::Building, "#707070", "#dcdcdc", "building"),
    (AreaKind::Base, "#3f8f2f", "#d9efd3", "base"),
];

/// Paths of several UAVs, in turn.
const PATHS: [&str; 6] = [PATH, "#3b75af", "#d07f2c", "#519e3e", "#8d69b8", "#c03d3e"];

/// A sensor of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapSensor {
    /// Position: x, y [m].
    pub position_m: [f64; 2],
    /// The fraction that its colour shows, from 0 to 1.
    pub fraction: f64,
    /// The energy left as a fraction of its battery, 0 of a dead one; `None` without one.
    pub energy: Option<f64>,
}

/// What an area of a map is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AreaKind {
    Boundary,
    NoFly,
    Building,
    /// The base, or a part of it.
    Base,
}

/// The outline of an area.
#[derive(Debug, Clone, PartialEq)]
pub enum AreaOutline {
    /// Corners: x, y [m].
    Polygon(Vec<[f64; 2]>),
    /// Centre and radius [m].
    Disk([f64; 2], f64),
}

/// The trajectory of one mission.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryMap {
    /// Title above the panel.
    pub title: String,
    /// Extent of the area in x [m].
    pub width_m: f64,
    /// Extent of the area in y [m].
    pub height_m: f64,
    /// The map of links, below the rest.
    pub links: Option<LevelMap>,
    /// Zones, buildings and the base, below the rest.
    pub areas: Vec<(AreaKind, AreaOutline)>,
    /// Places that have a name: x, y [m].
    pub names: Vec<([f64; 2], String)>,
    pub sensors: Vec<MapSensor>,
    /// Position of each UAV at the start, then after each slot: x, y [m].
    pub paths_m: Vec<Vec<[f64; 2]>>,
}

/// The scales of a sheet.
#[derive(Debug, Clone, Copy)]
struct Scales {
    /// Upper end of that of fractions.
    highest: f64,
    /// Ends of that of links, if there are any.
    levels: Option<[f64; 2]>,
}

/// Maps side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct MapSheet {
    /// Texts of the page.
    pub look: Look,
    /// The maps, row by row; at least one.
    pub maps: Vec<TrajectoryMap>,
    /// Label of the colour bar.
    pub fraction_label: String,
}

impl MapSheet {
    /// Writes `stem`.svg, and with the feature `pictures` `stem`.pdf and `stem`.png; the same sheet gives the same
    /// bytes.
    pub fn draw(&self, stem: &Path) -> Result<Vec<PathBuf>, LabError> {
        let cells = self.maps.len() + 1; // the last cell is the legend
        let width = self.look.width() - 2.0 * MARGIN;
        let most = ((width / NARROWEST) as usize).clamp(1, 3);
        let columns = if cells == 2 || cells == 4 { most.min(2) } else { most };
        let cell_width = width / columns as f64;
        let panel_width = cell_width - BESIDE[0] - BESIDE[1];
        let aspect = self.maps.iter().map(TrajectoryMap::aspect).fold(0.0, f64::max).clamp(0.65, 1.5);
        let room = [panel_width, panel_width * aspect];
        let cell_height = room[1] + AROUND[0] + AROUND[1];
        let corner = |cell: usize| {
            let row = cell / columns;
            let column = cell % columns;
            [MARGIN + cell_width * column as f64 + BESIDE[0], self.look.top() + cell_height * row as f64 + AROUND[0]]
        };
        let mut page = Page::new(&self.look);
        let scales = Scales { highest: self.highest(), levels: self.levels() };
        for (i, map) in self.maps.iter().enumerate() {
            map.draw(&mut page, corner(i), room, scales);
        }
        let key_end = self.draw_key(&mut page, corner(self.maps.len()), room[0], scales);
        let maps_end = self.look.top() + cell_height * cells.div_ceil(columns) as f64;
        page.write(stem, maps_end.max(key_end) - 0.5 * MARGIN)
    }

    /// The ends of the scale of links; `None` without a map of links.
    fn levels(&self) -> Option<[f64; 2]> {
        let ranges = || self.maps.iter().flat_map(|map| &map.links).filter_map(LevelMap::range);
        ranges().reduce(|[low, high], [lower, higher]| [low.min(lower), high.max(higher)])
    }

    /// Upper end of the colour bar: the first of 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1 that no fraction exceeds.
    fn highest(&self) -> f64 {
        let fractions = self.maps.iter().flat_map(|map| &map.sensors).map(|sensor| sensor.fraction);
        let highest = fractions.fold(0.0, f64::max);
        [0.01, 0.02, 0.05, 0.1, 0.2, 0.5].into_iter().find(|&end| highest <= end).unwrap_or(1.0)
    }

    /// Draws the colour bars and the markers in the cell after the last map; returns their lower end.
    fn draw_key(&self, page: &mut Page, [left, top]: [f64; 2], width: f64, scales: Scales) -> f64 {
        let Scales { highest, levels } = scales;
        const STEPS: u32 = 64;
        page.add(text(&self.fraction_label, [left, top + EM], fitting(&self.fraction_label, EM, width), "start"));
        for step in 0..STEPS {
            // Each step extends to the end below the next one, so that antialiasing shows no seams.
            let done = width * f64::from(step) / f64::from(STEPS);
            let bar = Rectangle::new().set("x", left + done).set("width", width - done);
            let colour = shade((f64::from(step) + 0.5) / f64::from(STEPS));
            page.add(bar.set("y", top + 1.6 * EM).set("height", 1.4 * EM).set("fill", colour));
        }
        for part in [0.0, 0.5, 1.0] {
            page.add(text(&(part * highest).to_string(), [left + part * width, top + 4.0 * EM], EM, "middle"));
        }
        let mut top = top + 5.0 * EM;
        if let (Some([low, high]), Some(links)) = (levels, self.maps.iter().find_map(|map| map.links.as_ref())) {
            page.add(text(&links.label, [left, top + EM], fitting(&links.label, EM, width), "start"));
            let step = width / BANDS as f64;
            for band in 0..BANDS {
                let bar = Rectangle::new().set("x", left + step * band as f64).set("width", step);
                page.add(bar.set("y", top + 1.6 * EM).set("height", 1.4 * EM).set("fill", tint(band)));
            }
            for (part, anchor) in [(0.0, "start"), (0.5, "middle"), (1.0, "end")] {
                let level = format!("{:.0}", interpolate(low, high, part)).replace('-', "−");
                page.add(text(&level, [left + part * width, top + 4.0 * EM], EM, anchor));
            }
            top += 5.0 * EM;
        }
        let at = [SAMPLE / 2.0, 0.0];
        let path = |uav: usize| Group::new().add(stroke(line([[0.0, 0.0], [SAMPLE, 0.0]]), 2.0, PATHS[uav]));
        let uavs = self.maps.iter().map(|map| map.paths_m.len()).max().unwrap_or(1).min(PATHS.len());
        let names: Vec<String> = (0..uavs).map(|uav| format!("path of UAV {uav}")).collect();
        let names = if uavs > 1 { names } else { vec!["path of the UAV".to_owned()] };
        let mut entries = vec![(sign(at, START), "start"), (sign(at, END), "end")];
        entries.extend(names.iter().enumerate().map(|(uav, name)| (path(uav), name.as_str())));
        entries.push((Group::new().add(sensor(at, 0.5)), "sensor"));
        let energies = || self.maps.iter().flat_map(|map| &map.sensors).filter_map(|sensor| sensor.energy);
        entries.extend(energies().next().map(|_| (battery(at, 0.7), "energy left")));
        entries.extend(energies().find(|left| *left == 0.0).map(|_| (dead(at), "dead sensor")));
        let has = |kind| self.maps.iter().flat_map(|map| &map.areas).any(|(other, _)| *other == kind);
        let square = |kind| {
            let corners = [[0.0, -9.0], [SAMPLE, -9.0], [SAMPLE, 9.0], [0.0, 9.0]];
            Group::new().add(filled(line(corners) + "z", kind))
        };
        let shown = AREAS.into_iter().filter(|(kind, ..)| has(*kind));
        entries.extend(shown.map(|(kind, .., name)| (square(kind), name)));
        page.add_legend([left, top], width, EM, &entries)
    }
}

impl TrajectoryMap {
    /// The range of the map in x and y [m]: the area, extended to all sensors and the path.
    fn extent_m(&self) -> [[f64; 2]; 2] {
        let positions =
            self.sensors.iter().map(|sensor| sensor.position_m).chain(self.paths_m.iter().flatten().copied());
        let area = [[0.0, self.width_m], [0.0, self.height_m]];
        positions.fold(area, |[x_m, y_m], [x, y]| [[x_m[0].min(x), x_m[1].max(x)], [y_m[0].min(y), y_m[1].max(y)]])
    }

    /// Height over width of the map.
    fn aspect(&self) -> f64 {
        let [x_m, y_m] = self.extent_m();
        (y_m[1] - y_m[0]) / (x_m[1] - x_m[0])
    }

    /// Draws the map to scale, centred horizontally at the top of `room` [units].
    fn draw(&self, page: &mut Page, [left, top]: [f64; 2], room: [f64; 2], scales: Scales) {
        let [x_m, y_m] = self.extent_m();
        let units_per_m = (room[0] / (x_m[1] - x_m[0])).min(room[1] / (y_m[1] - y_m[0]));
        let size = [x_m, y_m].map(|[low, high]| (high - low) * units_per_m);
        let corner = [left + (room[0] - size[0]) / 2.0, top];
        let panel = Panel { corner, size, x: Axis::exact("x [m]", x_m), y: Axis::exact("y [m]", y_m), em: EM };
        panel.draw_axes(page);
        page.add(text(&self.title, [corner[0], top - 0.6 * EM], fitting(&self.title, 1.1 * EM, size[0]), "start"));

        let at = |[x, y]: [f64; 2]| panel.at(x, y);
        // Zones may go on beyond the map.
        let clip = format!("map-{:.0}-{:.0}", corner[0], corner[1]);
        let frame =
            Rectangle::new().set("x", corner[0]).set("y", corner[1]).set("width", size[0]).set("height", size[1]);
        page.add(ClipPath::new().set("id", clip.clone()).add(frame));
        let mut areas = Group::new().set("clip-path", format!("url(#{clip})"));
        if let (Some(links), Some(levels)) = (&self.links, scales.levels) {
            areas = areas.add(links.draw(&panel, levels));
        }
        for (kind, outline) in &self.areas {
            let data = match outline {
                AreaOutline::Polygon(corners_m) => line(corners_m.iter().copied().map(at)) + "z",
                AreaOutline::Disk(centre_m, radius_m) => {
                    let [x, y] = at(*centre_m);
                    let r = radius_m * units_per_m;
                    let [left, across] = [x - r, 2.0 * r];
                    format!("M{left:.1},{y:.1}a{r:.1},{r:.1} 0 1 0 {across:.1},0a{r:.1},{r:.1} 0 1 0 -{across:.1},0z")
                }
            };
            areas = areas.add(filled(data, *kind));
        }
        page.add(areas);
        for (uav, path_m) in self.paths_m.iter().enumerate() {
            page.add(stroke(line(path_m.iter().copied().map(at)), 2.0, PATHS[uav % PATHS.len()]));
        }
        for MapSensor { position_m, fraction, energy } in &self.sensors {
            let place = at(*position_m);
            match energy {
                Some(0.0) => page.add(dead(place)),
                Some(left) => page.add(battery(place, *left).add(sensor(place, fraction / scales.highest))),
                None => page.add(sensor(place, fraction / scales.highest)),
            }
        }
        for path_m in &self.paths_m {
            path_m.first().into_iter().for_each(|&start_m| page.add(sign(at(start_m), START)));
            path_m.last().into_iter().for_each(|&end_m| page.add(sign(at(end_m), END)));
        }
        for (place_m, name) in &self.names {
            // Within the panel: above the place, or below it where it is at the upper end.
            let half = 0.55 * text_width(name, 0.8 * EM);
            let [x, y] = at(*place_m);
            let x = x.min(corner[0] + size[0] - half).max(corner[0] + half);
            let y = if y - 2.5 * EM < corner[1] { y + 2.2 * EM } else { y - 1.8 * EM };
            page.add(text(name, [x, y], 0.8 * EM, "middle"));
        }
    }
}

/// The area within the SVG path `data`.
fn filled(data: String, kind: AreaKind) -> impl Into<Box<dyn Node>> {
    let (_, edge, fill, _) = AREAS.into_iter().find(|(other, ..)| *other == kind).expect("each kind has its colours");
    stroke(data, 2.0, edge).set("fill", fill)
}

/// A disc with a dark edge, so that light ones are visible on white.
fn sensor([x, y]: [f64; 2], fraction: f64) -> Circle {
    let disc = Circle::new().set("cx", format!("{x:.1}")).set("cy", format!("{y:.1}")).set("r", 8);
    disc.set("fill", shade(fraction)).set("stroke", INK)
}

/// A ring of which the fraction `left` is the energy in a battery, clockwise from the top.
fn battery([x, y]: [f64; 2], left: f64) -> Group {
    let [sine, cosine] = <[f64; 2]>::from((left * TAU).sin_cos());
    let [end_x, end_y] = [x + RING * sine, y - RING * cosine];
    let ring = Circle::new().set("cx", format!("{x:.1}")).set("cy", format!("{y:.1}")).set("r", RING);
    let ring = |colour: &str| ring.clone().set("fill", "none").set("stroke", colour).set("stroke-width", 4);
    if left > 0.999 {
        return Group::new().add(ring(BATTERY[1]));
    }
    let long = u8::from(left > 0.5);
    let arc = format!("M{x:.1},{:.1}A{RING},{RING} 0 {long} 1 {end_x:.1},{end_y:.1}", y - RING);
    Group::new().add(ring(BATTERY[0])).add(stroke(arc, 4.0, BATTERY[1]))
}

/// A disc with a cross.
fn dead([x, y]: [f64; 2]) -> Group {
    let disc = Circle::new().set("cx", format!("{x:.1}")).set("cy", format!("{y:.1}")).set("r", 11);
    let disc = disc.set("fill", "white").set("stroke", DEAD).set("stroke-width", 2);
    Group::new().add(disc).add(stroke(format!("M{x:.1},{y:.1}{CROSS}"), 4.0, DEAD))
}

/// A marker with a white outline.
fn sign([x, y]: [f64; 2], data: &str) -> Group {
    let data = format!("M{x:.1},{y:.1}{data}");
    Group::new().add(stroke(&*data, 8.0, "white")).add(stroke(&*data, 4.0, INK))
}
