//! Which samples a reader admits: those of its run, from one writer at a time, in the order of their slots.

use std::fmt::Debug;
use std::rc::Rc;

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe;
use skysink_common::message::{FLAG_END, FLAG_TICK, QueuesHeader, SlotHeader};

use crate::cleanup::remove_dead_nodes;
use crate::refusals::{Refusal, Refusals};

/// What is read from a header of any topic.
pub trait Header: Debug + Default + Copy + ZeroCopySend + 'static {
    /// Mission, slot and flags.
    fn head(&self) -> &SlotHeader;
}

impl Header for SlotHeader {
    fn head(&self) -> &SlotHeader {
        self
    }
}

impl Header for QueuesHeader {
    fn head(&self) -> &SlotHeader {
        &self.head
    }
}

/// A publish-subscribe service.
pub(crate) type Data<S, P, H> = publish_subscribe::PortFactory<S, P, H>;

/// Slots that the ring can be ahead of a process that takes part in it.
const MAX_AHEAD: u64 = 2;

/// The admission of a reader.
#[derive(Debug)]
pub(crate) struct Admission<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> {
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

impl<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> Admission<S, P, H> {
    /// Whether the sample of `publisher` is admitted; `wanted` is the slot that the reader waits for, if its peers
    /// cannot be far ahead of it.
    pub(crate) fn check(&mut self, publisher: UniquePublisherId, header: &SlotHeader, wanted: Option<u64>) -> Entry {
        let refuse = |refusal| {
            self.refusals.add(self.name, header.slot, refusal, 1);
            Entry::Refused
        };
        if header.mission != self.mission {
            return refuse(Refusal::Mission);
        }
        if wanted.is_some_and(|wanted| header.slot > wanted + MAX_AHEAD) {
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

/// The order in which a writer sends: a slot begins (in paced runs) before its result, and the end comes last.
pub(crate) fn order(header: &SlotHeader) -> u64 {
    let within = match header.flags {
        flags if flags & FLAG_TICK != 0 => 0,
        flags if flags & FLAG_END != 0 => 2,
        _ => 1,
    };
    header.slot.saturating_mul(3).saturating_add(within)
}
