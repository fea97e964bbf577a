//! The registry of the features of sensor nodes (SNs): properties that a mission may have or not.
//!
//! A feature is a file of this folder, with what it does ([`NodeModel`]) and what a mission says of it ([`Declared`]),
//! a line of the list in this file, and its keys, those of `[sensors]` in [`keys`]. The ledger, the list and planners
//! ask the registry.

pub mod arrivals;
pub mod duty;
pub mod energy;
pub mod expiry;
pub mod keys;
pub mod ledger;
mod model;
pub mod queues;
mod row;
pub mod sampling;
pub mod weights;

use std::ops::Range;

use enum_dispatch::enum_dispatch;
use smallvec::SmallVec;

pub use duty::Airtime;
pub use energy::Charges;
pub use expiry::Cohorts;
pub use keys::{NodeKeys, SensorKeys};
pub use model::{Answer, NodeModel, NodeService, SlotEnd};
pub use row::{Declared, NodeColumn, NodeFile, NodeRefusal, NodeSetup, NodeTraits};

use crate::checkpoint::CheckpointError;
use crate::error::InputError;
use crate::keys::Rule;
use crate::per_sensor::PerSensor;

/// A feature that is a variant of [`NodeFeature`].
pub trait FeatureKind: Declared {
    /// The feature, if it is of this kind.
    fn of(feature: &NodeFeature) -> Option<&Self>;
}

