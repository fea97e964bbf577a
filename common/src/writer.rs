//! The writing end of a topic: the sample first, then the wake-up.

use std::fmt::Debug;
use std::time::Duration;

use iceoryx2::port::SendError;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;

use crate::ring::RingError;
use crate::topic::Header;

/// The writing end of a topic.
#[derive(Debug)]
pub struct Writer<S: Service, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> {
    pub(crate) name: &'static str,
    pub(crate) publisher: Publisher<S, P, H>,
    pub(crate) notifier: Notifier<S>,
    pub(crate) timeout: Duration,
}

impl<S: Service + 'static, P: IceoryxSend + Debug + ?Sized + 'static, H: Header> Writer<S, P, H> {
    /// Lets late joiners have the newest samples, and wakes them.
    ///
    /// # Errors
    /// If a joiner cannot be connected.
    pub fn serve_joiners(&self) -> Result<(), RingError> {
        self.publisher.update_connections().map_err(|error| RingError::topic(self.name, "connect", &error))?;
        self.wake()
    }

    fn undelivered(&self, error: SendError) -> RingError {
        match error {
            SendError::UnableToDeliver => RingError::Full { topic: self.name, seconds: self.timeout.as_secs_f64() },
            error => RingError::topic(self.name, "send", &error),
        }
    }

    fn wake(&self) -> Result<(), RingError> {
        self.notifier.notify().map_err(|error| RingError::topic(self.name, "notify", &error))?;
        Ok(())
    }
}

impl<S: Service + 'static, P: Debug + Copy + ZeroCopySend + 'static, H: Header> Writer<S, P, H> {
    /// Sends one message, then the wake-up.
    ///
    /// # Errors
    /// If a reader does not take it in time, or the system refuses.
    pub fn send(&self, header: H, message: P) -> Result<(), RingError> {
        let mut sample =
            self.publisher.loan_uninit().map_err(|error| RingError::topic(self.name, "loan a sample", &error))?;
        *sample.user_header_mut() = header;
        let sample = sample.write_payload(message);
        sample.send().map_err(|error| self.undelivered(error))?;
        self.wake()
    }
}

impl<S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> Writer<S, [T], H> {
    /// Sends a list, then the wake-up.
    ///
    /// # Errors
    /// If a reader does not take it in time, or the system refuses.
    pub fn send_list(&self, header: H, list: &[T]) -> Result<(), RingError> {
        let mut sample = self
            .publisher
            .loan_slice_uninit(list.len())
            .map_err(|error| RingError::topic(self.name, "loan a sample", &error))?;
        *sample.user_header_mut() = header;
        let sample = sample.write_from_slice(list);
        sample.send().map_err(|error| self.undelivered(error))?;
        self.wake()
    }
}
