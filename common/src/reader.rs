//! The reading end of a topic: samples by their slot, and the waiting for them.

use std::fmt::Debug;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;

use crate::node::{NodeError, Patience, Role};
use crate::ring::RingError;
use crate::topic::Header;

/// The reading end of a topic. Samples of slots that have passed are dropped, those that came early are kept.
#[derive(Debug)]
pub struct Reader<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> {
    pub(crate) name: &'static str,
    /// Who writes the topic.
    pub(crate) from: Role,
    pub(crate) subscriber: Subscriber<S, P, H>,
    pub(crate) bell: Listener<S>,
    pub(crate) early: Option<Sample<S, P, H>>,
}

impl<S: Service + 'static, P: Debug + Copy + ZeroCopySend + 'static, H: Header> Reader<S, P, H> {
    /// The message of `slot`, if it has arrived.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn take(&mut self, slot: u64) -> Result<Option<Sample<S, P, H>>, RingError> {
        loop {
            let arrived = match self.early.take() {
                Some(sample) => Some(sample),
                None => self.subscriber.receive().map_err(|error| RingError::topic(self.name, "receive", &error))?,
            };
            let Some(sample) = arrived else { return Ok(None) };
            let sent = sample.user_header().head().slot;
            if sent == slot {
                return Ok(Some(sample));
            }
            if sent > slot {
                self.early = Some(sample);
                return Ok(None);
            }
        }
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

    /// Waits until the message of `slot` has arrived, which stays to be taken.
    ///
    /// # Errors
    /// As [`Reader::wait`].
    pub fn wait_until_there<E: From<NodeError> + From<RingError>>(
        &mut self,
        patience: &mut Patience,
        slot: u64,
        idle: impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        self.early = Some(self.wait(patience, slot, idle)?);
        Ok(())
    }
}

impl<S: Service + 'static, T: Debug + ZeroCopySend + 'static, H: Header> Reader<S, [T], H> {
    /// The next list in the order in which they were sent.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn receive(&mut self) -> Result<Option<Sample<S, [T], H>>, RingError> {
        self.subscriber.receive().map_err(|error| RingError::topic(self.name, "receive", &error))
    }

    /// Waits for the next list whose header is `wanted`, and drops those before it; `slot` is expected, for the
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
    ) -> Result<Sample<S, [T], H>, E> {
        let (name, from) = (self.name, self.from);
        let look = |reader: &mut Self| {
            while let Some(sample) = reader.receive()? {
                if wanted(sample.user_header()) {
                    return Ok(Some(sample));
                }
            }
            Ok(None)
        };
        patience.wait((name, slot, from), self, look, |reader| &reader.bell, idle)
    }
}
