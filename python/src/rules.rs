//! What an environment sees, does and earns. How is left to `observation`, `control` and `reward`.

use pyo3::prelude::*;
use pyo3::types::PyString;

use crate::errors::refused;

/// What an environment sees, does and earns, whatever its scenario.
pub struct Rules {
    /// The number of fields; `None` for unlimited.
    pub fields: Option<u64>,
    pub observed: Observed,
    pub control: Control,
    pub reward: Reward,
    /// Turns the scenario of an episode into the one that is flown; `None` if they are the same.
    pub prepare: Option<Py<PyAny>>,
    /// Whether actions are led around zones and home as the decisions of strategies are.
    pub has_return_rule: bool,
    /// Which environment has them.
    pub kind: Kind,
}

/// An environment.
#[derive(Clone, Copy, PartialEq)]
pub enum Kind {
    /// That of one mission, which has a belief to ask for.
    One,
    /// A vector of missions of one UAV.
    Vector,
    /// Missions of several UAVs.
    Agents,
}

impl Rules {
    /// Whether contacts are kept. Where nobody asks for them, they would take memory and time.
    pub fn keeps_contacts(&self) -> bool {
        let observes = |name: &&str| self.observed.has(name);
        self.kind == Kind::One || self.reward == Reward::Age || ["ages", "nearest"].iter().any(observes)
    }
}

/// Observed quantities, by the registry's order.
pub struct Observed {
    /// Their places in the registry, ascending.
    pub kinds: Vec<usize>,
    /// Their keys, so that Python does not hash them in every step.
    pub keys: Vec<Py<PyString>>,
    /// Number of nearest sensor nodes, if they are observed or chosen.
    pub nearest: Option<usize>,
}

/// What an action is.
#[derive(Clone, Copy, PartialEq)]
pub enum Control {
    /// The displacement of the slot as a fraction of the reach.
    Displacement,
    /// The waypoint as fractions of the area.
    Waypoint,
    /// The sensor node to fly to, or one of the nearest.
    Sensor,
}

impl Control {
    pub fn named(name: &str) -> PyResult<Self> {
        match name {
            "displacement" => Ok(Self::Displacement),
            "waypoint" => Ok(Self::Waypoint),
            "sensor" => Ok(Self::Sensor),
            _ => Err(refused(format!("action = {name:?}: expected displacement, waypoint or sensor"))),
        }
    }
}

/// What the reward of a slot is.
#[derive(Clone, Copy, PartialEq)]
pub enum Reward {
    /// Minus the lost fraction of the bits that are sampled in the slot; 0 if none are.
    Lost,
    /// The same of bits times the weights of their sensor nodes.
    Weighted,
    /// Minus the mean age of the contacts [slots].
    Age,
    /// Minus the bits lost, relative to the mean of the bits sampled in a slot of the mission.
    LossFraction,
    /// Of each agent the bits delivered because of it, relative to the same.
    Difference,
}

impl Reward {
    pub fn named(name: &str, kind: Kind) -> PyResult<Self> {
        match name {
            "lost" => Ok(Self::Lost),
            "weighted" => Ok(Self::Weighted),
            "age" => Ok(Self::Age),
            "loss_fraction" => Ok(Self::LossFraction),
            "difference" if kind == Kind::Agents => Ok(Self::Difference),
            _ => {
                let expected = match kind {
                    Kind::Agents => "lost, weighted, age, loss_fraction or difference",
                    Kind::One | Kind::Vector => "lost, weighted, age or loss_fraction",
                };
                Err(refused(format!("reward = {name:?}: expected {expected}")))
            }
        }
    }
}
