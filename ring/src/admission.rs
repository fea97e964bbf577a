//! Which samples a reader admits: those of its run, from one writer at a time, in the order of their slots.

use std::rc::Rc;

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe;
use skysink_common::message::{FLAG_END, SlotHeader};

use crate::cleanup::remove_dead_nodes;
use crate::refusals::{Refusal, Refusals};
use crate::sample::{Header, Payload};

/// A publish-subscribe service.
pub(crate) type Data<S, P, H> = publish_subscribe::PortFactory<S, P, H>;

/// The admission of a reader.
#[derive(Debug)]
pub(crate) struct Admission<S: Service + 'static, P: Payload + ?Sized, H: Header> {
    pub(crate) name: &'static str,
    pub(crate) mission: u64,
    pub(crate) config: Config,
    pub(crate) data: Rc<Data<S, P, H>>,
    pub(crate) refusals: Refusals,
    /// Whether a slot may have several messages.
    pub(crate) several: bool,
    /// The writer that is heard, and the last that it sent.
    pub(crate) writer: Option<(UniquePublisherId, u64)>,
    /// The last other writer that was refused while the one that is heard was there.
    pub(crate) second_writer: Option<UniquePublisherId>,
}

/// What becomes of a sample.
pub(crate) enum Entry {
    Known,
    /// The writer before it is gone. What that one sent still counts: the new one repeats it.
    New,
    Refused,
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Admission<S, P, H> {
    /// Whether the sample of `publisher` is admitted; `limit` is the last slot that can have been reached, if that is known.
    pub(crate) fn check(&mut self, publisher: UniquePublisherId, header: &SlotHeader, limit: Option<u64>) -> Entry {
        let refuse = |refusal| {
            self.refusals.add(self.name, header.slot, refusal, 1);
            Entry::Refused
        };
        if header.mission != self.mission {
            return refuse(Refusal::Mission);
        }
        if limit.is_some_and(|limit| header.slot > limit) {
            return refuse(Refusal::FarSlot);
        }
        let order = order(header);
        match &mut self.writer {
            Some((writer, last)) if *writer == publisher => {
                if order < *last || order == *last && !self.several {
                    return refuse(Refusal::OldSlot);
                }
                *last = order;
                return Entry::Known;
            }
            Some((writer, _)) => {
                let writer = *writer;
                if self.second_writer == Some(publisher) && self.writes(writer) {
                    return refuse(Refusal::SecondWriter);
                }
                if self.writes(writer) {
                    remove_dead_nodes::<S>(&self.config); // it may only seem to be there
                }
                if self.writes(writer) {
                    self.second_writer = Some(publisher);
                    return refuse(Refusal::SecondWriter);
                }
                if !self.writes(publisher) {
                    return Entry::Refused; // both are dead: whoever comes next sends it again
                }
            }
            None => {}
        }
        self.writer = Some((publisher, order));
        self.second_writer = None;
        Entry::New
    }

    /// Whether any writer is attached to the topic.
    pub(crate) fn has_writer(&self) -> bool {
        self.data.dynamic_config().number_of_publishers() > 0
    }

    /// Whether a writer is attached to the topic.
    fn writes(&self, writer: UniquePublisherId) -> bool {
        let mut found = false;
        self.data.dynamic_config().list_publishers(|details| {
            found |= details.publisher_id == writer;
            if found { CallbackProgression::Stop } else { CallbackProgression::Continue }
        });
        found
    }
}

/// The order in which a writer sends: slot by slot; the end comes after the last slot.
pub(crate) fn order(header: &SlotHeader) -> u64 {
    header.slot.saturating_mul(2).saturating_add(u64::from(header.flags & FLAG_END))
}
