//! What a recording says of the slots that are in it already, for the process that goes on with it.
//!
//! A killed process has written some entities further than others. A slot is whole if every entity that each slot has
//! is there; what is known of later ones stays, but they count as missed.

use std::collections::BTreeMap;

use rerun::log::Chunk;
use rerun::{EntityPath, Scalars, StateChange, TextLog, TimelineName};

use crate::recording::SLOT;
use crate::{curves, events};

/// What is known of the slots before.
#[derive(Debug, Default)]
pub(crate) struct History {
    /// Newest slot of each entity.
    newest: BTreeMap<EntityPath, u64>,
    /// How many slots were missed, at the slots where that number changed.
    missed_slots: BTreeMap<u64, u64>,
    /// The last state of the lane, and its slot.
    state: Option<(u64, String)>,
    /// Whether the log tells of the start.
    pub(crate) started: bool,
    /// Whether it tells of a loss.
    pub(crate) lost: bool,
    /// Messages that could not be read.
    pub(crate) spoilt: u64,
}

impl History {
    /// Takes in what one chunk tells.
    pub(crate) fn add(&mut self, chunk: &Chunk) {
        let timeline = TimelineName::try_new(SLOT).expect("the name of a timeline");
        let Some(times) = chunk.timelines().get(&timeline) else { return };
        let Some(newest) = times.times_raw().iter().copied().max() else { return };
        let (entity, newest) = (chunk.entity_path(), slot_of(newest));
        let known = self.newest.entry(entity.clone()).or_default();
        *known = newest.max(*known);
        if *entity == EntityPath::from(curves::MISSED) {
            let component = Scalars::descriptor_scalars().component;
            let counts = chunk.iter_slices::<f64>(component);
            for ((time, _), count) in chunk.iter_component_indices(timeline, component).zip(counts) {
                self.add_missed(slot_of(time.as_i64()), count.first().map_or(0, |&count| count as u64));
            }
        } else if *entity == EntityPath::from(events::LANE) {
            let component = StateChange::descriptor_state().component;
            let states = chunk.iter_slices::<String>(component);
            for ((time, _), state) in chunk.iter_component_indices(timeline, component).zip(states) {
                let slot = slot_of(time.as_i64());
                let is_newer = self.state.as_ref().is_none_or(|&(known, _)| known <= slot);
                if let Some(state) = state.first().filter(|_| is_newer) {
                    self.state = Some((slot, state.as_str().to_owned()));
                }
            }
        } else if *entity == EntityPath::from(events::LOG) {
            for text in chunk.iter_slices::<String>(TextLog::descriptor_text().component).flatten() {
                self.started |= text.as_str().starts_with(events::START);
                self.lost |= text.as_str().starts_with(events::FIRST_LOSS);
            }
        }
    }

    fn add_missed(&mut self, slot: u64, count: u64) {
        if self.missed_slots_at(slot) != count {
            self.missed_slots.insert(slot, count);
        }
    }

    /// How many slots were missed up to one.
    pub(crate) fn missed_slots_at(&self, slot: u64) -> u64 {
        self.missed_slots.range(..=slot).next_back().map_or(0, |(_, &count)| count)
    }

    /// Whether there is anything of an entity.
    pub(crate) fn has(&self, entity: &str) -> bool {
        self.newest.contains_key(&EntityPath::from(entity))
    }

    /// The last slot that all of `entities` have.
    pub(crate) fn last_whole(&self, entities: &[String]) -> Option<u64> {
        let newest = |entity: &String| self.newest.get(&EntityPath::from(entity.as_str())).copied();
        entities.iter().map(newest).min().flatten()
    }

    /// The last slot of which anything is shown; lines of the log stand for themselves.
    pub(crate) fn last_seen(&self) -> Option<u64> {
        let log = EntityPath::from(events::LOG);
        self.newest.iter().filter(|&(entity, _)| *entity != log).map(|(_, &newest)| newest).max()
    }

    /// The last state of the lane.
    pub(crate) fn state(&self) -> Option<&str> {
        self.state.as_ref().map(|(_, state)| state.as_str())
    }
}

/// Slots are never negative.
fn slot_of(time: i64) -> u64 {
    u64::try_from(time).unwrap_or(0)
}