/// Declares the list of features.
macro_rules! features {
    ($($(#[$words:meta])* $kind:ident,)*) => {
        /// A feature of the SNs of a mission.
        #[enum_dispatch(NodeModel)]
        #[derive(Debug, Clone, PartialEq)]
        #[expect(clippy::large_enum_variant, reason = "a mission has a box for each")]
        pub enum NodeFeature {
            $($(#[$words])* $kind($kind),)*
        }

        /// All features, in the order in which they save their states.
        pub const NODE_ROWS: [NodeRow; [$(stringify!($kind)),*].len()] = [$(NodeRow::of::<$kind>()),*];

        $(impl FeatureKind for $kind {
            fn of(feature: &NodeFeature) -> Option<&Self> {
                if let NodeFeature::$kind(own) = feature { Some(own) } else { None }
            }
        })*
    };
}

features! {
    /// Batteries.
    Charges,
    /// What a duty cycle leaves.
    Airtime,
    /// Bits that expire.
    Cohorts,
}

/// What a mission says of a feature ([`Declared`]).
#[derive(Debug, Clone, Copy)]
pub struct NodeRow {
    /// Its key.
    pub key: &'static str,
    /// Its columns of the sensor list.
    pub columns: &'static [NodeColumn],
    /// Its file.
    pub file: Option<NodeFile>,
    /// What strategies do not plan for.
    pub unplanned: Option<&'static str>,
    /// What follows from it.
    pub traits: fn(&NodeKeys<'_>) -> Option<NodeTraits>,
    /// Checks its keys.
    pub check: fn(&NodeKeys<'_>, Rule<'_>) -> Result<(), InputError>,
    /// The key that a mission with so many SNs cannot have.
    pub refusal: fn(&NodeKeys<'_>, usize) -> Option<NodeRefusal>,
    /// The feature before slot 1.
    pub make: fn(&NodeSetup<'_>) -> Option<NodeFeature>,
}

impl NodeRow {
    const fn of<F: Declared>() -> Self
    where
        NodeFeature: From<F>,
    {
        Self {
            key: F::KEY,
            columns: F::COLUMNS,
            file: F::FILE,
            unplanned: F::UNPLANNED,
            traits: F::traits,
            check: F::check,
            refusal: F::refusal,
            make: |setup| F::make(setup).map(NodeFeature::from),
        }
    }
}

/// The files of all features.
pub fn files() -> impl Iterator<Item = NodeFile> {
    NODE_ROWS.into_iter().filter_map(|row| row.file)
}

/// The columns of all features.
pub fn columns() -> impl Iterator<Item = &'static NodeColumn> {
    NODE_ROWS.into_iter().flat_map(|row| row.columns)
}

impl NodeKeys<'_> {
    /// The features of a mission with these keys.
    pub fn rows(&self) -> impl Iterator<Item = NodeRow> {
        NODE_ROWS.into_iter().filter(|row| (row.traits)(self).is_some())
    }

    /// What follows from all features of the mission together.
    pub fn traits(&self) -> NodeTraits {
        NODE_ROWS.iter().filter_map(|row| (row.traits)(self)).fold(NodeTraits::default(), NodeTraits::and)
    }
}

/// The features of the SNs of a mission, in the order of [`NODE_ROWS`]; none in most missions.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NodeFeatures(SmallVec<[Box<NodeFeature>; 2]>);

impl FromIterator<NodeFeature> for NodeFeatures {
    /// # Panics
    /// If two of them store bits.
    fn from_iter<I: IntoIterator<Item = NodeFeature>>(features: I) -> Self {
        let features = Self(features.into_iter().map(Box::new).collect());
        assert!(features.iter().filter(|feature| feature.stores()).count() <= 1, "expected one feature that stores");
        features
    }
}

impl NodeFeatures {
    /// Whether the mission has none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn iter(&self) -> impl Iterator<Item = &NodeFeature> {
        self.0.iter().map(|feature| &**feature)
    }

    fn iter_mut(&mut self) -> impl Iterator<Item = &mut NodeFeature> {
        self.0.iter_mut().map(|feature| &mut **feature)
    }

    /// The feature of one kind, such as `find::<Charges>()`; `None` if the mission does not have it.
    pub fn find<F: FeatureKind>(&self) -> Option<&F> {
        self.iter().find_map(F::of)
    }

    /// Whether an SN may not answer.
    pub fn may_refuse(&self) -> bool {
        self.iter().any(NodeModel::may_refuse)
    }

    /// What SN `sensor` does when it is served in the next slot.
    pub fn answer(&self, sensor: usize) -> Answer {
        self.iter().map(|feature| feature.answer(sensor)).max().unwrap_or_default()
    }

    /// Raises the `answers` of all SNs, by id, to what they do when they are served in the next slot.
    pub fn raise(&self, answers: &mut [Answer]) {
        self.iter().for_each(|feature| feature.raise(answers));
    }

    /// What SN `sensor` has left, from 0 to 1; `None` if nothing runs out.
    pub fn level(&self, sensor: usize) -> Option<f64> {
        self.iter().find_map(|feature| feature.level(sensor))
    }

    /// The slot that has sampled the last bit that SN `sensor` has uploaded ([`NodeModel::freshest_slot`]).
    pub fn freshest_slot(&self, sensor: usize) -> Option<u64> {
        self.iter().find_map(|feature| feature.freshest_slot(sensor))
    }

    /// SN `sensor` was served, and has given this `answer`, which is not its queue.
    pub(crate) fn refuse(&mut self, sensor: usize, answer: Answer) {
        let refusing = self.iter_mut().filter(|feature| feature.answer(sensor) == answer);
        refusing.for_each(|feature| feature.refuse(sensor));
    }

    /// Bits that SN `sensor` may send in the next slot at `rate_bps` [bit/s].
    pub(crate) fn most_bits(&self, sensor: usize, rate_bps: f64) -> u64 {
        self.iter().map(|feature| feature.most_bits(sensor, rate_bps)).min().unwrap_or(u64::MAX)
    }

    pub(crate) fn serve(&mut self, service: &NodeService) {
        self.iter_mut().for_each(|feature| feature.serve(service));
    }

    /// Whether a feature stores bits in the place of the ledger.
    #[inline]
    pub(crate) fn stores(&self) -> bool {
        self.iter().any(NodeModel::stores)
    }

    /// Stores what was sampled ([`NodeModel::store`]); `None` if no feature stores.
    pub(crate) fn store(
        &mut self,
        slot: u64,
        sensors: Range<usize>,
        sampled_bits: &[u64],
        queues_bits: &mut [u32],
        capacities_bits: &PerSensor<u32>,
    ) -> Option<u64> {
        let feature = self.iter_mut().find(|feature| feature.stores())?;
        feature.store(slot, sensors, sampled_bits, queues_bits, capacities_bits)
    }

    #[inline]
    pub(crate) fn upload(&mut self, sensor: usize, bits: u32) {
        self.iter_mut().for_each(|feature| feature.upload(sensor, bits));
    }

    pub(crate) fn discard(&mut self, sensor: usize, bits: u32) {
        self.iter_mut().for_each(|feature| feature.discard(sensor, bits));
    }

    /// Ends a slot; returns the SNs that die in it, ascending.
    pub(crate) fn end_slot(&mut self, end: &SlotEnd<'_>) -> Vec<u32> {
        let mut died = Vec::new();
        self.iter_mut().for_each(|feature| feature.end_slot(end, &mut died));
        died.sort_unstable();
        died.dedup();
        died
    }

    /// Bytes that [`Self::save`] takes at most.
    pub fn most_bytes(&self) -> usize {
        self.iter().map(NodeModel::most_bytes).fold(0, usize::saturating_add)
    }

    /// Appends the states of all for a checkpoint.
    pub fn save(&self, bytes: &mut Vec<u8>) {
        self.iter().for_each(|feature| feature.save(bytes));
    }

    /// These features as they were saved in exactly these `bytes`, after `slot` and with the queues `queues_bits`
    /// [bit].
    ///
    /// # Errors
    /// If a state is impossible, or bytes are left over.
    pub fn restored(&self, slot: u64, queues_bits: &[u32], mut bytes: &[u8]) -> Result<Self, CheckpointError> {
        let mut restored = self.clone();
        restored.iter_mut().try_for_each(|feature| feature.restore(slot, queues_bits, &mut bytes))?;
        CheckpointError::ensure(bytes.is_empty(), "no bytes after the state")?;
        Ok(restored)
    }
}
