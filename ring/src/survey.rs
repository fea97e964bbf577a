//! The state of the topics as observed from outside: types, writers, readers and progress.
//!
//! An observer has no role. It reads each topic shortly, as a late joiner, by a subscriber that no writer waits for,
//! and may miss samples.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::NodeView as _;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use serde::Serialize;
use skysink_common::message::{SlotHeader, Tick};

use crate::error::RingError;
use crate::sample::{Header, Payload};
use crate::topic::{OBSERVER, SamplesPerSlot, Topic, TopicRow};

/// How long the topics are read: writers serve late joiners every 10 ms while they wait.
const OBSERVATION: Duration = Duration::from_millis(100);

/// Period of the polls.
const POLL: Duration = Duration::from_millis(1);

/// The state of a topic.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TopicState {
    /// Name of its two services.
    pub service: String,
    /// Type of its payload, in brackets if it is a list.
    pub payload: String,
    /// Type of its user header.
    pub header: String,
    /// Names of the processes that write it; `?` for one without a name.
    pub writers: Vec<String>,
    /// Names of the processes that read it.
    pub readers: Vec<String>,
    /// Slot of its newest sample; `None` if nothing was sent.
    pub slot: Option<u64>,
    /// When that sample was sent, on the monotonic clock [ns].
    pub sent_ns: Option<u64>,
    /// Slot of the oldest observed sample, and when it was sent [ns].
    #[serde(skip)]
    pub oldest: Option<(u64, u64)>,
    /// How many samples it has in a slot.
    #[serde(skip)]
    pub samples: SamplesPerSlot,
}

/// The headers of the oldest and the newest of the observed samples.
type OldestAndNewest = Option<[SlotHeader; 2]>;

/// Receives the pending samples of a topic; returns the oldest and the newest so far.
type ReceiveSamples<'a> = Box<dyn FnMut() -> Result<OldestAndNewest, RingError> + 'a>;

/// A topic of any payload.
pub(crate) trait AnyTopic<S: Service> {
    fn row(&self) -> &TopicRow;

    /// The attached writers.
    fn writers(&self) -> Vec<UniqueNodeId>;

    /// A listener to its notifications.
    fn listener(&self) -> Result<Listener<S>, RingError>;

    /// The state of the topic without its samples. `name` returns the name of a process.
    fn state(&self, name: &dyn Fn(&UniqueNodeId) -> String) -> TopicState;

    /// Attaches an observer.
    fn observe(&self) -> Result<ReceiveSamples<'_>, RingError>;
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> AnyTopic<S> for Topic<S, P, H> {
    fn row(&self) -> &TopicRow {
        self.0.row
    }

    fn writers(&self) -> Vec<UniqueNodeId> {
        self.writers()
    }

    fn listener(&self) -> Result<Listener<S>, RingError> {
        self.listener()
    }

    fn state(&self, name: &dyn Fn(&UniqueNodeId) -> String) -> TopicState {
        let shared = &self.0;
        let types = shared.data.static_config().message_type_details();
        let mut readers = Vec::new();
        shared.data.dynamic_config().list_subscribers(|port| {
            readers.push(name(&port.node_id));
            CallbackProgression::Continue
        });
        readers.sort_unstable();
        TopicState {
            service: shared.row.service(),
            payload: type_name(&types.payload),
            header: type_name(&types.user_header),
            writers: self.writers().iter().map(name).collect(),
            readers,
            slot: None,
            sent_ns: None,
            oldest: None,
            samples: shared.row.samples,
        }
    }

    fn observe(&self) -> Result<ReceiveSamples<'_>, RingError> {
        let subscriber = observer(self)?;
        let mut samples: OldestAndNewest = None;
        Ok(Box::new(move || {
            for _ in 0..self.0.row.buffer {
                let sample = P::receive(&subscriber).map_err(|error| self.0.refuse("receive", &error))?;
                let Some(sample) = sample else { break };
                let head = *sample.user_header().head();
                let [oldest, newest] = samples.unwrap_or([head, head]);
                samples = Some([oldest, if head.slot >= newest.slot { head } else { newest }]);
            }
            Ok(samples)
        }))
    }
}

/// Attaches a subscriber that no writer waits for, as a late joiner.
fn observer<S: Service, P: Payload + ?Sized, H: Header>(
    topic: &Topic<S, P, H>,
) -> Result<Subscriber<S, P, H>, RingError> {
    let shared = &topic.0;
    let name = OBSERVER.try_into().map_err(|error| shared.refuse("name a reader", &error))?;
    let builder = shared.data.subscriber_builder().name(&name);
    let builder = builder.history_request(shared.row.history).buffer_size(shared.row.buffer);
    builder.create().map_err(|error| shared.refuse("read", &error))
}

/// The newest tick; `None` if none was sent.
pub(crate) fn newest_tick<S: Service>(topic: &Topic<S, Tick, SlotHeader>) -> Result<Option<Tick>, RingError> {
    let subscriber = observer(topic)?;
    let begin = Instant::now();
    let mut newest = None;
    while newest.is_none() && begin.elapsed() < OBSERVATION {
        while let Some(sample) = subscriber.receive().map_err(|error| topic.0.refuse("receive", &error))? {
            newest = Some(*sample.payload());
        }
        std::thread::sleep(POLL);
    }
    Ok(newest)
}

/// The states of these topics, observed at the same time.
pub(crate) fn observe_all<S: Service>(
    topics: &[&dyn AnyTopic<S>],
    node: &Node<S>,
) -> Result<Vec<TopicState>, RingError> {
    let names = node_names(node);
    let name = |id: &UniqueNodeId| names.get(&id.value()).cloned().unwrap_or_else(|| "?".to_owned());
    let mut states: Vec<TopicState> = topics.iter().map(|topic| topic.state(&name)).collect();
    let mut observers = topics.iter().map(|topic| topic.observe()).collect::<Result<Vec<_>, _>>()?;
    let begin = Instant::now();
    loop {
        let is_over = begin.elapsed() >= OBSERVATION;
        for (observer, state) in observers.iter_mut().zip(&mut states) {
            let Some([oldest, newest]) = observer()? else { continue };
            state.slot = Some(newest.slot);
            state.sent_ns = Some(newest.sent_ns);
            state.oldest = Some((oldest.slot, oldest.sent_ns));
        }
        if is_over {
            return Ok(states);
        }
        std::thread::sleep(POLL);
    }
}

/// The names of the ring's processes, by node.
fn node_names<S: Service>(node: &Node<S>) -> BTreeMap<u128, String> {
    let mut names = BTreeMap::new();
    let _ = Node::<S>::list(node.config(), |state| {
        if let NodeState::Alive(node) = state {
            let name = node.details().as_ref().map(|details| details.name().as_str().to_owned()).unwrap_or_default();
            if !name.is_empty() {
                names.insert(node.id().value(), name);
            }
        }
        CallbackProgression::Continue
    });
    names
}

fn type_name(detail: &TypeDetail) -> String {
    match detail.variant() {
        TypeVariant::Dynamic => format!("[{}]", detail.type_name()),
        TypeVariant::FixedSize => detail.type_name().to_string(),
    }
}
