//! The reading end of a topic: samples by their slot, from one writer at a time, and the waiting for them.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::rc::Rc;

use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::port::ReceiveError;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::dead::remove_dead_nodes;
use crate::node::{NodeError, Patience, Role};
use crate::refusals::{Refusal, Refusals};
use crate::ring::RingError;
use crate::topic::{Data, Header, Topic};
use skysink_common::message::{FLAG_END, FLAG_TICK, SlotHeader};

/// Samples that are kept because they came early. With the one that is worked on they are all that a reader may hold.
pub(crate) const MAX_EARLY: usize = 3;

/// Samples looked at in a row before the process looks around: a flood must not keep it from ending.
const MAX_IN_A_ROW: usize = 256;

/// Slots that the ring can be ahead of a process that takes part in it.
const MAX_AHEAD: u64 = 2;

/// The reading end of a topic. Samples of slots that have passed are dropped, those that came early are kept; what does
/// not belong here is refused.
#[derive(Debug)]
pub struct Reader<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> {
    pub(crate) name: &'static str,
    /// Who writes the topic.
    pub(crate) from: Role,
    pub(crate) subscriber: Subscriber<S, P, H>,
    pub(crate) bell: Listener<S>,
    pub(crate) early: VecDeque<Sample<S, P, H>>,
    pub(crate) door: Door<S, P, H>,
}

/// What a reader finds of a slot.
#[derive(Debug)]
pub enum Found<T> {
    /// Its message.
    Here(T),
    /// Nothing yet.
    NotYet,
    /// A later message; its own was sent before this process listened, and will not come.
    Passed,
}

/// Receiving, which iceoryx2 has once for single messages and once for lists.
pub trait Receive<S: Service, P: IceoryxSend + Debug + ?Sized, H: Debug + ZeroCopySend> {
    /// The next sample that has arrived.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    fn next(&self) -> Result<Option<Sample<S, P, H>>, ReceiveError>;
}

impl<S: Service, P: Debug + ZeroCopySend, H: Debug + ZeroCopySend> Receive<S, P, H> for Subscriber<S, P, H> {
    fn next(&self) -> Result<Option<Sample<S, P, H>>, ReceiveError> {
        self.receive()
    }
}

impl<S: Service, T: Debug + ZeroCopySend, H: Debug + ZeroCopySend> Receive<S, [T], H> for Subscriber<S, [T], H> {
    fn next(&self) -> Result<Option<Sample<S, [T], H>>, ReceiveError> {
        self.receive()
    }
}

/// Who is let in.
#[derive(Debug)]
pub(crate) struct Door<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> {
    pub(crate) name: &'static str,
    pub(crate) mission: u64,
    pub(crate) config: Config,
    pub(crate) data: Rc<Data<S, P, H>>,
    pub(crate) refusals: Refusals,
    /// Whether a slot may have several messages.
    pub(crate) several: bool,
    /// The writer that is heard, and the last that it sent.
    pub(crate) writer: Option<(UniquePublisherId, u64)>,
    /// The last that was turned away while the writer was there.
    pub(crate) stranger: Option<UniquePublisherId>,
}

/// What the door says of a sample.
enum Entry {
    Known,
    /// The writer before it is gone. What that one sent still counts: the new one repeats it.
    New,
    Refused,
}

impl<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> Door<S, P, H> {
    /// Whether the sample of `publisher` may come in; `wanted` is the slot that the reader waits for, if its peers
    /// cannot be far ahead of it.
    fn check(&mut self, publisher: UniquePublisherId, header: &SlotHeader, wanted: Option<u64>) -> Entry {
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
                if self.stranger == Some(publisher) && self.writes(writer) {
                    return refuse(Refusal::SecondWriter);
                }
                if self.writes(writer) {
                    remove_dead_nodes::<S>(&self.config); // it may only seem to be there
                }
                if self.writes(writer) {
                    self.stranger = Some(publisher);
                    return refuse(Refusal::SecondWriter);
                }
                if !self.writes(publisher) {
                    return Entry::Refused; // both are dead: whoever comes next sends it again
                }
            }
            None => {}
        }
        self.writer = Some((publisher, order));
        self.stranger = None;
        Entry::New
    }

    /// Whether a writer has a place at the topic.
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
fn order(header: &SlotHeader) -> u64 {
    let within = match header.flags {
        flags if flags & FLAG_TICK != 0 => 0,
        flags if flags & FLAG_END != 0 => 2,
        _ => 1,
    };
    header.slot.saturating_mul(3).saturating_add(within)
}

