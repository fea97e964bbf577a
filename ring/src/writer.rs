//! The writing end of a topic: the sample first, then the wake-up.

use std::fmt::Debug;
use std::mem::MaybeUninit;
use std::time::Duration;

use iceoryx2::port::SendError;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;

use crate::admission::Header;
use crate::error::RingError;

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
        let mut blank = self.blank(list.len())?;
        blank.places().write_copy_of_slice(list);
        // SAFETY: it was just written, from the first place to the last.
        unsafe { blank.send(header) }
    }

    /// A list of `len` places, to be written where its readers will find it. A writer has one at a time.
    ///
    /// # Errors
    /// If `len` is more than the writer was made for, or the system refuses.
    pub fn blank(&self, len: usize) -> Result<Blank<'_, S, T, H>, RingError> {
        let sample = self.publisher.loan_slice_uninit(len);
        let sample = sample.map_err(|error| RingError::topic(self.name, "loan a sample", &error))?;
        Ok(Blank { writer: self, sample })
    }
}

/// A list in the making, in the memory in which it is sent; without being sent, it is as if it had never been.
pub struct Blank<'a, S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> {
    writer: &'a Writer<S, [T], H>,
    sample: SampleMutUninit<S, [MaybeUninit<T>], H>,
}

impl<S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> Blank<'_, S, T, H> {
    /// The places to be written.
    pub fn places(&mut self) -> &mut [MaybeUninit<T>] {
        self.sample.payload_mut()
    }

    /// Sends the list, then the wake-up.
    ///
    /// # Safety
    /// Every place must have been written.
    ///
    /// # Errors
    /// If a reader does not take it in time, or the system refuses.
    pub unsafe fn send(mut self, header: H) -> Result<(), RingError> {
        *self.sample.user_header_mut() = header;
        // SAFETY: the caller has written every place.
        let sample = unsafe { self.sample.assume_init() };
        sample.send().map_err(|error| self.writer.undelivered(error))?;
        self.writer.wake()
    }
}
