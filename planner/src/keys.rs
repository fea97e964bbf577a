//! The keys of `[planner]` that apply to all strategies.

use serde::{Deserialize, Serialize};
use skysink_common::channel::{Channel, LinkModel};
use skysink_common::error::InputError;
use skysink_common::estimate::Rates;
use skysink_common::keys::Accepts;
use skysink_common::scenario::Scenario;
use strum::VariantNames;
use toml::Value;

use crate::assumed_link::AssumedLink;

/// Largest weight of a cost.
const MOST_WEIGHT: f64 = 1e12;

/// Exponent of the peak age: the largest ages decide.
pub const PEAK_EXPONENT: i32 = 8;

skysink_common::keys! {
    /// The keys of `[planner]` except the name of the strategy and the tables of single strategies.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    pub struct Settings {
        /// Most expansions of sP2*; 1 in the paper.
        sca_iterations: u32 = 1, Accepts::Whole(1, 1000);
        /// Solver of sP2*.
        waypoint_solver: WaypointSolver = "geometric", Accepts::OneOf(WaypointSolver::VARIANTS);
        /// Knowledge of the queues: the true ones, or the UAV's estimate.
        knowledge: Knowledge = "oracle", Accepts::OneOf(Knowledge::VARIANTS);
        /// Knowledge of the sampling rates; `"learnt"` needs `knowledge = "estimated"`.
        rates: Rates = "known", Accepts::OneOf(Rates::VARIANTS);
        /// What `horizon` and `offline` plan for, by name, or a sum of costs, `{ loss = 1, age = 0.2 }` (decision D36).
        objective: PlanningObjective = "loss", Accepts::Rule("\"loss\", \"collect\", \"age\", \"peak-age\", \
            \"deadline\", \"expiry\", or a table of loss, age, peak_age, deadline and expiry: weights from 0 to 1e12, \
                not all 0");
        /// Knowledge of links by place, with `link.model = "map"`: the map, or a law of the distance,
        /// `link.law_snr_db`; `"map"` if absent.
        links: Option<LinkKnowledge>, Accepts::OneOf(LinkKnowledge::VARIANTS);
        /// What plans take the link for, where that is wrong; without this table they know its law. Not with `links`.
        link: Option<AssumedLink>, Accepts::TableOf(AssumedLink::KEYS);
    }
}

impl Settings {
    /// The keys of a scenario. The rest of `[planner]` is checked by [`crate::settings`].
    ///
    /// # Errors
    /// If a value is out of range.
    pub fn of(scenario: &Scenario) -> Result<Self, InputError> {
        let settings: Self = scenario.planner_keys("planner")?;
        let learnt = |expected: &str| Err(scenario.refusal("planner.rates", &"learnt".into(), expected));
        match (settings.rates, settings.knowledge, scenario.sensors.expiry_s) {
            (Rates::Learnt, Knowledge::Oracle, _) => {
                learnt("\"known\", or planner.knowledge = \"estimated\", with which rates may be learnt")
            }
            (Rates::Learnt, _, Some(_)) => learnt("\"known\" with sensors.expiry_s: bits that expire hide the rate"),
            _ => Ok(()),
        }?;
        settings.check_objective(scenario)?;
        settings.check_links(scenario)?;
        settings.link.map_or(Ok(()), |link| link.check(scenario))?;
        Ok(settings)
    }

    /// Refuses a knowledge of links that there is no way to have.
    fn check_links(&self, scenario: &Scenario) -> Result<(), InputError> {
        let (Some(links), link) = (self.links, &scenario.link) else { return Ok(()) };
        let name = LinkKnowledge::VARIANTS[links as usize];
        let refuse = |expected| Err(scenario.refusal("planner.links", &name.into(), expected));
        match links {
            _ if link.model != LinkModel::Map => refuse("it only with link.model = \"map\""),
            _ if self.link.is_some() => refuse("it without the table [planner.link]"),
            LinkKnowledge::Law if link.law().is_none() => {
                refuse("\"map\", or link.law_snr_db, the SNR of the law at 1 m, beside it")
            }
            LinkKnowledge::Law | LinkKnowledge::Map => Ok(()),
        }
    }

    /// Refuses weights that are no objective, and keys that they need.
    fn check_objective(&self, scenario: &Scenario) -> Result<(), InputError> {
        let Some(weights) = self.objective.weights() else { return Ok(()) };
        let ObjectiveWeights { loss, age, peak_age, deadline, expiry } = weights;
        let all = [loss, age, peak_age, deadline, expiry];
        let is_weight = |weight: &f64| (0.0..=MOST_WEIGHT).contains(weight);
        let refuse = |expected| Err(scenario.refusal("planner.objective", &self.objective.value(), expected));
        if !all.iter().all(is_weight) || all.iter().sum::<f64>() == 0.0 {
            return refuse("weights from 0 to 1e12, not all 0");
        }
        let sensors = &scenario.sensors;
        let given = [
            (deadline, sensors.deadline_s.is_some(), "sensors.deadline_s, the limit of ages, beside it"),
            (expiry, sensors.expiry_s.is_some(), "sensors.expiry_s, the age at which bits are lost, beside it"),
        ];
        match given.iter().find(|(weight, is_given, _)| *weight > 0.0 && !is_given) {
            Some(&(.., expected)) => refuse(expected),
            None => Ok(()),
        }
    }

