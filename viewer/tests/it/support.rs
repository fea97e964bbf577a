//! A synthetic mission to record, and a reader of recordings.
#![allow(dead_code)] // each test program uses its part

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::Array;
use re_chunk_store::{ChunkStore, ChunkStoreConfig};
use re_sdk::TimelineName;
use re_sdk::log::TimeColumn;
use skysink_common::message::{FlightReport, LinkReport, Mode, PathPoint, Plan, QueuesHeader, SensorNode, Totals};
use skysink_common::nodes::Answer;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::Sensors;
use skysink_common::told::Told;
use skysink_viewer::SlotView;

/// Runs a test with the path of a recording in a folder of its own.
pub fn in_folder<T>(test: impl FnOnce(&Path) -> T) -> T {
    let folder = tempfile::tempdir().unwrap();
    test(&folder.path().join("mission.rrd"))
}

/// The letter's mission.
pub fn letter() -> Scenario {
    Scenario::letter(Overrides::default()).unwrap()
}

/// A UAV with free altitude between 20 m and 120 m over a dense urban area.
pub fn town() -> Scenario {
    let text = "name = \"town\"\n[uav]\naltitude = \"free\"\naltitude_m = 50.0\nmin_altitude_m = 20.0\n\
                max_altitude_m = 120.0\n[link]\nmodel = \"probabilistic-los\"\nenvironment = \"dense-urban\"\n";
    Scenario::parse(text, Path::new("town.toml"), Overrides::default()).unwrap()
}

/// Sensor nodes on a line, with buffers of 1 000 bits.
pub fn sensors(count: u32) -> Arc<Sensors> {
    let sensor = |id| SensorNode {
        x_m: f64::from(id % 100),
        y_m: 50.0,
        gain: 1e-5,
        sampling_bps: 100.0,
        capacity_bits: 1_000,
        ..SensorNode::default()
    };
    let nodes: Vec<SensorNode> = (0..count).map(sensor).collect();
    Arc::new(Sensors::of(&letter(), &nodes))
}

/// The existing files of a recording, in the order of their creation.
pub fn files(first: &Path) -> Vec<PathBuf> {
    let stem = first.file_stem().unwrap().to_str().unwrap();
    let later = (2..).map(|number| first.with_file_name(format!("{stem}-{number}.rrd")));
    std::iter::once(first.to_owned()).chain(later).take_while(|path| path.exists()).collect()
}

/// All data of one slot.
pub struct Slot {
    pub slot: u64,
    pub queues_bits: Vec<u32>,
    pub answers: Vec<Answer>,
    pub header: QueuesHeader,
    pub plan: Option<Plan>,
    pub path: Vec<PathPoint>,
    pub flight: FlightReport,
}

impl Slot {
    /// Slot `slot` of a UAV that flies east by 1 m and serves the sensor node below it; slot 0 has no plan.
    pub fn new(slot: u64, count: usize) -> Self {
        let x_m = slot as f64;
        let queue_bits = u32::try_from(slot % 10 * 100).unwrap();
        let mut plan = Plan::fly_to([x_m, 50.0, 20.0], Mode::Serve);
        plan.circles_m = std::array::from_fn(|circle| [x_m + circle as f64, 50.0]);
        plan.chosen = 2;
        let mut flight = FlightReport::at([x_m, 50.0, 20.0], Mode::Serve);
        if slot > 0 {
            flight.served = 1;
            let link = &mut flight.links[0];
            *link = LinkReport { sensor: u32::try_from(slot).unwrap(), rate_bps: 6e7, ..LinkReport::default() };
        }
        let totals = Totals { sampled_bits: 1_000 * slot, lost_bits: slot * slot, ..Totals::default() };
        let header = QueuesHeader { totals, delivered_bits: 10 * slot, ..QueuesHeader::default() };
        Self {
            slot,
            queues_bits: vec![queue_bits; count],
            answers: Vec::new(),
            header,
            plan: (slot > 0).then_some(plan),
            path: Vec::new(),
            flight,
        }
    }

    /// The slot as input of a scene, without wall-clock times.
    pub fn view(&self) -> SlotView<'_> {
        SlotView {
            slot: self.slot,
            told: Told::new(&self.queues_bits, &self.answers),
            header: &self.header,
            plans: std::slice::from_ref(&self.plan),
            paths: &self.path,
            flights: std::slice::from_ref(&self.flight),
            heard: &[],
            features: None,
            slots_per_s: None,
            plan_ms: None,
        }
    }
}

/// One component of one row: entity, component, slot (none if static), simulated time [ns].
pub type Cell = (String, String, Option<i64>, Option<i64>);

/// The content of a recording.
#[derive(Debug, Default, PartialEq)]
pub struct Found {
    /// Every value, written out.
    pub cells: BTreeMap<Cell, Vec<String>>,
    /// The bytes of images: entity, component and slot.
    pub images: BTreeMap<(String, String, i64), Vec<u8>>,
    /// Every timeline.
    pub timelines: BTreeSet<String>,
    /// The same of the layout.
    pub layout: BTreeMap<Cell, Vec<String>>,
}

impl Found {
    /// Reads a recording, with or without its footer.
    pub fn read(path: &Path) -> Self {
        Self::try_read(path).expect("a recording")
    }

