//! The ring of one run: the folder in which its processes meet, the terms they agree on, and its topics.
//!
//! Every run has a folder and a prefix of its own, so that two runs never meet. The launcher creates everything and
//! holds it; a process of the ring only opens it.

use std::path::Path;
use std::time::Duration;

use iceoryx2::prelude::*;
use rustix::time::{ClockId, clock_gettime};

use crate::claim::Claim;
use crate::dead::purge_dead_nodes;
use crate::journal::JournalError;
use crate::node::{Patience, Role};
use crate::refusals::Refusals;
use crate::ring_folder::{RingFolder, Terms};
use crate::topic::{
    COMMIT, CommitTopic, FLIGHT, FlightTopic, HEALTH, HealthTopic, Member, PATH, PATH_BUFFER, PLAN, PathTopic,
    PlanTopic, QUEUES, QueuesTopic, RING_BUFFER, SENSORS, SensorsTopic, Topic, VIEWER_BUFFER,
};
use skysink_common::message::SlotHeader;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

/// Version of the messages and of what they mean; processes of different versions do not meet.
pub const SCHEMA: &str = "2";

/// Event by which the viewer says that it is connected to every writer, on the topic `commit`.
pub const VIEWER_READY: usize = 11;

/// Why a ring cannot be used; the display is one line that names the remedy where there is one.
#[derive(Debug, thiserror::Error)]
pub enum RingError {
    /// The folder is not that of a running ring.
    #[error("ring {folder}: {message}")]
    Folder {
        /// The folder.
        folder: String,
        /// What is wrong with it.
        message: String,
    },
    /// The ring flies something else.
    #[error("ring {folder}: {what} is {theirs}, here {ours}: {remedy}")]
    Differs {
        /// The folder.
        folder: String,
        /// What differs.
        what: &'static str,
        /// As the ring has it.
        theirs: String,
        /// As this process has it.
        ours: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Another process has the place.
    #[error("ring {folder}: there is a {} already: end it first", role.name())]
    Taken {
        /// The folder.
        folder: String,
        /// The place.
        role: Role,
    },
    /// A process cannot remember.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// A reader is stuck.
    #[error(
        "topic {topic}: a reader has not taken its samples for {seconds} s: is one stopped, or the viewer too slow?"
    )]
    Full {
        /// The topic.
        topic: &'static str,
        /// How long it was waited for.
        seconds: f64,
    },
    /// iceoryx2 refuses.
    #[error("topic {topic}: cannot {action}: {detail}")]
    Topic {
        /// The topic, or `ring`.
        topic: &'static str,
        /// What was tried.
        action: &'static str,
        /// What iceoryx2 says.
        detail: String,
    },
}

impl RingError {
    pub(crate) fn topic(topic: &'static str, action: &'static str, error: &dyn std::fmt::Debug) -> Self {
        Self::Topic { topic, action, detail: format!("{error:?}") }
    }
}

/// The topics of a run, opened.
#[derive(Debug)]
pub struct Ring<S: Service + 'static> {
    /// What the run has agreed on.
    pub terms: Terms,
    /// Every sensor node, once.
    pub sensors: SensorsTopic<S>,
    /// The queues after each slot.
    pub queues: QueuesTopic<S>,
    /// The plan of each slot.
    pub plan: PlanTopic<S>,
    /// Where the plan leads, of planners that know.
    pub path: PathTopic<S>,
    /// The flight of each slot.
    pub flight: FlightTopic<S>,
    /// The slots on record.
    pub commit: CommitTopic<S>,
    /// What becomes of the processes.
    pub health: HealthTopic<S>,
    /// What this process did not accept.
    pub refusals: Refusals,
    /// How often its place was taken before.
    epoch: u32,
    node: Node<S>,
}

