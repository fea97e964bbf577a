//! The ledger and the flight of a run, checked slot by slot from its folder, whichever planner it had.

use skysink_common::channel::{Channel, ChannelModel, Uplink};
use skysink_common::geometry::{Position, distance_squared, within};
use skysink_common::scenario::Overrides;
use skysink_common::sensors::SensorList;

use crate::support::{Place, scenarios};

/// A line of `slots.csv`.
#[derive(Debug)]
pub struct TraceLine {
    pub slot: u64,
    pub position: Position,
    pub scheduled: Vec<u32>,
    pub delivered_bits: u64,
    pub lost_bits: u64,
    pub queued_bits: u64,
    pub mode: String,
    pub refused: u64,
}

/// The lines of the run in `place`.
pub fn trace(place: &Place) -> Vec<TraceLine> {
    place.trace("run").lines().skip(1).map(line).collect()
}

fn line(text: &str) -> TraceLine {
    let column: Vec<_> = text.split(',').collect();
    let bits = |i: usize| column[i].parse().unwrap();
    TraceLine {
        slot: bits(0),
        position: Position::new(column[2].parse().unwrap(), column[3].parse().unwrap()),
        scheduled: column[5].split_terminator(' ').map(|id| id.parse().unwrap()).collect(),
        delivered_bits: bits(6),
        lost_bits: bits(7),
        queued_bits: bits(8),
        mode: column[9].to_owned(),
        refused: bits(10),
    }
}

/// Fails unless every bit is accounted for, and the UAV flew and served as its scenario allows. All sensor nodes sample
/// the same whole number of bits a slot. Returns the trace.
pub fn audit(place: &Place) -> Vec<TraceLine> {
    let scenario = scenarios::read(&place.path("run/scenario.toml"), Overrides::default());
    let list = SensorList::of(&scenario).unwrap();
    let nodes = list.nodes();
    let sampled_bits = nodes.iter().map(|node| (node.sampling_bps * scenario.slot_s) as u64).sum::<u64>();
    let channel = Channel::of(&scenario.link);
    let lines = trace(place);
    let mut queued_bits: u64 = list.queues_bits().iter().map(|&bits| u64::from(bits)).sum();
    let mut position = scenario.start().xy();
    for (line, slot) in lines.iter().zip(1..) {
        assert_eq!(line.slot, slot);
        assert_eq!(queued_bits + sampled_bits, line.delivered_bits + line.lost_bits + line.queued_bits, "{line:?}");
        assert!(within(&position, &line.position, scenario.reach_m()), "from {position} to {line:?}");
        assert!(scenario.area.contains(&line.position, 1e-9 * scenario.area.width_m()), "{line:?}");
        assert!(line.scheduled.len() <= scenario.link.resource_blocks, "{line:?}");
        assert!(line.scheduled.is_sorted_by(|a, b| a < b), "{line:?}");
        let mut most_bits = 0;
        for &id in &line.scheduled {
            let node = &nodes[id as usize];
            let at = Position::new(node.x_m, node.y_m);
            let radius_m = scenario.link.comm_radius_m;
            assert!(within(&line.position, &at, radius_m), "SN {id} is out of range: {line:?}");
            let d2_m2 = distance_squared(&line.position, &at);
            let uplink = Uplink::at(node.gain, d2_m2, scenario.uav.altitude_m);
            most_bits += channel.capacity_bits(channel.expected_rate_bps(&uplink));
        }
        assert!(line.delivered_bits <= most_bits, "at most {most_bits}: {line:?}");
        if line.mode == "hold" {
            assert_eq!((line.scheduled.len(), line.delivered_bits), (0, 0), "{line:?}");
        }
        (queued_bits, position) = (line.queued_bits, line.position);
    }
    lines
}

/// The lines on standard error about refusals of a kind.
pub fn said(stderr: &str, refusal: &str) -> Vec<String> {
    stderr.lines().filter(|line| line.contains("refused:") && line.contains(refusal)).map(str::to_owned).collect()
}
