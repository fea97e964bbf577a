//! `skysink figures`: the sweeps behind the letter's Fig. 2, and the charts, maps and tables made of them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use skysink_common::node::{NodeError, Stop};
use skysink_common::scenario::{LETTER, Overrides, Scenario, Strategy};
use skysink_common::sensors::SensorList;

use super::altitude;
use super::{Chart, MapSensor, MapSheet, Point, Scale, Series, TrajectoryMap};
use crate::error::Error;
use crate::mission::Mission;
use crate::record::write_whole;
use crate::sweep::journal::Row;
use crate::sweep::plan::{Flight, Sweep};
use crate::sweep::statistics::Estimate;
use crate::sweep::{results, sweep};

/// Strategies, in the order of legends and tables.
const STRATEGIES: [Strategy; 5] = Strategy::MEMORYLESS;

/// The two regimes of the radio: a visit that empties every queue, and one that carries a part of a queue.
const LINKS: [(&str, &str, f64); 2] = [("letter", "W = 5 MHz, the letter's", 5e6), ("narrow", "W = 5 kHz", 5e3)];

/// What is plotted of the missions of a sweep.
pub(super) struct Quantity {
    pub stem: &'static str,
    pub title: &'static str,
    pub y_label: &'static str,
    pub y_scale: Scale,
    pub value: fn(&Row) -> f64,
}

/// One call of `skysink figures`.
pub(super) struct Campaign<'a> {
    /// Missions per point.
    pub runs: u64,
    /// Folder of the figures.
    pub out: &'a Path,
    threads: usize,
    stop: &'a Stop,
}

impl Campaign<'_> {
    /// Flies what is missing of a sweep, into a folder of its own; on `threads` threads if that is not 0.
    pub fn fly(&self, name: &str, plan: &Sweep, threads: usize) -> Result<BTreeMap<Flight, Row>, Error> {
        let threads = if threads > 0 { threads } else { self.threads };
        sweep(plan, &self.out.join("data").join(name), (1, 1), threads, self.stop)
    }

    /// Version and command, for footers.
    fn command(&self) -> String {
        format!("skysink {} · skysink figures --runs {}", env!("CARGO_PKG_VERSION"), self.runs)
    }

    /// The footer of a chart.
    pub fn footer(&self) -> String {
        let (runs, command) = (self.runs, self.command());
        format!("{runs} missions per point, seeds 1 to {runs} · bands: 95 % CI of the mean, Student's t · {command}")
    }
}

/// A sweep over one key in both regimes, and what is plotted of it.
struct Study {
    name: &'static str,
    key: &'static str,
    values: &'static [i64],
    x_label: &'static str,
    /// What differs from the letter's mission, as axes of one value.
    fixed: &'static [(&'static str, i64)],
    /// Missions at the same time; 1 where time itself is measured, 0 for as many as asked for.
    threads: usize,
    quantities: &'static [Quantity],
}

const LOSS: fn(&Row) -> f64 = |row| row.loss_rate;

/// The letter's Fig. 2 (a) to (c), and the bits per waypoint that its text speaks of.
const STUDIES: [Study; 3] = [
    Study {
        name: "area",
        key: "area.side_m",
        values: &[100, 150, 200, 250, 300],
        x_label: "side of the area [m]",
        fixed: &[("slots", 500)],
        threads: 0,
        quantities: &[
            Quantity {
                stem: "fig2a-loss-area",
                title: "Data loss against the area",
                y_label: "data loss rate η",
                y_scale: Scale::Linear,
                value: LOSS,
            },
            Quantity {
                stem: "bits-area",
                title: "Bits per waypoint against the area",
                y_label: "bits delivered per waypoint [bit]",
                y_scale: Scale::Linear,
                value: |row| row.bits_per_waypoint,
            },
        ],
    },
    Study {
        name: "rate",
        key: "sensors.sampling_bps",
        values: &[100, 200, 300, 400, 500, 600, 700, 800],
        x_label: "sampling rate s [bit/s]",
        fixed: &[("slots", 600)],
        threads: 0,
        quantities: &[Quantity {
            stem: "fig2b-loss-rate",
            title: "Data loss against the sampling rate",
            y_label: "data loss rate η",
            y_scale: Scale::Linear,
            value: LOSS,
        }],
    },
    Study {
        name: "time",
        key: "sensors.count",
        values: &[50, 100, 200, 400],
        x_label: "sensor nodes N in 100 m × 100 m",
        fixed: &[("sensors.sampling_bps", 120), ("slots", 600)],
        threads: 1,
        quantities: &[Quantity {
            stem: "fig2c-time",
            title: "Planning time of a slot, median of each mission",
            y_label: "planning time [µs]",
            y_scale: Scale::Log,
            value: |row| row.plan_p50_us,
        }],
    },
];