impl<S: Service + 'static> Ring<S> {
    /// Makes the ring in its folder; the launcher does, and keeps it for the whole run.
    ///
    /// # Errors
    /// If iceoryx2 cannot create its services.
    pub fn create(folder: &RingFolder, scenario: &Scenario) -> Result<Self, RingError> {
        let terms = folder.terms();
        let node = node::<S>(folder, Role::Launcher)?;
        folder.close_counter().map_err(|error| RingError::topic("ring", "close its counter", &error))?;
        let agreed = attributes(&terms, scenario)?;
        let member = Member { mission: terms.mission, refusals: Refusals::new(None) };
        Ok(Self {
            terms,
            sensors: Topic::create_list(&node, &member, SENSORS, RING_BUFFER, &agreed)?,
            queues: Topic::create_list(&node, &member, QUEUES, VIEWER_BUFFER, &agreed)?,
            plan: Topic::create(&node, &member, PLAN, VIEWER_BUFFER, &agreed)?,
            path: Topic::create_list(&node, &member, PATH, PATH_BUFFER, &agreed)?,
            flight: Topic::create(&node, &member, FLIGHT, VIEWER_BUFFER, &agreed)?,
            commit: Topic::create(&node, &member, COMMIT, RING_BUFFER, &agreed)?,
            health: Topic::create(&node, &member, HEALTH, VIEWER_BUFFER, &agreed)?,
            refusals: member.refusals,
            epoch: 0,
            node,
        })
    }

    /// Opens the ring in its folder, in the place `claim` of `role`, and checks that it flies `scenario`.
    ///
    /// # Errors
    /// If the ring is not there or flies another scenario.
    pub fn open(folder: &RingFolder, scenario: &Scenario, role: Role, claim: &Claim) -> Result<Self, RingError> {
        let terms = folder.terms();
        let node = node::<S>(folder, role)?;
        // The ring's own processes say what they refuse; the viewer only looks on, but nobody else reads paths.
        let speaker = Some(role).filter(|&role| role != Role::Viewer);
        let member = Member { mission: terms.mission, refusals: Refusals::new(speaker) };
        let only_reader = Member { refusals: Refusals::new(Some(role)), ..member };
        let sensors = Topic::open_list(&node, &member, SENSORS)?;
        agree(folder, sensors.terms(), scenario)?;
        Ok(Self {
            terms,
            sensors,
            queues: Topic::open_list(&node, &member, QUEUES)?,
            plan: Topic::open(&node, &member, PLAN)?,
            path: Topic::open_list(&node, &only_reader, PATH)?,
            flight: Topic::open(&node, &member, FLIGHT)?,
            commit: Topic::open(&node, &member, COMMIT)?,
            health: Topic::open(&node, &member, HEALTH)?,
            refusals: member.refusals,
            epoch: claim.epoch(),
            node,
        })
    }

    /// Frees what processes that died have left behind; the launcher does. What it cannot free goes with the folder.
    pub fn remove_dead_nodes(&self) {
        purge_dead_nodes::<S>(self.node.config());
    }

    /// A header of this run, sent now.
    #[must_use]
    pub fn header(&self, slot: u64, flags: u32) -> SlotHeader {
        SlotHeader { mission: self.terms.mission, slot, epoch: self.epoch, flags, sent_ns: monotonic_ns() }
    }

    /// How long a process of this run waits for another.
    #[must_use]
    pub fn timeout(&self) -> Duration {
        Duration::from_secs_f64(self.terms.timeout_s)
    }

    /// The patience of a process of this run, which shows by its claim that it is alive; the launcher has none.
    ///
    /// # Errors
    /// If the supervisor's lock is not there.
    pub fn patience(&self, folder: &RingFolder, claim: Option<Claim>, stop: &Stop) -> Result<Patience, RingError> {
        Ok(Patience::new(stop.clone(), folder.supervisor()?, claim, self.timeout(), self.terms.wait))
    }
}

/// Time on the monotonic clock [ns], common to all processes of a machine.
#[must_use]
pub fn monotonic_ns() -> u64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64 // the clock starts at boot: both are positive
}

fn node<S: Service>(folder: &RingFolder, role: Role) -> Result<Node<S>, RingError> {
    let name = NodeName::new(role.name()).map_err(|error| RingError::topic("ring", "name the process", &error))?;
    NodeBuilder::new()
        .config(&folder.config()?)
        .name(&name)
        .signal_handling_mode(SignalHandlingMode::Disabled) // see `Stop`
        .create::<S>()
        .map_err(|error| RingError::topic("ring", "join", &error))
}

/// What every process must agree on, by key.
fn agreement(scenario: &Scenario) -> [(&'static str, String, &'static str); 3] {
    [
        ("version", SCHEMA.to_owned(), "use the executables of one build"),
        ("program", env!("CARGO_PKG_VERSION").to_owned(), "use the executables of one build"),
        ("scenario", format!("{:016x}", scenario.hash()), "pass the scenario.toml of the run's folder"),
    ]
}

fn attributes(terms: &Terms, scenario: &Scenario) -> Result<AttributeSpecifier, RingError> {
    let mission = ("mission", format!("{:016x}", terms.mission), "");
    let mut specifier = AttributeSpecifier::new();
    for (key, value, _) in agreement(scenario).into_iter().chain([mission]) {
        let refuse = |error: &dyn std::fmt::Debug| RingError::topic("ring", "define its terms", error);
        let (key, value) = (key.try_into().map_err(|error| refuse(&error))?, value.as_str().try_into());
        let value = value.map_err(|error| refuse(&error))?;
        specifier = specifier.define(&key, &value).map_err(|error| refuse(&error))?;
    }
    Ok(specifier)
}

fn agree(folder: &RingFolder, theirs: &AttributeSet, scenario: &Scenario) -> Result<(), RingError> {
    for (what, ours, remedy) in agreement(scenario) {
        let key = what.try_into().map_err(|error| RingError::topic("ring", "read its terms", &error))?;
        let theirs = theirs.key_value(&key, 0).map_or_else(|| "missing".to_owned(), ToString::to_string);
        if theirs != ours {
            let folder = folder.path().display().to_string();
            return Err(RingError::Differs { folder, what, theirs, ours, remedy });
        }
    }
    Ok(())
}

/// Whether `path` can be a ring's folder: iceoryx2 puts UNIX sockets there, whose paths end at 108 bytes.
pub(crate) fn short_enough(path: &Path) -> bool {
    path.as_os_str().len() <= 48
}
