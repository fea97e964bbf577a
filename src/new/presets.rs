//! A radio and a drone of a new scenario, by name, and slots that suit both (decisions D31, D38 and D40).

use clap::Args;
use clap::builder::PossibleValuesParser;
use skysink_common::channel::{Channel, ChannelModel};
use skysink_common::error::InputError;
use skysink_common::presets::{drones, radios};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

/// Column of the comments.
const COMMENT_COLUMN: usize = 34;

/// Longest flight and longest communication in a slot [s].
const MOST_S: f64 = 10.0;

/// Fraction of the endurance that slots take; the rest is for take-off, landing and the way home.
const FLOWN: f64 = 0.85;

/// Time that ArduCopter takes for a leg beyond that of its acceleration, for its jerk of 1 m/s³ [s].
const JERK_S: f64 = 3.0;

/// Altitude of a new scenario with a drone [m].
const ALTITUDE_M: f64 = 30.0;

/// Keys of the paper's radio, which another one replaces.
const OF_PAPERS_RADIO: [&str; 7] = [
    "link.bandwidth_hz",
    "link.tx_power_w",
    "link.noise_dbm",
    "link.gain_db",
    "link.gain",
    "link.comm_radius_m",
    "link.resource_blocks",
];

/// The head of the file.
const HEADER: &str = "\
# A mission for Skysink. Next:
#   skysink check FILE                        prints every key, figures and warnings
#   skysink simulate FILE --out runs/NAME     simulates it
#   skysink compare FILE horizon tour         compares strategies
#   skysink export runs/NAME --format qgc-plan    writes a plan for a ground station;
#     --origin LAT,LON --north true says where the corner of a list in metres is,
#     whose y is true north
#
# Assumed; change what differs. A measured map of the links is better than a radio by
# name, and published models of the power of flight differ by 25 % and more.
# - Links: a margin of 15 dB, no shadowing; each contact begins with link.setup_s.
# - Flight: no wind and no payload; 20 % of the battery remain.
# - A slot is a leg from rest to rest, then the communication.
# - 15 % of the endurance are for take-off, landing and the way home, and a slot takes
#   its time, once more comm_s, and 3 s of an autopilot's smooth acceleration.
# - Buffers and sampling rates are the paper's (arXiv 2103.00753), where the sensor
#   list has none.
";

/// The head of the file of a plan.
#[cfg(feature = "lab")]
const PLAN_HEADER: &str = "\
# The flight of a plan for Skysink. Next:
#   skysink check FILE                      prints keys, figures and warnings
#   skysink simulate FILE --out runs/NAME   simulates it: what this flight loses
#   skysink optimize FILE                   and what no flight would lose
#
# Assumed; change what differs.
# - The flight begins above home, at its altitude. Corners take no time.
# - link.comm_s of each slot are for communication, from where the slot ends.
# - Buffers, sampling rates and, without --radio, links are the paper's (arXiv
#   2103.00753), where the sensor list has none.
";

/// Radio and drone of a new scenario.
#[derive(Debug, Clone, Default, Args)]
pub struct Hardware {
    /// Radio of the sensor nodes, by name: link.preset.
    #[arg(long, value_name = "RADIO", value_parser = PossibleValuesParser::new(radios::NAMES))]
    radio: Option<String>,
    /// Drone, by name: uav.preset; several for a fleet of them, [[uav.each]].
    #[arg(long, value_name = "DRONE", value_parser = PossibleValuesParser::new(drones::NAMES))]
    drone: Vec<String>,
    /// UAVs of each drone, in their order: one number for all, or one for each, such as 2,1.
    #[arg(long, value_name = "N,...", requires = "drone", value_delimiter = ',')]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=64))]
    count: Vec<u32>,
}

impl Hardware {
    /// The names of radio and drone.
    #[cfg(feature = "lab")]
    pub fn names(&self) -> [Option<&str>; 2] {
        [self.radio.as_deref(), self.drone.first().map(String::as_str)]
    }
}

/// Lines of a scenario file instead of those of the keys, by their dotted names.
#[derive(Default)]
pub struct Lines {
    lines: Vec<(&'static str, String)>,
    /// The tables of `[[uav.each]]`.
    each: String,
    is_of_hardware: bool,
    #[cfg(feature = "lab")]
    is_of_plan: bool,
}

impl Lines {
    /// The lines instead of that of the dotted `key`; `None` if it stays.
    pub fn instead_of(&self, key: &str) -> Option<&str> {
        self.lines.iter().rfind(|(name, _)| *name == key).map(|(_, line)| &**line)
    }

    /// The tables of `[[uav.each]]`; empty for equal UAVs.
    pub fn each(&self) -> &str {
        &self.each
    }

    /// The head of the file; `None` for that of a scenario without radio and drone.
    pub fn header(&self) -> Option<&'static str> {
        #[cfg(feature = "lab")]
        if self.is_of_plan {
            return Some(PLAN_HEADER);
        }
        self.is_of_hardware.then_some(HEADER)
    }

    /// Leaves out the lines of these keys.
    #[cfg(feature = "lab")]
    pub fn omit(&mut self, keys: &[&'static str]) {
        self.lines.extend(keys.iter().map(|key| (*key, String::new())));
    }

    /// Sets the head of the file to that of a plan, and a strategy that schedules well on its flight.
    #[cfg(feature = "lab")]
    pub fn set_plan(&mut self) {
        self.is_of_plan = true;
        self.set_strategy();
    }

    fn set_strategy(&mut self) {
        let comment = "Strategy, one of those in skysink simulate --help";
        self.set("planner.strategy", "strategy = \"horizon\"", comment);
    }

    pub(super) fn set(&mut self, key: &'static str, setting: &str, comment: &str) {
        self.lines.push((key, commented(setting, comment)));
    }
}

impl Hardware {
    /// Whether a radio or a drone is named.
    pub fn is_named(&self) -> bool {
        self.radio.is_some() || !self.drone.is_empty()
    }

