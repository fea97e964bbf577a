//! Writes missions as rerun recordings: entities, curves, a state lane and events, with a layout for the rerun viewer.
//!
//! Positions, queues and rates are those that the other crates report; losses, estimated queues and probabilities of
//! line of sight are computed with `skysink-common`. This is the only crate that depends on rerun.

pub mod belief;
mod blueprint;
pub mod cameras;
mod canvas;
pub mod colour;
pub mod comparison;
pub mod curves;
pub mod energy;
pub mod events;
mod files;
pub mod geo;
pub mod heard;
mod history;
mod journal;
mod layer;
mod layers;
pub mod layout;
pub mod legend;
pub mod link_map;
pub mod links;
pub mod los;
pub mod maps;
mod names;
pub mod node;
pub mod path;
mod picture;
pub mod queues;
mod readout;
pub mod recording;
mod rhythm;
mod rrd_file;
pub mod scene;
mod shapes;
mod sizes;
mod slot;
mod status;
mod steps;
pub mod uav;
mod views;
mod zones;

pub use comparison::{ComparedMission, Comparison};
pub use files::{complete, has_footer};
pub use recording::{SceneError, Sinks};
pub use scene::Scene;
pub use slot::{SlotView, WallClock};
