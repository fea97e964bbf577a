//! `max-age-first`: the maximum age first (MAF) policy.
//!
//! The age of a sensor node (SN) is the time since it was scheduled last. The UAV flies toward the oldest SN,
//! and serves the n oldest in range.

use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};

use crate::serving::Serving;
use crate::serving::nearby::fullest_first;
use crate::strategy::{Decision, Registered, Strategy, View};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("max-age-first", "maximum age first: fly to the sensor node served longest ago", |setup| {
        Box::new(MaxAgeFirst { last: vec![0; setup.table.sensors.count()], serving: Serving::new(setup) })
    })
    .with_state()
    .without_weights();

struct MaxAgeFirst {
    /// Slot in which each SN was scheduled last, 0 before the first, by id.
    last: Vec<u32>,
    serving: Serving,
}

impl Strategy for MaxAgeFirst {
    /// Straight toward the oldest SN, until above it; serves the n oldest in range. Never `None`.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let Self { last, serving } = self;
        // Ties go to the fullest, then to the lowest index.
        let oldest_first = |id: u32| (last[id as usize], fullest_first(view.value(id), id));
        let ground = view.ground();
        let oldest = view.servable().min_by_key(|&id| oldest_first(id));
        let waypoint =
            oldest.map_or(ground, |oldest| view.table.motion.toward(&ground, view.table.sensors.position(oldest)));
        let decision = serving.serve_by(view, &waypoint, oldest_first);
        let slot = u32::try_from(view.slot).unwrap_or(u32::MAX);
        decision.schedule.iter().for_each(|&id| last[id as usize] = slot);
        Some(decision)
    }
}

impl Checkpoint for MaxAgeFirst {
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&self.last, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let last: Vec<u32> = decode(bytes)?;
        CheckpointError::ensure(last.len() == self.last.len(), "a slot for each sensor node")?;
        self.last = last;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::strategies::tests::made;
    use crate::strategy::tests::view;

    #[test]
    fn the_oldest_sensor_node_is_the_target_and_served_first() {
        let positions = [[50.0, 50.0], [51.0, 50.0], [52.0, 50.0], [53.0, 50.0], [54.0, 50.0], [50.0, 75.0]];
        let (table, mut oldest_first) = made("max-age-first", &positions);
        let mut plan = |slot, ground| {
            let decision = oldest_first.plan(&view(&table, slot, ground, &[5, 9, 5, 5, 5, 8])).unwrap();
            (decision.waypoint.xy().into(), decision.schedule.to_vec())
        };
        assert_eq!(
            plan(1, [50.0, 50.0]),
            ([51.0, 50.0], vec![0, 1, 2, 3]),
            "of equals the fullest, then the lowest index"
        );
        assert_eq!(plan(2, [51.0, 50.0]), ([50.0, 75.0], vec![5]), "SNs 4 and 5 were never served");
        assert_eq!(plan(3, [54.0, 51.0]), ([54.0, 50.0], vec![0, 1, 2, 4]), "SN 4 and those of slot 1, not SN 3");
    }

    #[test]
    fn a_checkpoint_of_another_field_is_refused() {
        let (_, mut oldest_first) = made("max-age-first", &[[50.0, 90.0], [90.0, 90.0]]);
        let mut bytes = Vec::new();
        made("max-age-first", &[[50.0, 90.0]; 3]).1.save(&mut bytes);
        assert_eq!(
            oldest_first.restore(&bytes).unwrap_err().to_string(),
            "checkpoint: expected a slot for each sensor node"
        );
    }
}
