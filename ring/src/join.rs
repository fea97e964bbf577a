//! Joining a ring: the agreement of its processes, and their nodes.

use std::fmt::Debug;
use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::prelude::*;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::cleanup::stand_by;
use crate::error::RingError;
use crate::folder::RingFolder;
use crate::reader::MAX_AHEAD;
use crate::refusals::Refusals;
use crate::role::{Role, RoleLock};
use crate::terms::Terms;
use crate::topic::{OBSERVER, Participant};
use crate::topics::{ROWS, Ring, SCHEMA};
use crate::wait::{CoreContention, LateJoiners, PAUSE, WaitContext};

/// Period of serving late joiners in a ring with a link, in which each notification costs some milliseconds.
const SERVE_LINKED_EVERY: Duration = Duration::from_millis(100);

impl<S: Service + 'static> Ring<S> {
    /// Locks `role` in the ring of the folder and opens its topics; returns them with the wait context of the process.
    /// The launcher has no lock; it creates the topics.
    ///
    /// # Errors
    /// If another process has the role, the ring does not exist or flies another scenario, or iceoryx2 fails.
    pub fn join(
        folder: &RingFolder,
        scenario: &Scenario,
        role: Role,
        stop: &Stop,
    ) -> Result<(Self, WaitContext), RingError> {
        let terms = folder.terms();
        let is_launcher = role == Role::Launcher;
        let agreed = if is_launcher { Some(attributes(&terms, scenario)?) } else { None };
        let role_lock = if is_launcher { None } else { Some(Arc::new(RoleLock::acquire(folder.path(), role)?)) };
        if !is_launcher && let Some(supervisor) = folder.supervisor()? {
            stand_by(folder, supervisor);
        }
        let node = node::<S>(folder, role.name())?;
        if is_launcher {
            let restricted = folder.restrict_process_counter();
            restricted.map_err(|error| RingError::topic("ring", "restrict its process counter", &error))?;
        }
        let member = Participant {
            terms: terms.clone(),
            role: Some(role),
            uavs: Some(scenario.uav.uavs()),
            max_ahead: role.blocks_ring().then_some(MAX_AHEAD),
            // The viewer and the launcher do not log refusals: the ring's other processes read the same samples.
            refusals: Refusals::new(Some(role).filter(|&role| role != Role::Viewer && !is_launcher)),
            late_joiners: LateJoiners::default(),
            role_lock: role_lock.clone(),
            stop: stop.clone(),
        };
        if !is_launcher && let Some(attributes) = attributes_of(&node)? {
            check_attributes(folder, &attributes, scenario)?;
        }
        let ring = Self::open(node, &member, agreed.as_ref())?;
        let wait = WaitContext {
            stop: stop.clone(),
            supervisor: folder.supervisor()?,
            late_joiners: member.late_joiners.clone(),
            timeout: is_launcher.then(|| terms.timeout()),
            waiting: terms.wait,
            last_supervisor_check: Instant::now(),
            last_served: Instant::now(),
            serve_every: if terms.link.is_some() { SERVE_LINKED_EVERY } else { PAUSE },
            polls: 0,
            contention: CoreContention::default(),
            slow_topics: Vec::new(),
            role_lock,
        };
        Ok((ring, wait))
    }

    /// Opens the topics of the ring in the folder as an observer without a role.
    ///
    /// # Errors
    /// If the ring does not exist, or has another version.
    pub fn observe(folder: &RingFolder) -> Result<Self, RingError> {
        let member = Participant {
            terms: folder.terms(),
            role: None,
            uavs: None,
            max_ahead: None,
            refusals: Refusals::new(None),
            late_joiners: LateJoiners::default(),
            role_lock: None,
            stop: Stop::default(),
        };
        let node = node::<S>(folder, OBSERVER)?;
        Self::open(node, &member, None)
    }
}

fn node<S: Service>(folder: &RingFolder, name: &str) -> Result<Node<S>, RingError> {
    let name = NodeName::new(name).map_err(|error| RingError::topic("ring", "name the process", &error))?;
    NodeBuilder::new()
        .config(&folder.config()?)
        .name(&name)
        .signal_handling_mode(SignalHandlingMode::Disabled) // see `Stop`
        .create::<S>()
        .map_err(|error| RingError::topic("ring", "join", &error))
}

/// The attributes on which all processes must agree: key, value, and the remedy if they differ.
fn agreement(scenario: &Scenario) -> [(&'static str, String, &'static str); 3] {
    [
        ("version", SCHEMA.to_string(), "use the executables of one build"),
        ("program", env!("CARGO_PKG_VERSION").to_owned(), "use the executables of one build"),
        ("scenario", format!("{:016x}", scenario.hash()), "pass the scenario.toml of the run's folder"),
    ]
}

fn attributes(terms: &Terms, scenario: &Scenario) -> Result<AttributeSpecifier, RingError> {
    let mission = ("mission", format!("{:016x}", terms.mission), "");
    let mut specifier = AttributeSpecifier::new();
    for (key, value, _) in agreement(scenario).into_iter().chain([mission]) {
        let refuse = |error: &dyn Debug| RingError::topic("ring", "define its terms", error);
        let key = key.try_into().map_err(|error| refuse(&error))?;
        let value = value.as_str().try_into().map_err(|error| refuse(&error))?;
        specifier = specifier.define(&key, &value).map_err(|error| refuse(&error))?;
    }
    Ok(specifier)
}

/// The attributes with which the ring was created, for any message types; `None` if the ring does not exist.
fn attributes_of<S: Service>(node: &Node<S>) -> Result<Option<AttributeSet>, RingError> {
    let refuse = |error: &dyn Debug| RingError::topic("ring", "read its terms", error);
    let name = ROWS[0].service_name()?;
    let details =
        S::details(&name, node.config(), MessagingPattern::PublishSubscribe).map_err(|error| refuse(&error))?;
    Ok(details.map(|details| details.static_details.attributes().clone()))
}

/// Refuses a ring whose attributes differ from those of this process.
fn check_attributes(folder: &RingFolder, attributes: &AttributeSet, scenario: &Scenario) -> Result<(), RingError> {
    for (name, expected, remedy) in agreement(scenario) {
        let key = name.try_into().map_err(|error| RingError::topic("ring", "read its terms", &error))?;
        let found = attributes.key_value(&key, 0).map_or_else(|| "missing".to_owned(), ToString::to_string);
        if found != expected {
            let message = format_args!("{name} is {found}, here {expected}: {remedy}");
            return Err(RingError::folder(folder.path(), message));
        }
    }
    Ok(())
}
