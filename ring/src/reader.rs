//! The reading end of a topic: samples by their slot, from one writer at a time, and the waiting for them.

use std::collections::VecDeque;
use std::fmt::Debug;

use iceoryx2::port::ReceiveError;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::admission::{Admission, Entry, Header, order};
use crate::error::{NodeError, RingError};
use crate::refusals::Refusal;
use crate::role::Role;
use crate::wait::WaitContext;

/// Samples that are kept because they came early. With the one that is worked on they are all that a reader may hold.
pub(crate) const MAX_EARLY: usize = 3;

/// Samples looked at in a row before the process looks around: a flood must not keep it from ending.
const MAX_IN_A_ROW: usize = 256;

/// The reading end of a topic. Samples of slots that have passed are dropped, those that came early are kept; what does
/// not belong here is refused.
#[derive(Debug)]
pub struct Reader<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> {
    pub(crate) name: &'static str,
    /// Who writes the topic.
    pub(crate) from: Role,
    pub(crate) subscriber: Subscriber<S, P, H>,
    pub(crate) listener: Listener<S>,
    pub(crate) early: VecDeque<Sample<S, P, H>>,
    pub(crate) admission: Admission<S, P, H>,
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

impl<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> Reader<S, P, H>
where
    Subscriber<S, P, H>: Receive<S, P, H>,
{
    /// Attaches `listener` in place of the one before, so that those attached earlier are notified first.
    pub fn reattach(&mut self, listener: Listener<S>) {
        self.listener = listener;
    }

    /// Whether somebody has a place to write the topic.
    #[must_use]
    pub fn has_writer(&self) -> bool {
        self.admission.data.dynamic_config().number_of_publishers() > 0
    }

    /// Counts a message of `slot` that was let in and then refused for what it says.
    pub fn refuse(&self, slot: u64, refusal: Refusal) {
        self.admission.refusals.add(self.name, slot, refusal, 1);
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
            match self.admission.check(sample.header().publisher_id(), sample.user_header().head(), wanted) {
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
        patience: &mut WaitContext,
        slot: u64,
        idle: impl FnMut() -> Result<(), E>,
    ) -> Result<Sample<S, P, H>, E> {
        let (name, from) = (self.name, self.from);
        patience.wait((name, slot, from), self, |reader| Ok(reader.take(slot)?), |reader| &reader.listener, idle)
    }

    /// Waits for the message of `slot`, or for a later one: then it returns none.
    ///
    /// # Errors
    /// As [`Reader::wait`].
    pub fn wait_or_pass<E: From<NodeError> + From<RingError>>(
        &mut self,
        patience: &mut WaitContext,
        slot: u64,
        idle: impl FnMut() -> Result<(), E>,
    ) -> Result<Option<Sample<S, P, H>>, E> {
        let (name, from) = (self.name, self.from);
        let look = |reader: &mut Self| match reader.look_for(slot)? {
            Found::Here(sample) => Ok(Some(Some(sample))),
            Found::Passed => Ok(Some(None)),
            Found::NotYet => Ok(None),
        };
        patience.wait((name, slot, from), self, look, |reader| &reader.listener, idle)
    }

    /// Waits until the message of `slot`, or one that is not far after it, has arrived, which stays to be taken.
    ///
    /// # Errors
    /// As [`Reader::wait`].
    pub fn wait_until_there<E: From<NodeError> + From<RingError>>(
        &mut self,
        patience: &mut WaitContext,
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
        patience.wait((name, slot, from), self, look, |reader| &reader.listener, idle)
    }

    /// Waits for the next message whose header is `wanted`, and drops those before it; `slot` is expected, for the
    /// time-out. `idle` runs now and then.
    ///
    /// # Errors
    /// Those of `idle`, a requested stop, the supervisor's death, or the time-out.
    pub fn wait_for<E: From<NodeError> + From<RingError>>(
        &mut self,
        patience: &mut WaitContext,
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
        patience.wait((name, slot, from), self, look, |reader| &reader.listener, idle)
    }
}