    /// The same of a file that is still being written; `None` in mid-message.
    pub fn try_read(path: &Path) -> Option<Self> {
        let mut config = ChunkStoreConfig::DEFAULT;
        config.enable_changelog = false;
        let mut found = Self::default();
        let stores = ChunkStore::from_rrd_reader(&config, &mut std::fs::File::open(path).ok()?).ok()?;
        for (id, store) in stores {
            for chunk in store.iter_physical_chunks() {
                if id.is_recording() {
                    found.timelines.extend(chunk.timelines().keys().map(ToString::to_string));
                    add(&mut found.cells, chunk);
                    add_images(&mut found.images, chunk);
                } else {
                    add(&mut found.layout, chunk);
                }
            }
        }
        Some(found)
    }

    /// The cells that have a slot, without the event log.
    pub fn shown(&self) -> BTreeMap<&Cell, &Vec<String>> {
        self.cells.iter().filter(|((entity, _, slot, _), _)| slot.is_some() && entity != "/log/events").collect()
    }

    /// Every line of the event log.
    pub fn log(&self) -> String {
        let lines = self
            .cells
            .iter()
            .filter(|((entity, component, ..), _)| entity == "/log/events" && component == "TextLog:text");
        lines.map(|(_, texts)| texts.concat()).collect()
    }

    /// Slots in which an entity was logged.
    pub fn slots_of(&self, entity: &str) -> BTreeSet<i64> {
        let entity = format!("/{entity}");
        self.cells.keys().filter(|(name, ..)| *name == entity).filter_map(|(_, _, slot, _)| *slot).collect()
    }

    /// Slots in which a component of an entity was logged.
    pub fn slots_of_component(&self, entity: &str, component: &str) -> BTreeSet<i64> {
        let is_it = |cell: &&Cell| cell.0 == format!("/{entity}") && cell.1 == component;
        self.cells.keys().filter(is_it).filter_map(|(_, _, slot, _)| *slot).collect()
    }

    /// The latest value of an entity's component in a slot, as text.
    pub fn shown_in(&self, entity: &str, component: &str, slot: i64) -> String {
        let logged = self.slots_of_component(entity, component);
        let last = logged.range(..=slot).next_back();
        last.map_or_else(String::new, |&last| self.text(entity, component, Some(last)))
    }

    /// The value of an entity's component logged in a slot, or statically, as text; empty if there is none.
    pub fn text(&self, entity: &str, component: &str, slot: Option<i64>) -> String {
        let is_it = |cell: &Cell| cell.0 == format!("/{entity}") && cell.1 == component && cell.2 == slot;
        self.cells.iter().filter(|(cell, _)| is_it(cell)).flat_map(|(_, values)| values.clone()).collect()
    }

    /// The bytes of an image, which are too many to be written out.
    pub fn bytes(&self, entity: &str, component: &str, slot: i64) -> &[u8] {
        &self.images[&(format!("/{entity}"), component.to_owned(), slot)]
    }

    /// The number of a curve, by slot.
    pub fn curve(&self, entity: &str) -> BTreeMap<i64, f64> {
        self.points(entity).into_iter().map(|(slot, points)| (slot, points[0])).collect()
    }

    /// The numbers of a curve of several points, by slot.
    pub fn points(&self, entity: &str) -> BTreeMap<i64, Vec<f64>> {
        let numbers = |values: &[String]| -> Vec<f64> {
            let text = values.concat();
            let lines = text.lines().map(|line| line.trim_matches([' ', ',']));
            lines.filter_map(|line| line.parse().ok()).collect()
        };
        let points = self
            .cells
            .iter()
            .filter(|((name, component, ..), _)| *name == format!("/{entity}") && component == "Scalars:scalars");
        points.filter_map(|((_, _, slot, _), values)| Some(((*slot)?, numbers(values)))).collect()
    }
}

fn add(cells: &mut BTreeMap<Cell, Vec<String>>, chunk: &re_sdk::log::Chunk) {
    let times = |timeline: &str| chunk.timelines().get(&TimelineName::try_new(timeline).unwrap());
    let slots = times("slot");
    let times_ns = times("sim_time");
    for component in chunk.components_identifiers() {
        let values = chunk.components().get_array(component).unwrap();
        for row in (0..chunk.num_rows()).filter(|&row| values.is_valid(row)) {
            let time = |column: Option<&TimeColumn>| column.map(|column| column.times_raw()[row]);
            let cell = (chunk.entity_path().to_string(), component.to_string(), time(slots), time(times_ns));
            cells.entry(cell).or_default().push(format!("{:?}", values.value(row)));
        }
    }
}

fn add_images(images: &mut BTreeMap<(String, String, i64), Vec<u8>>, chunk: &re_sdk::log::Chunk) {
    let slot = re_sdk::TimelineName::try_new("slot").unwrap();
    let buffer = re_sdk_types::archetypes::SegmentationImage::descriptor_buffer().component;
    let buffers = chunk.iter_slices::<&[u8]>(buffer);
    for ((time, _), bytes) in chunk.iter_component_indices(slot, buffer).zip(buffers) {
        let place = (chunk.entity_path().to_string(), buffer.to_string(), time.as_i64());
        images.insert(place, bytes[0].to_vec());
    }
}
