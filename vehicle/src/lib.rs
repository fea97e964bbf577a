//! A bridge to vehicles that speak MAVLink, in the place of flight-sim.
//!
//! [`table`] decides, [`control`] and [`bridge`] lead to it what vehicles say, [`link`], [`codec`] and [`wire`] know
//! MAVLink, [`node`] knows iceoryx2.

pub mod apart;
pub mod autopilot;
pub mod belief;
pub mod bridge;
pub mod clock;
pub mod codec;
pub mod control;
pub mod frame;
pub mod identity;
pub mod jumps;
pub mod latency;
pub mod link;
pub mod node;
pub mod outbox;
pub mod preflight;
pub mod said;
pub mod saved;
pub mod state;
pub mod table;
pub mod telemetry;
pub mod wire;
