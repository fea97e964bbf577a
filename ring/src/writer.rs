//! The writing end of a topic: the sample first, then the wake-up.

use std::fmt::Debug;
use std::mem::MaybeUninit;
use std::rc::Rc;
use std::time::Duration;

use iceoryx2::port::SendError;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;

use crate::error::RingError;
use crate::sample::{Header, Payload};
use crate::wait::{LateJoiners, ServeJoiners};

/// The writing end of a topic.
#[derive(Debug)]
pub struct Writer<S: Service + 'static, P: Payload + ?Sized, H: Header>(Rc<Ports<S, P, H>>);

/// What iceoryx2 has of a writer.
#[derive(Debug)]
struct Ports<S: Service + 'static, P: Payload + ?Sized, H: Header> {
    name: &'static str,
    publisher: Publisher<S, P, H>,
    notifier: Notifier<S>,
    timeout: Duration,
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Writer<S, P, H> {
    /// A writer whose late joiners are served whenever the process waits.
    pub(crate) fn new(
        name: &'static str,
        publisher: Publisher<S, P, H>,
        notifier: Notifier<S>,
        timeout: Duration,
        late_joiners: &LateJoiners,
    ) -> Self {
        let ports = Rc::new(Ports { name, publisher, notifier, timeout });
        late_joiners.add(Rc::downgrade(&ports) as _);
        Self(ports)
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> ServeJoiners for Ports<S, P, H> {
    fn serve_joiners(&self) -> Result<(), RingError> {
        self.publisher.update_connections().map_err(|error| RingError::topic(self.name, "connect", &error))?;
        self.wake()
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Ports<S, P, H> {
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
        let ports = &self.0;
        let mut sample =
            ports.publisher.loan_uninit().map_err(|error| RingError::topic(ports.name, "loan a sample", &error))?;
        *sample.user_header_mut() = header;
        sample.write_payload(message).send().map_err(|error| ports.undelivered(error))?;
        ports.wake()
    }
}

impl<S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> Writer<S, [T], H> {
    /// Sends a list, then the wake-up.
    ///
    /// # Errors
    /// If a reader does not take it in time, or the system refuses.
    pub fn send_list(&self, header: H, list: &[T]) -> Result<(), RingError> {
        let mut loaned = self.loan(list.len())?;
        loaned.elements().write_copy_of_slice(list);
        // SAFETY: every element was just written.
        unsafe { loaned.send(header) }
    }

    /// Loans a list of `len` elements, to be written where its readers will find it. A writer has one at a time.
    ///
    /// # Errors
    /// If `len` is more than the writer was made for, or the system refuses.
    pub fn loan(&self, len: usize) -> Result<LoanedList<'_, S, T, H>, RingError> {
        let sample = self.0.publisher.loan_slice_uninit(len);
        let sample = sample.map_err(|error| RingError::topic(self.0.name, "loan a sample", &error))?;
        Ok(LoanedList { writer: self, sample })
    }
}

/// A loaned, uninitialised list sample. Dropping it discards it.
pub struct LoanedList<'a, S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> {
    writer: &'a Writer<S, [T], H>,
    sample: SampleMutUninit<S, [MaybeUninit<T>], H>,
}

impl<S: Service + 'static, T: Debug + Copy + ZeroCopySend + 'static, H: Header> LoanedList<'_, S, T, H> {
    /// The elements to be written.
    pub fn elements(&mut self) -> &mut [MaybeUninit<T>] {
        self.sample.payload_mut()
    }

    /// Sends the list, then the wake-up.
    ///
    /// # Safety
    /// Every element must have been written.
    ///
    /// # Errors
    /// If a reader does not take it in time, or the system refuses.
    pub unsafe fn send(mut self, header: H) -> Result<(), RingError> {
        *self.sample.user_header_mut() = header;
        // SAFETY: the caller has written every element.
        let sample = unsafe { self.sample.assume_init() };
        sample.send().map_err(|error| self.writer.0.undelivered(error))?;
        self.writer.0.wake()
    }
}
