//! What a look at a topic from outside shows: its types, who writes and reads it, and how far it is.
//!
//! Whoever looks takes no role. It reads each topic for an instant, as a late joiner, by a subscriber that no writer
//! waits for: while it is stopped it misses samples.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::NodeView as _;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use serde::Serialize;
use skysink_common::message::SlotHeader;

use crate::error::RingError;
use crate::sample::{Header, Payload};
use crate::topic::{OBSERVER, Topic};

/// How long a topic is read: writers serve late joiners whenever they wait, every 10 ms.
const LOOK: Duration = Duration::from_millis(100);

/// How often it is polled meanwhile.
const POLL: Duration = Duration::from_millis(1);

/// A topic as it is found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TopicState {
    /// Name of its two services.
    pub service: String,
    /// Type of its payload, in brackets if it is a list.
    pub payload: String,
    /// Type of its user header.
    pub header: String,
    /// Processes that write it, by name; `?` if they have none.
    pub writers: Vec<String>,
    /// Processes that read it.
    pub readers: Vec<String>,
    /// Slot of its newest sample; none if nothing was sent.
    pub slot: Option<u64>,
    /// When that was sent, on the monotonic clock [ns].
    pub sent_ns: Option<u64>,
    /// Whether a slot has one sample, so that slots count samples.
    #[serde(skip)]
    pub is_once_a_slot: bool,
}

/// A topic that is looked at.
pub(crate) trait Watch {
    /// Who writes and who reads it, and everything that stays.
    fn state(&self, name: &dyn Fn(&UniqueNodeId) -> String) -> TopicState;

    /// Attaches a reader.
    fn attach(&mut self) -> Result<(), RingError>;

    /// Takes what has arrived; returns the head of the newest sample so far.
    fn take(&mut self) -> Result<Option<SlotHeader>, RingError>;
}

struct Watched<'a, S: Service + 'static, P: Payload + ?Sized, H: Header> {
    topic: &'a Topic<S, P, H>,
    subscriber: Option<Subscriber<S, P, H>>,
    newest: Option<SlotHeader>,
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Topic<S, P, H> {
    pub(crate) fn watch(&self) -> Box<dyn Watch + '_> {
        Box::new(Watched { topic: self, subscriber: None, newest: None })
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Watch for Watched<'_, S, P, H> {
    fn state(&self, name: &dyn Fn(&UniqueNodeId) -> String) -> TopicState {
        let shared = &self.topic.0;
        let types = shared.data.static_config().message_type_details();
        let mut writers = Vec::new();
        let mut readers = Vec::new();
        let ports = shared.data.dynamic_config();
        ports.list_publishers(|port| {
            writers.push(name(&port.node_id));
            CallbackProgression::Continue
        });
        ports.list_subscribers(|port| {
            readers.push(name(&port.node_id));
            CallbackProgression::Continue
        });
        readers.sort_unstable();
        TopicState {
            service: format!("skysink/{}", shared.row.name),
            payload: type_name(&types.payload),
            header: type_name(&types.user_header),
            writers,
            readers,
            slot: None,
            sent_ns: None,
            is_once_a_slot: !shared.row.several,
        }
    }

    fn attach(&mut self) -> Result<(), RingError> {
        let shared = &self.topic.0;
        let name = OBSERVER.try_into().map_err(|error| shared.refuse("name a reader", &error))?;
        let builder = shared.data.subscriber_builder().name(&name);
        let builder = builder.history_request(shared.row.history).buffer_size(shared.row.buffer);
        self.subscriber = Some(builder.create().map_err(|error| shared.refuse("read", &error))?);
        Ok(())
    }

    fn take(&mut self) -> Result<Option<SlotHeader>, RingError> {
        let Some(subscriber) = &self.subscriber else { return Ok(self.newest) };
        let mut received = 0;
        while received < self.topic.0.row.buffer
            && let Some(sample) = P::receive(subscriber).map_err(|error| self.topic.0.refuse("receive", &error))?
        {
            received += 1;
            let head = *sample.user_header().head();
            if self.newest.is_none_or(|newest| head.slot >= newest.slot) {
                self.newest = Some(head);
            }
        }
        Ok(self.newest)
    }
}

/// Looks at all of these topics at once.
pub(crate) fn look<S: Service>(
    mut watches: Vec<Box<dyn Watch + '_>>,
    node: &Node<S>,
) -> Result<Vec<TopicState>, RingError> {
    let names = node_names(node);
    let name = |id: &UniqueNodeId| names.get(&id.value()).cloned().unwrap_or_else(|| "?".to_owned());
    let mut states: Vec<TopicState> = watches.iter().map(|watch| watch.state(&name)).collect();
    watches.iter_mut().try_for_each(|watch| watch.attach())?;
    let begin = Instant::now();
    loop {
        let is_over = begin.elapsed() >= LOOK;
        for (watch, state) in watches.iter_mut().zip(&mut states) {
            let newest = watch.take()?;
            state.slot = newest.map(|head| head.slot);
            state.sent_ns = newest.map(|head| head.sent_ns);
        }
        if is_over {
            return Ok(states);
        }
        std::thread::sleep(POLL);
    }
}

/// The names of the ring's processes that have one.
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