impl<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> Reader<S, P, H>
where
    Subscriber<S, P, H>: Receive<S, P, H>,
{
    /// Hangs this reader's bell on `topic` behind those of everybody who is there by now: the writer rings them first.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn step_back(&mut self, topic: &Topic<S, P, H>) -> Result<(), RingError> {
        self.bell = topic.listener()?; // the new one hangs before the old one goes, or it would have its place
        Ok(())
    }

    /// Whether somebody has a place to write the topic.
    #[must_use]
    pub fn has_writer(&self) -> bool {
        self.door.data.dynamic_config().number_of_publishers() > 0
    }

    /// Counts a message of `slot` that was let in and then refused for what it says.
    pub fn refuse(&self, slot: u64, refusal: Refusal) {
        self.door.refusals.add(self.name, slot, refusal, 1);
    }

    /// The message of `slot`, if it has arrived. Peers cannot be far ahead of it.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn take(&mut self, slot: u64) -> Result<Option<Sample<S, P, H>>, RingError> {
        match self.find(slot, Some(slot))? {
            Found::Here(sample) => Ok(Some(sample)),
            Found::NotYet | Found::Passed => Ok(None),
        }
    }

    /// The message of `slot` for a process that may lag: samples may be of any later slot.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn look_for(&mut self, slot: u64) -> Result<Found<Sample<S, P, H>>, RingError> {
        self.find(slot, None)
    }

    fn find(&mut self, slot: u64, wanted: Option<u64>) -> Result<Found<Sample<S, P, H>>, RingError> {
        let mut looked = 0;
        loop {
            let all = self.fill(wanted, &mut looked)?;
            while self.early.front().is_some_and(|sample| sample.user_header().head().slot < slot) {
                self.early.pop_front();
            }
            match self.early.front() {
                Some(sample) if sample.user_header().head().slot == slot => {
                    return Ok(self.early.pop_front().map_or(Found::NotYet, Found::Here));
                }
                Some(_) => return Ok(Found::Passed),
                None if all || looked >= MAX_IN_A_ROW => return Ok(Found::NotYet),
                None => {}
            }
        }
    }

    /// Takes in what has arrived, as far as there is room; true if that was all.
    fn fill(&mut self, wanted: Option<u64>, looked: &mut usize) -> Result<bool, RingError> {
        while self.early.len() < MAX_EARLY && *looked < MAX_IN_A_ROW {
            *looked += 1;
            let received = self.subscriber.next();
            let Some(sample) = received.map_err(|error| RingError::topic(self.name, "receive", &error))? else {
                return Ok(true);
            };
            match self.door.check(sample.header().publisher_id(), sample.user_header().head(), wanted) {
                Entry::Refused => {}
                Entry::Known => self.early.push_back(sample),
                Entry::New => {
                    self.early.push_back(sample);
                    self.early.make_contiguous().sort_by_key(|sample| order(sample.user_header().head()));
                }
            }
        }
        Ok(false)
    }

    /// Takes in what has arrived while another topic is waited for: a writer must not wait because of what is refused
    /// here. Peers cannot be far ahead of `slot`.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn make_room(&mut self, slot: u64) -> Result<(), RingError> {
        self.fill(Some(slot), &mut 0)?;
        Ok(())
    }

    /// The next message in the order in which they were sent.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn receive(&mut self) -> Result<Option<Sample<S, P, H>>, RingError> {
        self.fill(None, &mut 0)?;
        Ok(self.early.pop_front())
    }

    /// Waits for the message of `slot`; `idle` runs now and then.
    ///
    /// # Errors
    /// Those of `idle`, a requested stop, the supervisor's death, or the time-out.
    pub fn wait<E: From<NodeError> + From<RingError>>(
        &mut self,
        patience: &mut Patience,
        slot: u64,
        idle: impl FnMut() -> Result<(), E>,
    ) -> Result<Sample<S, P, H>, E> {
        let (name, from) = (self.name, self.from);
        patience.wait((name, slot, from), self, |reader| Ok(reader.take(slot)?), |reader| &reader.bell, idle)
    }

    /// Waits for the message of `slot`, or for a later one: then it returns none.
    ///
    /// # Errors
    /// As [`Reader::wait`].
    pub fn wait_or_pass<E: From<NodeError> + From<RingError>>(
        &mut self,
        patience: &mut Patience,
        slot: u64,
        idle: impl FnMut() -> Result<(), E>,
    ) -> Result<Option<Sample<S, P, H>>, E> {
        let (name, from) = (self.name, self.from);
        let look = |reader: &mut Self| match reader.look_for(slot)? {
            Found::Here(sample) => Ok(Some(Some(sample))),
            Found::Passed => Ok(Some(None)),
            Found::NotYet => Ok(None),
        };
        patience.wait((name, slot, from), self, look, |reader| &reader.bell, idle)
    }

    /// Waits until the message of `slot`, or one that is not far after it, has arrived, which stays to be taken.
    ///
    /// # Errors
    /// As [`Reader::wait`].
    pub fn wait_until_there<E: From<NodeError> + From<RingError>>(
        &mut self,
        patience: &mut Patience,
        slot: u64,
        idle: impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        let (name, from) = (self.name, self.from);
        let look = |reader: &mut Self| match reader.find(slot, Some(slot))? {
            Found::Here(sample) => {
                reader.early.push_front(sample);
                Ok(Some(()))
            }
            Found::Passed => Ok(Some(())),
            Found::NotYet => Ok(None),
        };
        patience.wait((name, slot, from), self, look, |reader| &reader.bell, idle)
    }

    /// Waits for the next message whose header is `wanted`, and drops those before it; `slot` is expected, for the
    /// time-out. `idle` runs now and then.
    ///
    /// # Errors
    /// Those of `idle`, a requested stop, the supervisor's death, or the time-out.
    pub fn wait_for<E: From<NodeError> + From<RingError>>(
        &mut self,
        patience: &mut Patience,
        slot: u64,
        mut wanted: impl FnMut(&H) -> bool,
        idle: impl FnMut() -> Result<(), E>,
    ) -> Result<Sample<S, P, H>, E> {
        let (name, from) = (self.name, self.from);
        let look = |reader: &mut Self| {
            for _ in 0..MAX_IN_A_ROW {
                let Some(sample) = reader.receive()? else { return Ok(None) };
                if wanted(sample.user_header()) {
                    return Ok(Some(sample));
                }
            }
            Ok(None)
        };
        patience.wait((name, slot, from), self, look, |reader| &reader.bell, idle)
    }
}
