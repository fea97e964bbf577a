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
    /// Whether contacts are kept. Where nobody asks for them, they would take memory and time.
    pub keeps_contacts: bool,
    /// Turns the scenario of an episode into the one that is flown; `None` if they are the same.
    pub prepare: Option<Py<PyAny>>,
    /// Whether actions are led around zones and home as the decisions of strategies are.
    pub has_return_rule: bool,
    /// Whether the scenario may have several UAVs.
    pub is_fleet: bool,
}

impl Rules {
    /// Those of these arguments of an environment.
    #[expect(clippy::too_many_arguments, reason = "those of the environment")]
    pub fn of(
        py: Python<'_>,
        fields: Option<u64>,
        observation: &[String],
        nearest: Option<usize>,
        action: &str,
        reward: &str,
        prepare: Option<Py<PyAny>>,
        has_return_rule: bool,
    ) -> PyResult<Self> {
        if fields == Some(0) {
            return Err(refused("fields = 0: expected 1 or more, or None"));
        }
        let observed = Observed::of(py, observation, nearest)?;
        let control = Control::named(action)?;
        let reward = Reward::named(reward)?;
        Ok(Self { fields, observed, control, reward, keeps_contacts: true, prepare, has_return_rule, is_fleet: false })
    }

    /// The same for a vector, which has no belief to ask for.
    pub fn of_vector(self) -> Self {
        let is_of_contacts = |name: &&str| self.observed.has(name);
        let keeps_contacts = self.reward == Reward::Age || ["ages", "nearest"].iter().any(is_of_contacts);
        Self { keeps_contacts, ..self }
    }

    /// The same for several UAVs.
    pub fn of_fleet(self) -> Self {
        Self { is_fleet: true, ..self.of_vector() }
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
    /// That of this name.
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
}

impl Reward {
    /// That of this name.
    pub fn named(name: &str) -> PyResult<Self> {
        match name {
            "lost" => Ok(Self::Lost),
            "weighted" => Ok(Self::Weighted),
            "age" => Ok(Self::Age),
            "loss_fraction" => Ok(Self::LossFraction),
            _ => Err(refused(format!("reward = {name:?}: expected lost, weighted, age or loss_fraction"))),
        }
    }
}
