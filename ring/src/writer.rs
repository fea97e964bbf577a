//! The writing end of a topic: sends a sample, then notifies the readers.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::fmt::Debug;
use std::mem::MaybeUninit;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use iceoryx2::port::SendError;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::port_factory::publisher::PortFactoryPublisher;
use skysink_common::message::FLAG_REPEAT;
use skysink_common::possible::Message;

use crate::error::RingError;
use crate::sample::{Header, Payload};
use crate::topic::{OnFullBuffer, Topic, TopicShared};
use crate::wait::ServeJoiners;

/// The writing end of a topic.
#[derive(Debug)]
pub struct Writer<S: Service + 'static, P: Payload + ?Sized, H: Header>(Rc<Ports<S, P, H>>);

/// The iceoryx2 ports of a writer.
#[derive(Debug)]
struct Ports<S: Service + 'static, P: Payload + ?Sized, H: Header> {
    topic: Rc<TopicShared<S, P, H>>,
    publisher: Publisher<S, P, H>,
    notifier: Notifier<S>,
    /// The last samples, if a link to other hosts may lose them.
    repeats: Option<RefCell<Repeats<P, H>>>,
    /// While true, the writer does not wait for full readers.
    is_repeating: Arc<AtomicBool>,
}

/// The last samples of a writer, to be sent again.
#[derive(Debug)]
struct Repeats<P: Payload + ?Sized, H: Header> {
    samples: VecDeque<(H, Vec<P::Message>)>,
    /// Most samples.
    depth: usize,
    /// Time without a new sample after which they are repeated.
    after: Duration,
    last_sent: Instant,
}

/// Time without a new sample after which a writer repeats its last ones over a link.
const REPEAT_AFTER: Duration = Duration::from_millis(500);

/// Added to [`REPEAT_AFTER`] for each megabyte of a sample, so that repeats do not fill the link.
const REPEAT_LATER_PER_MB: Duration = Duration::from_millis(250);

impl<P: Payload + ?Sized, H: Header> Repeats<P, H> {
    fn of(depth: usize) -> Self {
        let samples = VecDeque::with_capacity(depth);
        Self { samples, depth, after: REPEAT_AFTER, last_sent: Instant::now() }
    }

    fn store(&mut self, header: H, messages: &[P::Message]) {
        let is_full = self.samples.len() >= self.depth;
        let oldest = if is_full { self.samples.pop_front() } else { None };
        let mut copied = oldest.map(|(_, copied)| copied).unwrap_or_default();
        copied.clear();
        copied.extend_from_slice(messages);
        self.samples.push_back((header, copied));
        self.after = REPEAT_AFTER + REPEAT_LATER_PER_MB.mul_f64(size_of_val(messages) as f64 / 1e6);
        self.last_sent = Instant::now();
    }
}

/// The action in the error for a topic with its maximum of writers.
const WRITE: &str = "write (if all places are taken, end the other program)";

impl<S: Service + 'static, P: Message + Debug + Copy + ZeroCopySend + 'static, H: Header> Topic<S, P, H> {
    /// A writer of single messages.
    ///
    /// # Errors
    /// If the topic has its maximum of writers, or iceoryx2 fails.
    pub fn writer(&self) -> Result<Writer<S, P, H>, RingError> {
        self.build_writer(self.0.data.publisher_builder())
    }
}

