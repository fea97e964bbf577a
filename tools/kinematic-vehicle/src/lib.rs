//! A copter without dynamics of its own, for tests: it accelerates, lags, drifts in gusts, and behaves towards its
//! bridge as ArduCopter does.
//!
//! It is no proof that a real autopilot can be flown; it shows what the bridge does when one refuses, fails, or is
//! silent.

pub mod autopilot;
pub mod body;
pub mod mission;
pub mod modes;
pub mod options;
pub mod server;

pub use options::KinematicOptions;
