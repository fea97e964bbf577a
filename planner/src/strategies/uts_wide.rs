//! `uts-wide`: `uts` with a wider search: Algorithm 1 over all sensor nodes that the UAV can serve in the slot.
//!
//! Anchors are the sensor nodes within `V τ + d_c` of the UAV instead of `V τ − d_c`, and circles count only if their
//! centre is in reach.

use super::algorithm_1::Reach;
use super::uts::uts;
use crate::strategy::Registered;

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("uts-wide", "uts with all sensor nodes that can be served as anchors of Algorithm 1", |setup| {
        uts(Reach::Wide, setup)
    });
