//! The UAVs of a fleet that differ, by the tables of `[[uav.each]]`.

use std::sync::Arc;

use serde::Serialize;
use toml::{Table, Value};

use super::uav::UavKeys;
use crate::keys::{OwnKeys, dotted};

/// The resource blocks of a UAV, in `[link]` where they are those of all.
pub(super) const BLOCKS: &str = "link.resource_blocks";

/// The UAVs of a table of `[[uav.each]]`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct UavKind {
    /// `[uav]` with its own keys over it, and with the starts of its UAVs.
    pub uav: UavKeys,
    pub resource_blocks: usize,
    pub own: Arc<OwnKeys>,
}

/// A fleet whose UAVs differ.
#[derive(Debug, Clone, PartialEq)]
pub struct MixedFleet {
    /// `[uav]` as it is written: with all defaults, and the tables of `[[uav.each]]`.
    pub(super) uav: Table,
    pub(super) resource_blocks: Option<Value>,
    pub(super) kinds: Vec<UavKind>,
}

impl MixedFleet {
    /// The tables of `[[uav.each]]`, with the keys of their presets.
    pub fn tables(&self) -> Vec<Table> {
        let each = self.uav.get("each").and_then(Value::as_array).into_iter().flatten();
        each.filter_map(Value::as_table).cloned().collect()
    }

    /// Takes down where UAVs start that have no start of their own [m].
    pub(super) fn start_at(&mut self, start_m: [f64; 2]) {
        dotted::insert_missing(&mut self.uav, "start_m", Value::Array(start_m.map(Value::Float).to_vec()));
    }

    /// The fleet without presets, whose keys it has.
    pub(super) fn without_presets(&self) -> Self {
        let mut plain = self.clone();
        plain.uav.remove("preset");
        let each = plain.uav.get_mut("each").and_then(Value::as_array_mut).into_iter().flatten();
        each.filter_map(Value::as_table_mut).for_each(|own| drop(own.remove("preset")));
        plain
    }

    /// The table of `scenario`, whose UAVs are these.
    ///
    /// # Panics
    /// Never: a scenario consists of tables of numbers and strings.
    pub(super) fn table(&self, scenario: &impl Serialize) -> Table {
        let mut table = Table::try_from(scenario).expect("a scenario consists of tables of numbers and strings");
        table.insert("uav".to_owned(), Value::Table(self.uav.clone()));
        if let (Some(value), Some(blocks)) = (dotted::value_mut(&mut table, BLOCKS), &self.resource_blocks) {
            *value = blocks.clone();
        }
        table
    }

    /// The kind of the UAV number `uav`, and its number among those of the kind.
    pub(super) fn kind_of(&self, uav: usize) -> (usize, usize) {
        let mut number = uav;
        for (index, kind) in self.kinds.iter().enumerate() {
            if number < kind.uav.uavs() {
                return (index, number);
            }
            number -= kind.uav.uavs();
        }
        (self.kinds.len() - 1, number)
    }
}