    /// The channel of `scenario` as plans reckon with it.
    ///
    /// # Panics
    /// If `[planner]` was not checked.
    #[must_use]
    pub fn channel(scenario: &Scenario) -> Channel {
        let planned = scenario.link.planned();
        let is_assumed = scenario.planner.others.contains_key("link");
        let law = scenario.link.law();
        if !is_assumed && law.is_none() {
            return Channel::of(&planned);
        }
        let Self { links, link, .. } = Self::of(scenario).expect("a checked scenario");
        let channel = Channel::of(&link.map_or_else(|| planned.clone(), |assumed| assumed.of(planned.clone())));
        match (links, law) {
            (Some(LinkKnowledge::Law), Some(law)) => channel.by_law(law),
            _ => channel,
        }
    }

    /// What the UAV knows of the rates if it has to estimate the queues; `None` if it knows them.
    pub fn estimated(&self) -> Option<Rates> {
        (self.knowledge == Knowledge::Estimated).then_some(self.rates)
    }
}

/// The planner's knowledge of the queues.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Knowledge {
    /// All queues, in every slot.
    Oracle,
    /// The UAV's estimate, from the queues reported on contact and the sampling rates.
    Estimated,
}

/// Solver of the waypoint problem sP2*.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum WaypointSolver {
    /// In free space the exact projection onto an intersection of disks; with probabilistic line of sight, ascent.
    Geometric,
    /// Interior-point conic solver, Clarabel.
    Clarabel,
}

/// The planner's knowledge of links by place (decision D32).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum LinkKnowledge {
    /// The map, and the spread of the residual.
    Map,
    /// A law of the distance.
    Law,
}

/// What plans over many slots are made for (decision D36).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected \"loss\", \"collect\", \"age\", \"peak-age\", \"deadline\", \"expiry\", or a table of loss, \
        age, peak_age, deadline and expiry"
)]
pub enum PlanningObjective {
    /// One of those with a name.
    Named(NamedObjective),
    /// A sum of costs.
    Sum(ObjectiveWeights),
}

/// Objectives with a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NamedObjective {
    /// The least data lost.
    Loss,
    /// The most data delivered until the mission's end, wherever nothing, or little, is sampled.
    Collect,
    /// The least mean age of service.
    Age,
    /// The least peak age: the sum of the eighth powers of the ages before services.
    #[serde(alias = "peak_age")]
    PeakAge,
    /// The fewest slots with an age above `sensors.deadline_s`.
    Deadline,
    /// The least data lost, of bits that expire by `sensors.expiry_s`.
    Expiry,
}

/// What of each cost counts, times the weights of the sensor nodes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObjectiveWeights {
    /// Of a bit that is lost.
    pub loss: f64,
    /// Of a second of age in a slot.
    pub age: f64,
    /// Of the eighth power of the age before a service, in seconds.
    #[serde(alias = "peak-age")]
    pub peak_age: f64,
    /// Of a slot with an age above the limit.
    pub deadline: f64,
    /// Of a bit that overflows or expires: as `loss`, but only where bits expire.
    #[serde(skip_serializing_if = "is_zero")]
    pub expiry: f64,
}

/// Whether a weight is not written.
fn is_zero(weight: &f64) -> bool {
    *weight == 0.0
}

impl ObjectiveWeights {
    /// Of a lost bit, for whatever reason.
    pub fn of_bits(&self) -> f64 {
        self.loss + self.expiry
    }
}

impl PlanningObjective {
    /// The least data lost.
    pub const LOSS: Self = Self::Named(NamedObjective::Loss);

    /// The weights of its costs; `None` for what is to be collected.
    #[must_use]
    pub fn weights(self) -> Option<ObjectiveWeights> {
        let none = ObjectiveWeights::default();
        match self {
            Self::Sum(weights) => Some(weights),
            Self::Named(NamedObjective::Collect) => None,
            Self::Named(NamedObjective::Loss) => Some(ObjectiveWeights { loss: 1.0, ..none }),
            Self::Named(NamedObjective::Age) => Some(ObjectiveWeights { age: 1.0, ..none }),
            Self::Named(NamedObjective::PeakAge) => Some(ObjectiveWeights { peak_age: 1.0, ..none }),
            Self::Named(NamedObjective::Deadline) => Some(ObjectiveWeights { deadline: 1.0, ..none }),
            Self::Named(NamedObjective::Expiry) => Some(ObjectiveWeights { expiry: 1.0, ..none }),
        }
    }

    /// Its value in a scenario.
    ///
    /// # Panics
    /// Never: it can be written.
    #[must_use]
    pub fn value(self) -> Value {
        Value::try_from(self).expect("names and numbers can be written")
    }

    /// What it asks for, in words.
    #[must_use]
    pub fn words(self) -> String {
        let Some(ObjectiveWeights { loss, age, peak_age, deadline, expiry }) = self.weights() else {
            return "the most data delivered until the end".to_owned();
        };
        let parts = [
            (loss, "data lost"),
            (age, "mean age of service"),
            (peak_age, "peak age of service"),
            (deadline, "slots beyond the deadline"),
            (expiry, "data lost or expired"),
        ];
        let parts = parts.iter().filter(|(weight, _)| *weight > 0.0);
        let weighted: Vec<String> = parts.map(|(weight, words)| format!("{weight} × {words}")).collect();
        format!("the least {}", weighted.join(" + ").trim_start_matches("1 × "))
    }

    /// Whether the least data is to be lost, and nothing else counts.
    #[must_use]
    pub fn is_loss(self) -> bool {
        let others = |weights: ObjectiveWeights| weights.age + weights.peak_age + weights.deadline;
        self.weights().is_some_and(|weights| others(weights) == 0.0)
    }

    /// Whether the most data is to be delivered.
    #[must_use]
    pub fn is_collect(self) -> bool {
        self.weights().is_none()
    }
}