impl<S: Service + 'static, T: Message + Debug + Copy + ZeroCopySend + 'static, H: Header> Topic<S, [T], H> {
    /// A writer of lists of at most `len` elements.
    ///
    /// # Errors
    /// If the topic has its maximum of writers, or iceoryx2 fails.
    pub fn list_writer(&self, len: usize) -> Result<Writer<S, [T], H>, RingError> {
        self.build_writer(self.0.data.publisher_builder().initial_max_slice_len(len))
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Topic<S, P, H> {
    /// A writer whose late joiners are served while the process waits.
    fn build_writer(&self, builder: PortFactoryPublisher<'_, S, P, H>) -> Result<Writer<S, P, H>, RingError> {
        let topic = Rc::clone(&self.0);
        let is_repeating = Arc::new(AtomicBool::new(false));
        let is_repeated = topic.member.terms.link.is_some() && topic.row.on_full == OnFullBuffer::BlockInLockStep;
        let repeats = is_repeated.then(|| RefCell::new(Repeats::of(topic.row.history)));
        // A repeat may be due while a list is loaned.
        let builder = builder.max_loaned_samples(1 + usize::from(repeats.is_some()));
        let builder = builder.set_backpressure_handler(topic.backpressure(Arc::clone(&is_repeating)));
        let publisher = builder.create().map_err(|error| topic.refuse(WRITE, &error))?;
        let ports = Rc::new(Ports { notifier: topic.notifier()?, publisher, repeats, is_repeating, topic });
        self.0.member.late_joiners.0.borrow_mut().push(Rc::downgrade(&ports) as _);
        Ok(Writer(ports))
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> ServeJoiners for Ports<S, P, H> {
    fn serve_joiners(&self) -> Result<(), RingError> {
        self.publisher.update_connections().map_err(|error| self.topic.refuse("connect", &error))?;
        self.repeat_if_due()?;
        self.notify()
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Ports<S, P, H> {
    fn send_error(&self, error: SendError) -> RingError {
        if let Err(stopped) = self.topic.member.stop.check() {
            return stopped.into(); // a stop ends the wait for a full buffer with an error
        }
        let seconds = self.topic.member.terms.full_limit().as_secs_f64();
        match error {
            SendError::UnableToDeliver => RingError::Full { topic: self.topic.row.name, seconds },
            error => self.topic.refuse("send", &error),
        }
    }

    /// Stores a sample for repeats, if a link may lose it.
    fn store(&self, header: H, messages: &[P::Message]) {
        if let Some(repeats) = &self.repeats {
            repeats.borrow_mut().store(header, messages);
        }
    }

    /// Sends a copy of `messages`, and notifies the readers.
    fn send(&self, header: H, messages: &[P::Message]) -> Result<(), RingError> {
        self.store(header, messages);
        P::send(&self.publisher, header, messages).map_err(|error| self.send_error(error))?;
        self.notify()
    }

    /// Sends the last samples again if nothing was sent for long: a link may have lost them, and then the processes
    /// that wait for them send nothing, either.
    fn repeat_if_due(&self) -> Result<(), RingError> {
        let Some(repeats) = &self.repeats else { return Ok(()) };
        let Repeats { samples, after, last_sent, .. } = &mut *repeats.borrow_mut();
        if last_sent.elapsed() < *after {
            return Ok(());
        }
        *last_sent = Instant::now();
        self.is_repeating.store(true, Ordering::Relaxed);
        let sent = samples.iter().try_for_each(|(header, copied)| {
            let mut header = *header;
            header.head_mut().flags |= FLAG_REPEAT;
            P::send(&self.publisher, header, copied)
        });
        self.is_repeating.store(false, Ordering::Relaxed);
        sent.map_err(|error| self.topic.refuse("send", &error))
    }

    fn notify(&self) -> Result<(), RingError> {
        self.notifier.notify().map(drop).map_err(|error| self.topic.refuse("notify", &error))
    }
}

impl<S: Service + 'static, P: Message + Debug + Copy + ZeroCopySend + 'static, H: Header> Writer<S, P, H> {
    /// Sends one message, and notifies the readers.
    ///
    /// # Errors
    /// If a reader does not take it in time, or iceoryx2 fails.
    pub fn send(&self, header: H, message: P) -> Result<(), RingError> {
        self.0.send(header, &[message])
    }
}

impl<S: Service + 'static, T: Message + Debug + Copy + ZeroCopySend + 'static, H: Header> Writer<S, [T], H> {
    /// Sends a list, and notifies the readers.
    ///
    /// # Errors
    /// If a reader does not take it in time, or iceoryx2 fails.
    pub fn send_list(&self, header: H, list: &[T]) -> Result<(), RingError> {
        self.0.send(header, list)
    }

    /// Loans a list of `len` elements in shared memory. A writer has one loan at a time.
    ///
    /// # Errors
    /// If `len` exceeds the length for which the writer was created, or iceoryx2 fails.
    pub fn loan(&self, len: usize) -> Result<LoanedList<'_, S, T, H>, RingError> {
        let sample = self.0.publisher.loan_slice_uninit(len);
        let sample = sample.map_err(|error| self.0.topic.refuse("loan a sample", &error))?;
        Ok(LoanedList { writer: self, sample })
    }
}

/// A loaned, uninitialised list sample. Dropping it discards it.
pub struct LoanedList<'a, S: Service + 'static, T: Message + Debug + Copy + ZeroCopySend + 'static, H: Header> {
    writer: &'a Writer<S, [T], H>,
    sample: SampleMutUninit<S, [MaybeUninit<T>], H>,
}

impl<S: Service + 'static, T: Message + Debug + Copy + ZeroCopySend + 'static, H: Header> LoanedList<'_, S, T, H> {
    /// The elements to be written.
    pub fn elements(&mut self) -> &mut [MaybeUninit<T>] {
        self.sample.payload_mut()
    }

    /// Sends the list, and notifies the readers.
    ///
    /// # Safety
    /// Every element must have been written.
    ///
    /// # Errors
    /// If a reader does not take it in time, or iceoryx2 fails.
    pub unsafe fn send(mut self, header: H) -> Result<(), RingError> {
        *self.sample.user_header_mut() = header;
        // SAFETY: the caller has written every element.
        let sample = unsafe { self.sample.assume_init() };
        self.writer.0.store(header, sample.payload());
        sample.send().map_err(|error| self.writer.0.send_error(error))?;
        self.writer.0.notify()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::folder::RingFolder;
    use crate::role::Role;
    use crate::terms::{LinkTerms, Terms};
    use crate::topics::Ring;
    use skysink_common::message::{Commit, SensorNode, SensorsHeader};
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::stop::Stop;
    use std::path::Path;

    fn scenario() -> Scenario {
        Scenario::parse("name = 'x'\n", Path::new("x.toml"), Overrides::default()).unwrap()
    }

    fn linked_folder() -> RingFolder {
        let link = Some(LinkTerms { version: 0, scenario: 0 });
        RingFolder::create(Terms { link, ..Terms::default() }).unwrap()
    }

    #[test]
    fn an_idle_writer_of_a_linked_ring_repeats_its_last_samples() {
        let folder = linked_folder();
        let (ring, mut wait) =
            Ring::<local::Service>::join(&folder, &scenario(), Role::Launcher, &Stop::default()).unwrap();
        let commits = ring.commit.writer().unwrap();
        let sensors = ring.sensors.list_writer(3).unwrap();
        [1, 2, 3].into_iter().for_each(|slot| commits.send(ring.header(slot, 0), Commit { hash: slot }).unwrap());
        let nodes = [1.0, 2.0].map(|x_m| SensorNode { x_m, ..SensorNode::default() });
        let header = SensorsHeader { head: ring.header(0, 0), ..SensorsHeader::default() };
        sensors.send_list(header, &nodes).unwrap();
        // Readers that join late and receive only repeats.
        let late = ring.commit.0.data.subscriber_builder().history_request(0).create().unwrap();
        let late_list = ring.sensors.0.data.subscriber_builder().history_request(0).create().unwrap();
        let mut received = Vec::new();
        let mut list = None;
        let begin = Instant::now();
        while (received.len() < 4 || list.is_none()) && begin.elapsed() < Duration::from_secs(60) {
            wait.sleep_until(Instant::now() + Duration::from_millis(1)).unwrap();
            while let Some(sample) = late.receive().unwrap() {
                received.push((sample.user_header().flags, sample.payload().hash));
            }
            list = late_list.receive().unwrap().map(|sample| sample.payload().to_vec()).or(list);
        }
        assert_eq!(received, [(FLAG_REPEAT, 2), (FLAG_REPEAT, 3), (FLAG_REPEAT, 2), (FLAG_REPEAT, 3)]);
        assert_eq!(list.unwrap(), nodes);
    }

    #[test]
    fn a_writer_of_a_ring_on_one_host_repeats_nothing() {
        let folder = RingFolder::create(Terms::default()).unwrap();
        let (ring, _) = Ring::<local::Service>::join(&folder, &scenario(), Role::Launcher, &Stop::default()).unwrap();
        assert!(ring.commit.writer().unwrap().0.repeats.is_none());
    }

    #[test]
    fn repeats_have_an_interval() {
        let folder = linked_folder();
        let (ring, _) = Ring::<local::Service>::join(&folder, &scenario(), Role::Launcher, &Stop::default()).unwrap();
        let commits = ring.commit.writer().unwrap();
        commits.send(ring.header(1, 0), Commit { hash: 1 }).unwrap();
        let late = ring.commit.0.data.subscriber_builder().history_request(0).create().unwrap();
        commits.0.repeats.as_ref().unwrap().borrow_mut().last_sent -= REPEAT_AFTER;
        (0..3).for_each(|_| commits.0.serve_joiners().unwrap());
        let heard = std::iter::from_fn(|| late.receive().unwrap()).count();
        assert_eq!(heard, 1);
    }

    #[test]
    fn sleeping_readers_are_notified_of_each_sample() {
        let folder = RingFolder::create(Terms::default()).unwrap();
        let (ring, _) = Ring::<local::Service>::join(&folder, &scenario(), Role::Launcher, &Stop::default()).unwrap();
        let is_woken = |listener: &iceoryx2::port::listener::Listener<local::Service>| {
            let mut woken = 0;
            listener.try_wait(|_| woken += 1).unwrap();
            woken > 0
        };
        let [commit, sensors] = [ring.commit.listener().unwrap(), ring.sensors.listener().unwrap()];
        let commits = ring.commit.writer().unwrap();
        let nodes = ring.sensors.list_writer(1).unwrap();
        assert_eq!([&commit, &sensors].map(is_woken), [false, false]);
        commits.send(ring.header(1, 0), Commit { hash: 1 }).unwrap();
        assert_eq!([&commit, &sensors].map(is_woken), [true, false]);
        let header = SensorsHeader { head: ring.header(0, 0), ..SensorsHeader::default() };
        nodes.send_list(header, &[SensorNode::default()]).unwrap();
        assert_eq!([&commit, &sensors].map(is_woken), [false, true]);
    }

    #[test]
    fn large_samples_are_repeated_later() {
        let mut repeats = Repeats::<[u32], skysink_common::message::SlotHeader>::of(2);
        repeats.store(Default::default(), &[0; 1_000]);
        assert!(repeats.after < Duration::from_millis(510), "{:?}", repeats.after);
        repeats.store(Default::default(), &vec![0; 1_000_000]);
        assert_eq!(repeats.after, Duration::from_millis(1_500), "4 MB");
    }
}
