//! `uts-wide`: the paper's strategy with anchors as far as the UAV can serve them.

use super::Registered;
use super::algorithm_1::Reach;
use super::uts::Uts;

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered {
    name: "uts-wide",
    about: "Algorithm 1 with anchors as far as the UAV can serve them, then the best waypoint",
    is_stateless: true,
    has_path: false,
    keys: None,
    make: |setup| Box::new(Uts::new(Reach::Wide, setup)),
};
