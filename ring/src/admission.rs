//! Which samples a reader admits: those of its run, from one writer at a time, in the order of their slots.

use std::time::{Duration, Instant};

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::prelude::*;
use skysink_common::message::{FLAG_END, FLAG_REPEAT, SlotHeader};

use crate::cleanup::remove_dead_nodes;
use crate::refusals::Refusal;
use crate::sample::{Header, Payload};
use crate::topic::Shared;

/// The writers that a reader knows.
#[derive(Debug, Default)]
pub(crate) struct Admission {
    /// The writer that is heard, and the last that it sent. A link to other hosts writes for all of their processes.
    writer: Option<(UniquePublisherId, u64)>,
    /// The restart count of the process that is heard.
    epoch: u32,
    /// The last other writer that was refused while the one that is heard was there.
    second_writer: Option<UniquePublisherId>,
}

/// What becomes of a sample.
pub(crate) enum Entry {
    Known,
    /// The writer before it is gone. What that one sent still counts: the new one repeats it.
    New,
    /// Its slot may have passed already: its writer has sent it, or a later one, before.
    Repeated,
    Refused,
}

impl Admission {
    /// Whether the sample of `publisher` on `topic` is admitted; `limit` is the last slot that can have been reached,
    /// if that is known.
    pub(crate) fn check<S: Service + 'static, P: Payload + ?Sized, H: Header>(
        &mut self,
        topic: &Shared<S, P, H>,
        publisher: UniquePublisherId,
        header: &SlotHeader,
        limit: Option<u64>,
    ) -> Entry {
        let refuse = |refusal| {
            topic.member.refusals.add(topic.row.name, header.slot, refusal, 1);
            Entry::Refused
        };
        if header.mission != topic.member.terms.mission {
            return refuse(Refusal::Mission);
        }
        if limit.is_some_and(|limit| header.slot > limit) {
            return refuse(Refusal::FarSlot);
        }
        let order = order(header);
        let is_linked = topic.member.terms.link.is_some();
        match &mut self.writer {
            // Behind a link, a process that was started again has the writer of the one before it; and a link that was
            // started again brings samples once more.
            Some((writer, _)) if is_linked && *writer == publisher && header.epoch > self.epoch => {}
            Some((writer, last)) if *writer == publisher => {
                if order < *last || order == *last && !topic.row.several {
                    let is_repeated = is_linked || header.flags & FLAG_REPEAT != 0;
                    return if is_repeated { Entry::Repeated } else { refuse(Refusal::OldSlot) };
                }
                *last = order;
                return Entry::Known;
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
                    return Entry::Refused; // both are dead: whoever comes next sends it again
                }
            }
            None => {}
        }
        self.writer = Some((publisher, order));
        self.epoch = header.epoch;
        self.second_writer = None;
        Entry::New
    }
}

/// How long a dead writer may stay listed while another process removes what it has left behind; that takes up to 26
/// ms.
const REMOVAL: Duration = Duration::from_millis(50);

/// Whether a writer is attached to the topic and no dead process's.
fn is_alive<S: Service + 'static, P: Payload + ?Sized, H: Header>(
    topic: &Shared<S, P, H>,
    writer: UniquePublisherId,
) -> bool {
    let begin = Instant::now();
    while writes(topic, writer) {
        if begin.elapsed() > REMOVAL {
            return true;
        }
        remove_dead_nodes::<S>(&topic.config); // in vain while another process does so
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

/// Whether a writer is attached to the topic.
fn writes<S: Service + 'static, P: Payload + ?Sized, H: Header>(
    topic: &Shared<S, P, H>,
    writer: UniquePublisherId,
) -> bool {
    let mut found = false;
    topic.data.dynamic_config().list_publishers(|details| {
        found |= details.publisher_id == writer;
        if found { CallbackProgression::Stop } else { CallbackProgression::Continue }
    });
    found
}

/// The order in which a writer sends: slot by slot; the end comes after the last slot.
pub(crate) fn order(header: &SlotHeader) -> u64 {
    header.slot.saturating_mul(2).saturating_add(u64::from(header.flags & FLAG_END))
}
