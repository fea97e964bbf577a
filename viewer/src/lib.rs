//! Everything of a mission as a rerun recording: what happened in each slot becomes entities, curves, a state lane and
//! events that the rerun viewer shows without further setting up.
//!
//! It decides nothing and computes no physics: positions, queues and rates are shown as the other crates report them,
//! and what was lost, what the UAV believes and probabilities of line of sight as `skysink-common` computes them. The
//! only crate that knows rerun.

pub mod belief;
mod blueprint;
mod canvas;
pub mod colour;
pub mod comparison;
pub mod curves;
pub mod events;
mod files;
mod history;
mod journal;
pub mod layout;
pub mod legend;
pub mod links;
pub mod los;
pub mod maps;
pub mod node;
pub mod path;
mod picture;
pub mod queues;
pub mod recording;
mod rhythm;
pub mod scene;
mod shapes;
mod sizes;
mod slot;
mod status;
mod steps;
pub mod uav;

pub use comparison::{ComparedMission, Comparison};
pub use files::{complete, has_footer};
pub use recording::{SceneError, Sinks};
pub use scene::Scene;
pub use slot::{SlotView, WallClock};
