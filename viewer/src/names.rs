//! What sensor nodes are called: by the names in their list, else by their numbers.

use re_sdk_types::AnyValues;
use re_sdk_types::components::Text;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::{SensorList, Sensors};

use crate::sizes::MAX_BARS;

/// Most sensor nodes whose labels are always shown.
const MOST_SHOWN: usize = 30;

/// The names of the sensor nodes of a scenario.
#[derive(Debug, Clone, Default)]
pub(crate) struct SensorNames {
    /// By number, empty for one without a name; empty if none has one.
    given: Vec<String>,
    count: usize,
}

impl SensorNames {
    /// Those in the list of a scenario.
    pub(crate) fn of(scenario: &Scenario, count: usize) -> Self {
        Self { given: SensorList::names_of(scenario), count }
    }

    /// Whether there are so few labels of names or weights that all are always shown; those of more, or plain numbers,
    /// are shown where the pointer is.
    pub(crate) fn are_always_shown(&self, sensors: &Sensors) -> bool {
        (!self.given.is_empty() || !sensors.weights.are_equal()) && self.count <= MOST_SHOWN
    }

    /// What a sensor node is called.
    pub(crate) fn name(&self, id: usize) -> String {
        self.given.get(id).filter(|name| !name.is_empty()).map_or_else(|| format!("SN {id}"), Clone::clone)
    }

    /// The labels of all sensor nodes in the scene, with their weights if these differ. `None` if they are many without
    /// names and with equal weights: rerun shows the number of what the pointer is at.
    pub(crate) fn labels(&self, sensors: &Sensors) -> Option<Vec<String>> {
        if sensors.weights.are_equal() {
            return self.all();
        }
        let label = |id: usize| format!("{}, w = {}", self.name(id), sensors.weights.of(id));
        Some((0..self.count).map(label).collect())
    }

    /// The names as a component that rerun lists for what the pointer is at; `None` as for [`Self::labels`].
    pub(crate) fn component(&self) -> Option<AnyValues> {
        Some(AnyValues::default().with_component::<Text>("name", self.all()?))
    }

    fn all(&self) -> Option<Vec<String>> {
        let has_names = !self.given.is_empty() || self.count <= MAX_BARS;
        has_names.then(|| (0..self.count).map(|id| self.name(id)).collect())
    }
}
