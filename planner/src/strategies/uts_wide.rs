//! `uts-wide`: `uts` with a wider search: Algorithm 1 over all sensor nodes that the UAV can serve in the slot.
//!
//! Anchors are the sensor nodes within `V τ + d_c` of the UAV instead of `V τ − d_c`, and circles count only if their
//! centre is in reach.

use super::algorithm_1::Reach;
use super::uts::Uts;
use crate::strategy::Registered;

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered {
    name: "uts-wide",
    about: "uts with all sensor nodes that can be served as anchors of Algorithm 1",
    is_stateless: true,
    has_path: false,
    keys: None,
    make: |setup| Box::new(Uts::new(Reach::Wide, setup)),
};