/// The fields of the trajectory maps: the letter's, and one that is too large for Algorithm 1.
const MAPS: [(&str, &str); 2] = [("map-letter", ""), ("map-sparse", "[area]\nside_m = 300.0\n")];

/// Flies `runs` missions per point and draws everything into `out`; returns the figures' paths without their endings.
///
/// # Errors
/// If a sweep is refused, something cannot be written, or on a stop.
pub fn draw(runs: u64, out: &Path, threads: usize, stop: &Stop) -> Result<Vec<PathBuf>, Error> {
    let campaign = Campaign { runs, out, threads, stop };
    let mut stems = Vec::new();
    let version = env!("CARGO_PKG_VERSION");
    let mut tables =
        format!("Made by `skysink figures --runs {runs}`, version {version}; mean ± half of the 95 % CI.\n");
    for study in &STUDIES {
        let rows = campaign.fly(study.name, &study.sweep(runs)?, study.threads)?;
        for quantity in study.quantities {
            for (place, (link, regime, _)) in LINKS.iter().enumerate() {
                let chart = study.chart(quantity, &rows, place, regime, &campaign.footer());
                let stem = out.join(format!("{}-{link}", quantity.stem));
                chart.draw(&stem)?;
                write_table(&mut tables, &chart);
                stems.push(stem);
            }
        }
    }
    stems.extend(altitude::draw(&campaign, &mut tables)?);
    for (name, change) in MAPS {
        let stem = out.join(name);
        map_sheet(change, &campaign.command())?.draw(&stem)?;
        stems.push(stem);
    }
    write_whole(&out.join("tables.md"), tables.as_bytes())?;
    Ok(stems)
}

impl Study {
    /// The sweep: regime of the radio, then the key, over the letter's mission.
    fn sweep(&self, runs: u64) -> Result<Sweep, Error> {
        let list = |values: Vec<toml::Value>| toml::Value::Array(values);
        let mut axes = toml::Table::new();
        for (key, value) in self.fixed {
            axes.insert((*key).to_owned(), list(vec![number(key, *value)]));
        }
        axes.insert("link.bandwidth_hz".to_owned(), list(LINKS.map(|(_, _, width_hz)| width_hz.into()).to_vec()));
        axes.insert(self.key.to_owned(), list(self.values.iter().map(|&value| number(self.key, value)).collect()));
        let letter = LETTER.parse().expect("the built-in scenario is TOML");
        let base = (PathBuf::from("letter.toml (built in)"), letter);
        Sweep::new(Path::new(self.name), base, axes, STRATEGIES.to_vec(), (1..=runs).collect())
    }

