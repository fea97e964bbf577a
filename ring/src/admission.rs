//! Which samples a reader admits: those of its run, from one writer at a time, in the order of their slots.

use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use skysink_common::message::{FLAG_END, FLAG_REPEAT, SlotHeader};
use skysink_common::possible::Message as _;

use crate::cleanup::remove_dead_nodes;
use crate::refusals::Refusal;
use crate::sample::{Header, Payload};
use crate::topic::{SamplesPerSlot, TopicShared};

/// The admitted writer of a topic.
#[derive(Debug, Default)]
pub(crate) struct Admission {
    /// The admitted writer, and the order of its last sample. A link writes for all processes of other hosts.
    writer: Option<(UniquePublisherId, u64)>,
    /// The restart count of the admitted process.
    epoch: u32,
    /// The last other writer that was refused while the admitted one was attached.
    second_writer: Option<UniquePublisherId>,
}

/// How a sample is treated.
pub(crate) enum Verdict {
    /// The next sample of the admitted writer.
    Next,
    /// The first sample of a new writer, whose predecessor is gone. Samples of the predecessor stay valid: the new
    /// writer repeats them.
    NewWriter,
    /// A slot that its writer has sent before, or that comes after a later one.
    Repeated,
    Refused,
}

impl Admission {
    /// Decides on a sample of `topic`. One with impossible numbers may be sent again, corrected. `limit` is the last
    /// slot that the ring can have reached, if known.
    pub(crate) fn check<S: Service + 'static, P: Payload + ?Sized, H: Header>(
        &mut self,
        topic: &TopicShared<S, P, H>,
        sample: &Sample<S, P, H>,
        limit: Option<u64>,
    ) -> Verdict {
        let publisher = sample.header().publisher_id();
        let header = sample.user_header().head();
        let refuse = |refusal| {
            topic.refusals.add(topic.row.name, header.slot, refusal, 1);
            Verdict::Refused
        };
        if let Some(refusal) = foreign(topic, sample, limit) {
            return refuse(refusal);
        }
        let order = order(header);
        let is_possible = H::are_possible(std::slice::from_ref(sample.user_header()))
            && P::Message::are_possible(P::messages(sample));
        let is_linked = topic.member.terms.link.is_some();
        match &mut self.writer {
            // Behind a link, a restarted process has the writer of its predecessor, and a restarted link sends samples
            // again.
            Some((writer, _)) if is_linked && *writer == publisher && header.epoch > self.epoch => {}
            Some((writer, _)) if *writer == publisher && !is_possible => return refuse(Refusal::Numbers),
            Some((writer, last)) if *writer == publisher => {
                if order < *last || order == *last && topic.row.samples != SamplesPerSlot::Any {
                    let is_repeated = is_linked || header.flags & FLAG_REPEAT != 0;
                    return if is_repeated { Verdict::Repeated } else { refuse(Refusal::OldSlot) };
                }
                *last = order;
                return Verdict::Next;
            }
            Some((writer, _)) => {
                let writer = *writer;
                if self.second_writer == Some(publisher) && writes(topic, writer) {
                    return refuse(Refusal::SecondWriter);
                }
                if is_alive(topic, writer) {
                    self.second_writer = Some(publisher);
                    return refuse(Refusal::SecondWriter);
                }
                if !writes(topic, publisher) {
                    return Verdict::Refused; // both are dead: the next writer repeats the sample
                }
            }
            None => {}
        }
        if !is_possible {
            return refuse(Refusal::Numbers);
        }
        self.writer = Some((publisher, order));
        self.epoch = header.epoch;
        self.second_writer = None;
        Verdict::NewWriter
    }
}

/// Why a sample cannot be of this mission, of all its UAVs and of a slot up to `limit`; `None` if it can.
fn foreign<S: Service + 'static, P: Payload + ?Sized, H: Header>(
    topic: &TopicShared<S, P, H>,
    sample: &Sample<S, P, H>,
    limit: Option<u64>,
) -> Option<Refusal> {
    let header = sample.user_header().head();
    let elements = sample.header().number_of_elements();
    let is_of_all = !topic.row.is_by_uav || topic.member.uavs.is_none_or(|uavs| elements == uavs as u64);
    match () {
        () if header.mission != topic.member.terms.mission => Some(Refusal::Mission),
        () if !is_of_all => Some(Refusal::Uavs),
        () if limit.is_some_and(|limit| header.slot > limit) => Some(Refusal::FarSlot),
        () => None,
    }
}

/// How long a dead writer may stay listed while another process removes its resources, which takes up to 26 ms.
const REMOVAL: Duration = Duration::from_millis(50);

/// Whether a writer is attached to the topic, and its process is alive.
fn is_alive<S: Service + 'static, P: Payload + ?Sized, H: Header>(
    topic: &TopicShared<S, P, H>,
    writer: UniquePublisherId,
) -> bool {
    let begin = Instant::now();
    while writes(topic, writer) {
        if begin.elapsed() > REMOVAL {
            return true;
        }
        remove_dead_nodes::<S>(&topic.config); // no effect while another process does it
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

/// Whether a writer is attached to the topic.
fn writes<S: Service + 'static, P: Payload + ?Sized, H: Header>(
    topic: &TopicShared<S, P, H>,
    writer: UniquePublisherId,
) -> bool {
    let mut found = false;
    topic.data.dynamic_config().list_publishers(|details| {
        found |= details.publisher_id == writer;
        if found { CallbackProgression::Stop } else { CallbackProgression::Continue }
    });
    found
}

/// Sort key of the samples of a writer: by slot, with the end of the mission after the last slot.
pub(crate) fn order(header: &SlotHeader) -> u64 {
    header.slot.saturating_mul(2).saturating_add(u64::from(header.flags & FLAG_END))
}
