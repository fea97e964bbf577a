//! A stop of a plan: sensors that are served together, and the disk from which all of them are in range.

use skysink_common::geometry::Position;

use crate::geometry::circle::Circle;
use crate::geometry::disks::Disk;
use crate::mission_table::MissionTable;

/// Slack of the range of a disk about a given centre, relative to `d_c`: that of decision D5, and rounding.
const WIDENED: f64 = 1e-8;

/// Sensors that are served together from any point of a disk.
#[derive(Debug, Clone, PartialEq)]
pub struct ServiceDisk {
    /// The points from which all members are in range. About their smallest enclosing circle of radius R, its radius is
    /// `d_c − R` [m].
    pub disk: Disk,
    /// The sensors by their numbers in the model, at most n.
    pub members: Vec<u32>,
}

impl ServiceDisk {
    /// The disk about the smallest circle around `members`.
    #[must_use]
    pub fn around(table: &MissionTable, members: Vec<u32>) -> Self {
        let points: Vec<Position> = members.iter().map(|&member| *table.sensors.position(member)).collect();
        let circle = Circle::around(&points);
        let radius_m = (table.limits.comm_radius_m - circle.radius_m2.sqrt()).max(0.0);
        Self { disk: Disk { centre: circle.centre, radius_m }, members }
    }

    /// The disk about `centre`; `None` unless `members` are 1 to n sensors of `table`, ascending, all in range of it.
    #[must_use]
    pub fn at(table: &MissionTable, centre: Position, members: Vec<u32>) -> Option<Self> {
        let away_m =
            members.iter().map(|&member| Some((table.sensors.positions.get(member as usize)? - centre).norm()));
        let farthest_m = away_m.collect::<Option<Vec<f64>>>()?.into_iter().fold(0.0, f64::max);
        let is_set = (1..=table.limits.blocks()).contains(&members.len()) && members.is_sorted_by(|a, b| a < b);
        let radius_m = (table.limits.comm_radius_m - farthest_m).max(0.0);
        let is_in_range = farthest_m <= table.limits.comm_radius_m * (1.0 + WIDENED);
        (is_set && is_in_range).then_some(Self { disk: Disk { centre, radius_m }, members })
    }
}