    /// Checks that there is a number of UAVs for each drone, if there are several.
    pub fn check(&self) -> Result<(), InputError> {
        let [drones, counts] = [self.drone.len(), self.count.len()];
        let list = self.count.iter().map(u32::to_string).collect::<Vec<_>>().join(",");
        let expected = format!("expected one number, or one for each of the {drones} drones");
        if counts <= 1 || counts == drones { Ok(()) } else { Err(InputError::of_argument("--count", &list, expected)) }
    }

    /// The drones, with the number of UAVs of each.
    fn drones(&self) -> impl Iterator<Item = (&str, u32)> {
        let count = |drone: usize| self.count.get(drone).or(self.count.first()).copied().unwrap_or(1);
        self.drone.iter().enumerate().map(move |(index, drone)| (drone.as_str(), count(index)))
    }

    /// The lines of the names, without those of the keys that follow from them.
    pub fn lines(&self) -> Lines {
        let mut lines = Lines { is_of_hardware: self.is_named(), ..Lines::default() };
        if let Some(radio) = &self.radio {
            lines.lines.extend(OF_PAPERS_RADIO.map(|key| (key, String::new())));
            lines.set(
                "link.model",
                &format!("preset = \"{radio}\""),
                "rates, range, n and setup_s; keys beside it have priority",
            );
            // Any that hold a contact: those of the mission follow.
            lines.set("slots", "slots = 1", "");
            lines.set("slot_s", &format!("slot_s = {:?}", 2.0 * MOST_S), "");
            lines.set("link.comm_s", &format!("comm_s = {MOST_S:?}"), "");
        }
        if !self.drone.is_empty() {
            let mut drones = self.drones().map(|(drone, count)| of_drone(drone, count));
            let first = drones.next().unwrap_or_default();
            let others: Vec<String> = drones.collect();
            if others.is_empty() {
                lines.lines.push(("uav.altitude", first));
            } else {
                lines.lines.push(("uav.altitude", String::new()));
                let tables = std::iter::once(first).chain(others).map(|drone| format!("\n[[uav.each]]\n{drone}"));
                lines.each = tables.collect();
            }
            lines.set("uav.altitude_m", &format!("altitude_m = {ALTITUDE_M:?}"), "Altitude, H [m]");
            lines.lines.push(("uav.max_speed_mps", String::new()));
            lines.set("uav.endurance_s", "must_land = true", "in the base, which is where it starts");
        }
        if self.is_named() {
            lines.set_strategy();
        }
        lines
    }

    /// These lines, and those of slots for the radio and the drone in `draft`, with the SNs `list`.
    ///
    /// A slot has the time of a leg over the communication radius (decision D31), and that to set up a contact and send
    /// a full buffer from there, each at most [`MOST_S`]. An exported plan flies the slot and then holds for the
    /// communication, so that a slot takes both from the endurance, and [`JERK_S`].
    pub fn lines_with_slots(&self, draft: &Scenario, list: &SensorList) -> Lines {
        let mut lines = self.lines();
        if !self.is_named() {
            return lines;
        }
        let radius_m = draft.link.comm_radius_m;
        let channel = Channel::of(&draft.link);
        let nodes = list.nodes();
        let gain = nodes.iter().map(|node| node.gain).fold(f64::INFINITY, f64::min);
        let rate_bps = channel.expected_rate_bps(&channel.uplink_at(gain, radius_m * radius_m, draft.uav.altitude_m));
        let buffer_bits = nodes.iter().map(|node| node.capacity_bits).max().unwrap_or(0);
        let whole_s = |time_s: f64| time_s.ceil().clamp(1.0, MOST_S);
        let comm_s = whole_s(draft.link.setup_s.unwrap_or(0.0) + f64::from(buffer_bits) / rate_bps);
        // Those of the slowest drone, and of the one that flies least.
        let leg_s = whole_s(draft.kinds().map(|kind| kind.leg_s(radius_m)).fold(0.0, f64::max));
        let endurance_s = draft.uav_kinds().map(|uav| uav.endurance_s).fold(f64::INFINITY, f64::min);
        let slot_s = leg_s + comm_s;
        let slots = (FLOWN * endurance_s / (slot_s + comm_s + JERK_S)).floor().max(1.0);
        lines.set("slots", &format!("slots = {slots}"), "Number of slots, T");
        lines.set(
            "slot_s",
            &format!("slot_s = {slot_s:?}"),
            &format!("A leg of {leg_s} s and comm_s; plans may fly all of it"),
        );
        lines.set("link.comm_s", &format!("comm_s = {comm_s:?}"), "Time for communication in a slot, τ_c [s]");
        if self.radio.is_some() {
            let radius = format!("# comm_radius_m = {radius_m:.1}");
            lines.set("link.comm_radius_m", &radius, &format!("at {} m, by the preset", draft.uav.altitude_m));
        }
        lines
    }
}

/// The lines of `count` UAVs of a drone.
fn of_drone(drone: &str, count: u32) -> String {
    let words = "speed, endurance, battery; keys beside it have priority";
    let preset = commented(&format!("preset = \"{drone}\""), words);
    let several = (count > 1).then(|| commented(&format!("count = {count}"), "Number of UAVs"));
    preset + &several.unwrap_or_default()
}

/// A line with a comment.
pub fn commented(setting: &str, comment: &str) -> String {
    format!("{setting:COMMENT_COLUMN$}# {comment}\n")
}
