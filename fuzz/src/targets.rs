//! What is fuzzed: the readers of files, and the checks of messages.

mod field_journal;
mod flight_journal;
mod flight_message;
mod health_message;
mod journal;
mod mission;
mod path_message;
mod place;
mod plan_message;
mod planner_memory;
mod planner_message;
mod scenario;
mod sensors;
mod sweep_journal;
mod trace;
mod world;

pub use field_journal::field_journal;
pub use flight_journal::flight_journal;
pub use flight_message::flight_message;
pub use health_message::health_message;
pub use journal::journal;
pub use mission::mission;
pub use path_message::path_message;
pub use plan_message::plan_message;
pub use planner_memory::planner_memory;
pub use planner_message::planner_message;
pub use scenario::scenario;
pub use sensors::sensors;
pub use sweep_journal::sweep_journal;
pub use trace::trace;

/// One of the things that are fuzzed.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Its name, and that of its corpus.
    pub name: &'static str,
    /// Panics if the bytes make something go wrong.
    pub check: fn(&[u8]),
    /// What its inputs are made of.
    pub input: Input,
}

/// What inputs are made of; it decides which tokens are put into them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    /// A file that people write.
    Text,
    /// Numbers as they lie in memory.
    Binary,
}

/// All of them.
pub const TARGETS: [Target; 14] = [
    Target { name: "scenario", check: scenario, input: Input::Text },
    Target { name: "sensors", check: sensors, input: Input::Text },
    Target { name: "mission", check: mission, input: Input::Text },
    Target { name: "trace", check: trace, input: Input::Text },
    Target { name: "sweep_journal", check: sweep_journal, input: Input::Text },
    Target { name: "journal", check: journal, input: Input::Binary },
    Target { name: "field_journal", check: field_journal, input: Input::Binary },
    Target { name: "flight_journal", check: flight_journal, input: Input::Binary },
    Target { name: "planner_memory", check: planner_memory, input: Input::Binary },
    Target { name: "plan_message", check: plan_message, input: Input::Binary },
    Target { name: "flight_message", check: flight_message, input: Input::Binary },
    Target { name: "planner_message", check: planner_message, input: Input::Binary },
    Target { name: "health_message", check: health_message, input: Input::Binary },
    Target { name: "path_message", check: path_message, input: Input::Binary },
];

impl Target {
    /// The target of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        TARGETS.into_iter().find(|target| target.name == name)
    }
}

/// Fails unless the words are one line, as messages to people are.
fn assert_one_line(words: &impl std::fmt::Display) {
    let words = words.to_string();
    assert!(!words.is_empty() && !words.contains('\n'), "not one line: {words:?}");
}
