//! What a mission says of a feature of its sensor nodes (SNs): keys, columns of the list, a file, and what follows from
//! them before slot 1.

use std::path::PathBuf;

use super::energy::harvest::HarvestTrace;
use super::keys::{NodeKeys, SensorKeys};
use crate::error::InputError;
use crate::geometry::Position;
use crate::keys::{Accepts, Rule};

/// A column of the sensor list that has priority over a key.
#[derive(Debug, Clone, Copy)]
pub struct NodeColumn {
    /// Its name.
    pub name: &'static str,
    /// The dotted key.
    pub key: &'static str,
    /// Its numbers.
    pub accepts: Accepts,
    /// Its meaning, for the book.
    pub words: &'static str,
    /// The number of all SNs without the column; `None` if it is then required.
    pub of_keys: fn(&SensorKeys) -> Option<f64>,
}

/// A file that a key names.
#[derive(Debug, Clone, Copy)]
pub struct NodeFile {
    /// Its name in a run folder.
    pub name: &'static str,
    /// The dotted key.
    pub key: &'static str,
    /// The value of the key.
    pub of_keys: fn(&mut SensorKeys) -> Option<&mut PathBuf>,
}

/// What follows from a feature for the whole mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeTraits {
    /// Whether SNs may not answer: their [answers](super::Answer) are told beside their queues.
    pub may_refuse: bool,
    /// Whether bits of the initial queues may be lost without an overflow: a loss rate then counts them as sampled
    /// (decisions D33 and D36).
    pub loses_initial: bool,
    /// Whether SNs may stop sampling for good.
    pub may_die: bool,
    /// Whether SNs have something that runs out ([`NodeModel::level`](super::NodeModel::level)).
    pub has_level: bool,
    /// Slots in which bits are stored; infinite where they do not expire.
    pub lasting_slots: f64,
}

impl Default for NodeTraits {
    fn default() -> Self {
        Self { may_refuse: false, loses_initial: false, may_die: false, has_level: false, lasting_slots: f64::INFINITY }
    }
}

impl NodeTraits {
    /// Those of two features together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            may_refuse: self.may_refuse || other.may_refuse,
            loses_initial: self.loses_initial || other.loses_initial,
            may_die: self.may_die || other.may_die,
            has_level: self.has_level || other.has_level,
            lasting_slots: self.lasting_slots.min(other.lasting_slots),
        }
    }
}

/// The SNs of a mission before slot 1.
#[derive(Clone, Copy)]
pub struct NodeSetup<'a> {
    /// The keys.
    pub keys: NodeKeys<'a>,
    /// Initial queues [bit], by id.
    pub queues_bits: &'a [u32],
    /// Where SN `id` is.
    pub position: &'a dyn Fn(usize) -> Position,
    /// The column of this name, by id; that of the keys where the list has none.
    pub column: &'a dyn Fn(&str) -> &'a [f64],
    /// The file of the feature, if there is one.
    pub file: Option<&'a HarvestTrace>,
}

/// A value that a mission of this size cannot have.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeRefusal {
    /// The dotted key.
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// What is expected.
    pub expected: String,
}

/// What a mission says of a feature.
pub trait Declared: Sized {
    /// Its key, or the first of them; a table in brackets.
    const KEY: &'static str;

    /// Its columns of the sensor list.
    const COLUMNS: &'static [NodeColumn] = &[];

    /// Its file.
    const FILE: Option<NodeFile> = None;

    /// What strategies do not plan for, for `check`.
    const UNPLANNED: Option<&'static str> = None;

    /// What follows from it; `None` if the mission does not have it.
    fn traits(keys: &NodeKeys<'_>) -> Option<NodeTraits>;

    /// Checks the rules between its keys and others.
    ///
    /// # Errors
    /// If one does not hold.
    fn check(_keys: &NodeKeys<'_>, _rule: Rule<'_>) -> Result<(), InputError> {
        Ok(())
    }

    /// The key that a mission with `count` SNs cannot have.
    fn refusal(_keys: &NodeKeys<'_>, _count: usize) -> Option<NodeRefusal> {
        None
    }

    /// The feature before slot 1; `None` if the mission does not have it.
    fn make(setup: &NodeSetup<'_>) -> Option<Self>;
}