    /// One quantity in one regime, a curve per strategy.
    fn chart(
        &self,
        quantity: &Quantity,
        rows: &BTreeMap<Flight, Row>,
        link: usize,
        regime: &str,
        footer: &str,
    ) -> Chart {
        let groups = results::groups(rows);
        let point = |strategy: usize, place: usize, x: i64| {
            let rows = &groups[&(link * self.values.len() + place, strategy)];
            let estimate = Estimate::of(&rows.iter().map(|row| (quantity.value)(row)).collect::<Vec<_>>());
            Point { x: x as f64, mean: estimate.mean, half_width: estimate.half_width.unwrap_or(f64::NAN) }
        };
        let series = |(strategy, name): (usize, &Strategy)| Series {
            label: name.name().to_owned(),
            points: self.values.iter().enumerate().map(|(place, &x)| point(strategy, place, x)).collect(),
        };
        Chart {
            title: format!("{} · {regime}", quantity.title),
            x_label: self.x_label.to_owned(),
            y_label: quantity.y_label.to_owned(),
            series: STRATEGIES.iter().enumerate().map(series).collect(),
            footer: footer.to_owned(),
            y_scale: quantity.y_scale,
        }
    }
}

/// A swept value: whole for counts, a float for what has a unit.
fn number(key: &str, value: i64) -> toml::Value {
    if matches!(key, "slots" | "sensors.count") { value.into() } else { (value as f64).into() }
}

/// The chart as a Markdown table.
pub(super) fn write_table(tables: &mut String, chart: &Chart) {
    let labels = chart.series.iter().map(|series| series.label.clone());
    let header: Vec<String> = [chart.x_label.clone()].into_iter().chain(labels).collect();
    let rule = header.iter().map(|_| "---".to_owned()).collect();
    let mut lines = vec![header, rule];
    for (place, point) in chart.series[0].points.iter().enumerate() {
        let cells = chart.series.iter().map(|series| {
            let Point { mean, half_width, .. } = series.points[place];
            let digits = if mean.abs() >= 100.0 {
                0
            } else if mean.abs() >= 1.0 {
                1
            } else {
                4
            };
            if half_width.is_nan() {
                format!("{mean:.digits$}")
            } else {
                format!("{mean:.digits$} ± {half_width:.digits$}")
            }
        });
        lines.push([point.x.to_string()].into_iter().chain(cells).collect());
    }
    writeln!(tables, "\n**{}**; {}\n", chart.title, chart.y_label).expect("a string takes everything");
    for cells in lines {
        writeln!(tables, "| {} |", cells.join(" | ")).expect("a string takes everything");
    }
}

/// The flights of all strategies over the letter's mission, changed.
fn map_sheet(change: &str, command: &str) -> Result<MapSheet, Error> {
    let mut maps = Vec::new();
    for strategy in STRATEGIES {
        let text = format!("name = \"map\"\nslots = 500\n{change}");
        let overrides = Overrides { strategy: Some(strategy), seed: Some(1), slots: None };
        let scenario = Scenario::parse(&text, Path::new("map (built in)"), overrides)?;
        let list = SensorList::of(&scenario)?;
        let mut mission = Mission::new(&scenario, &list);
        let (mut path_m, mut loss_rate) = (Vec::new(), 0.0);
        while let Some(turn) = mission.turn().map_err(|error| NodeError::Peer(error.to_string()))? {
            path_m.push([turn.flight.x_m, turn.flight.y_m]);
            let totals = turn.header.totals;
            loss_rate = totals.lost_bits as f64 / totals.sampled_bits as f64;
        }
        let capacity = f64::from(scenario.sensors.capacity_bits);
        let sensors = list.sensors().iter().zip(mission.queues_bits()).map(|(sensor, &queue)| MapSensor {
            position_m: sensor.position.coords.into(),
            share: f64::from(queue) / capacity,
        });
        maps.push(TrajectoryMap {
            title: format!("{}: η = {loss_rate:.3}", strategy.name()),
            width_m: scenario.area.width_m,
            height_m: scenario.area.height_m,
            sensors: sensors.collect(),
            start_m: scenario.uav.start.coords.into(),
            path_m,
        });
    }
    let side_m = maps[0].width_m;
    Ok(MapSheet {
        title: format!("Trajectories over 500 slots · {side_m} m × {side_m} m"),
        maps,
        share_label: "queue fill at the end".to_owned(),
        footer: format!("seed 1, the letter's mission · {command}"),
    })
}
