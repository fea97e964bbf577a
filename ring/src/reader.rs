//! The reading end of a topic: reads the sample of a slot, or the next one, with or without waiting.

use std::collections::VecDeque;
use std::rc::Rc;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use skysink_common::message::{FLAG_REPEAT, SlotHeader};

use crate::admission::{Admission, Verdict, order};
use crate::error::{NodeError, RingError};
use crate::refusals::Refusal;
use crate::role::Role;
use crate::sample::{Header, Payload};
use crate::topic::{MAX_EARLY, SamplesPerSlot, Topic, TopicShared};
use crate::wait::WaitContext;

/// Most samples received before control returns to the caller, so that a flood of samples cannot block a stop.
const MAX_BATCH: usize = 256;

/// Buffer of a process that neither shows nor records the ring [samples]: it is at most two slots behind, but restarted
/// writers repeat samples. Unused memory costs nothing.
pub(crate) const RING_BUFFER: usize = 16;

/// Most slots by which the ring can be ahead of a process that it waits for.
pub(crate) const MAX_AHEAD: u64 = 2;

/// The reading end of a topic. Samples of past slots are dropped, those of later slots are kept; samples of other runs
/// or writers, repeated ones and those of impossible slots are refused.
#[derive(Debug)]
pub struct Reader<S: Service + 'static, P: Payload + ?Sized, H: Header> {
    topic: Rc<TopicShared<S, P, H>>,
    subscriber: Subscriber<S, P, H>,
    /// The notifications of the topic; attached by the first wait.
    listener: Option<Listener<S>>,
    /// Samples that were received but not taken, by order.
    early: VecDeque<Sample<S, P, H>>,
    /// The order of the last sample that was taken or dropped.
    taken: Option<u64>,
    /// The latest slot of an admitted sample; `None` before the first.
    newest: Option<u64>,
    /// Whether no sample older than those in `early` will come. Behind a link, a new reader may begin in the middle of
    /// the samples that a writer repeats: it waits until one comes twice, or a new one.
    is_settled: bool,
    admission: Admission,
    /// The last slot received by [`Reader::wait_until`].
    reached: Option<u64>,
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Topic<S, P, H> {
    /// A reader, which first receives the history of the topic. The viewer and the launcher have the buffer of the
    /// topic, other processes a small one.
    ///
    /// # Errors
    /// If the topic has its maximum of readers, or iceoryx2 fails.
    pub fn reader(&self) -> Result<Reader<S, P, H>, RingError> {
        let topic = Rc::clone(&self.0);
        let is_recording = matches!(topic.member.role, Some(Role::Viewer | Role::Launcher));
        let buffer = if is_recording { topic.row.buffer } else { topic.row.buffer.min(RING_BUFFER) };
        let builder = topic.data.subscriber_builder().history_request(topic.row.history).buffer_size(buffer);
        let subscriber = builder.create().map_err(|error| topic.refuse("read", &error))?;
        Ok(Reader {
            is_settled: topic.member.terms.link.is_none(),
            topic,
            subscriber,
            listener: None,
            early: VecDeque::with_capacity(MAX_EARLY),
            taken: None,
            newest: None,
            admission: Admission::default(),
            reached: None,
        })
    }
}

/// The result of polling for the sample of a slot.
#[derive(Debug)]
pub enum SlotSample<T> {
    /// The sample.
    Available(T),
    /// The sample has not arrived yet.
    Pending,
    /// Only a later sample has arrived: the sample was sent before this process joined, and will not come. Returned
    /// only to processes that may lag.
    Passed,
}

impl<T> SlotSample<T> {
    /// The sample, if it is available.
    pub fn available(self) -> Option<T> {
        match self {
            Self::Available(sample) => Some(sample),
            Self::Pending | Self::Passed => None,
        }
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Reader<S, P, H> {
    /// Polls for the sample of `slot`.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn poll_slot(&mut self, slot: u64) -> Result<SlotSample<Sample<S, P, H>>, RingError> {
        let limit = self.topic.member.max_ahead.map(|ahead| slot.saturating_add(ahead));
        let mut received = 0;
        loop {
            let has_received_all = self.receive(limit, &mut received)?;
            while self.early.front().is_some_and(|sample| sample.user_header().head().slot < slot) {
                self.take();
            }
            match self.early.front() {
                Some(sample) if sample.user_header().head().slot == slot => {
                    return Ok(self.take().map_or(SlotSample::Pending, SlotSample::Available));
                }
                Some(_) if self.topic.member.max_ahead.is_none() && self.is_settled => return Ok(SlotSample::Passed),
                Some(_) => return Ok(SlotSample::Pending),
                None if has_received_all || received >= MAX_BATCH => return Ok(SlotSample::Pending),
                None => {}
            }
        }
    }

    /// Waits for the sample of `slot`; `None` if it has passed, which happens only in processes that may lag.
    ///
    /// # Errors
    /// On a requested stop, on the launcher's death, or if iceoryx2 fails.
    pub fn wait_for_slot(&mut self, wait: &mut WaitContext, slot: u64) -> Result<Option<Sample<S, P, H>>, NodeError> {
        self.wait(wait, slot, |reader| match reader.poll_slot(slot)? {
            SlotSample::Available(sample) => Ok(Some(Some(sample))),
            SlotSample::Pending => Ok(None),
            SlotSample::Passed => Ok(Some(None)),
        })
    }

    /// The next sample in sending order; `None` if there is none yet.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn next_sample(&mut self) -> Result<Option<Sample<S, P, H>>, RingError> {
        self.receive(None, &mut 0)?;
        Ok(if self.is_settled { self.take() } else { None })
    }

    /// Receives pending samples, as far as there is room, which frees the buffer for the writer.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn receive_all(&mut self) -> Result<(), RingError> {
        self.receive(None, &mut 0).map(drop)
    }

    /// Waits for the next sample, expected to be that of `slot`.
    ///
    /// # Errors
    /// As [`Reader::wait_for_slot`].
    pub fn wait_for_next(&mut self, wait: &mut WaitContext, slot: u64) -> Result<Sample<S, P, H>, NodeError> {
        self.wait(wait, slot, Self::next_sample)
    }

    /// Waits for a sample of `slot` or a later slot, and drops those before; `None` if there was one already.
    ///
    /// # Errors
    /// As [`Reader::wait_for_slot`].
    pub fn wait_until(&mut self, wait: &mut WaitContext, slot: u64) -> Result<Option<Sample<S, P, H>>, NodeError> {
        let mut last = None;
        while self.reached.is_none_or(|reached| reached < slot) {
            let sample = self.wait_for_next(wait, slot)?;
            self.reached = Some(sample.user_header().head().slot);
            last = Some(sample);
        }
        Ok(last)
    }

    /// Waits until `poll` returns a value. It polls before the first pause and after each, because notifications may be
    /// lost.
    fn wait<T>(
        &mut self,
        wait: &mut WaitContext,
        slot: u64,
        mut poll: impl FnMut(&mut Self) -> Result<Option<T>, RingError>,
    ) -> Result<T, NodeError> {
        let mut awaited = wait.begin(self.topic.row.name, slot, self.topic.row.writer)?;
        loop {
            if let Some(found) = poll(self)? {
                wait.end(awaited);
                return Ok(found);
            }
            match &self.listener {
                Some(listener) => wait.pause(listener, &mut awaited)?,
                None => self.listener = Some(self.topic.listener()?),
            }
        }
    }

    /// Receives pending samples, as far as there is room, and adds their number to `received`; true if none is left.
    /// Samples after slot `limit` are refused.
    fn receive(&mut self, limit: Option<u64>, received: &mut usize) -> Result<bool, RingError> {
        while self.early.len() < MAX_EARLY && *received < MAX_BATCH {
            *received += 1;
            let sample = P::receive(&self.subscriber).map_err(|error| self.topic.refuse("receive", &error))?;
            let Some(sample) = sample else { return Ok(true) };
            let verdict = self.admission.check(&self.topic, &sample, limit);
            self.settle(&verdict, sample.user_header().head());
            if !matches!(verdict, Verdict::Refused) {
                self.newest = self.newest.max(Some(sample.user_header().head().slot));
            }
            match verdict {
                Verdict::Refused => {}
                Verdict::Next => self.early.push_back(sample),
                Verdict::Repeated if self.has_seen(sample.user_header().head()) => {}
                Verdict::NewWriter | Verdict::Repeated => {
                    self.early.push_back(sample);
                    self.early.make_contiguous().sort_by_key(|sample| order(sample.user_header().head()));
                }
            }
        }
        self.is_settled |= self.early.len() >= MAX_EARLY; // no room for older samples
        Ok(false)
    }

    /// Sets `is_settled` if an admitted sample shows that no older one will come: it is that of slot 0, not a repeat,
    /// or seen before.
    fn settle(&mut self, verdict: &Verdict, header: &SlotHeader) {
        let is_admitted = !matches!(verdict, Verdict::Refused);
        let is_repeated = header.flags & FLAG_REPEAT != 0;
        self.is_settled |= is_admitted && (header.slot == 0 || !is_repeated || self.has_seen(header));
    }

    /// Whether a sample of this order was taken, or is in `early`.
    fn has_seen(&self, header: &SlotHeader) -> bool {
        let order_of = order(header);
        self.topic.row.samples == SamplesPerSlot::Any
            || self.taken.is_some_and(|taken| order_of <= taken)
            || self.early.iter().any(|sample| order(sample.user_header().head()) == order_of)
    }

    /// Takes the first sample of `early`.
    fn take(&mut self) -> Option<Sample<S, P, H>> {
        let sample = self.early.pop_front()?;
        self.taken = Some(order(sample.user_header().head()));
        Some(sample)
    }

    /// The latest slot of which a sample was received, also if it came too late; `None` before the first.
    pub fn newest_slot(&self) -> Option<u64> {
        self.newest
    }

    /// Counts the refusal of an admitted sample of `slot` because of its content.
    pub fn refuse(&self, slot: u64, refusal: Refusal) {
        self.topic.refusals.add(self.topic.row.name, slot, refusal, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::folder::RingFolder;
    use crate::terms::{LinkTerms, Terms};
    use crate::topics::Ring;
    use iceoryx2::port::publisher::Publisher;
    use skysink_common::message::{Commit, FLAG_END};
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::stop::Stop;
    use std::path::Path;

    type Commits = Reader<local::Service, Commit, SlotHeader>;

    /// A ring, and a writer of `commit` that acts as a link.
    struct Linked {
        ring: Ring<local::Service>,
        link: Publisher<local::Service, Commit, SlotHeader>,
        _folder: RingFolder,
    }

    impl Linked {
        fn new(link: Option<LinkTerms>) -> Self {
            let scenario = Scenario::parse("name = 'x'\n", Path::new("x.toml"), Overrides::default()).unwrap();
            let folder = RingFolder::create(Terms { link, ..Terms::default() }).unwrap();
            let (ring, _) = Ring::join(&folder, &scenario, Role::Launcher, &Stop::default()).unwrap();
            let link = ring.commit.0.data.publisher_builder().create().unwrap();
            Self { ring, link, _folder: folder }
        }

        fn send(&self, slot: u64, flags: u32, epoch: u32) {
            send(&self.link, SlotHeader { epoch, ..self.ring.header(slot, flags) });
        }

        /// A reader that the ring does not wait for.
        fn observer(&self) -> Commits {
            Ring::observe(&self._folder).unwrap().commit.reader().unwrap()
        }
    }

    fn send(writer: &Publisher<local::Service, Commit, SlotHeader>, header: SlotHeader) {
        let mut sample = writer.loan_uninit().unwrap();
        *sample.user_header_mut() = header;
        sample.write_payload(Commit { hash: header.slot }).send().unwrap();
    }

    const LINK: Option<LinkTerms> = Some(LinkTerms { version: 0, scenario: 0 });

    fn poll(reader: &mut Commits, slot: u64) -> Option<u64> {
        reader.poll_slot(slot).unwrap().available().map(|sample| sample.payload().hash)
    }

    fn next(reader: &mut Commits) -> Option<u64> {
        reader.next_sample().unwrap().map(|sample| sample.payload().hash)
    }

    #[test]
    fn a_sample_lost_by_a_link_is_received_from_its_repeat() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader().unwrap();
        [1, 3].into_iter().for_each(|slot| linked.send(slot, 0, 0));
        assert_eq!([1, 2].map(|slot| poll(&mut reader, slot)), [Some(1), None]);
        [2, 3, 2, 3].into_iter().for_each(|slot| linked.send(slot, FLAG_REPEAT, 0));
        assert_eq!([2, 3, 4].map(|slot| poll(&mut reader, slot)), [Some(2), Some(3), None], "each once");
        linked.send(4, 0, 0);
        assert_eq!(poll(&mut reader, 4), Some(4));
        assert_eq!(linked.ring.refusals.total(), 0);
    }

    #[test]
    fn repeats_do_not_fill_the_buffer_of_an_active_reader() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader().unwrap();
        linked.send(1, 0, 0);
        assert_eq!(poll(&mut reader, 1), Some(1));
        for _ in 0..2 {
            (1..RING_BUFFER).for_each(|_| linked.send(1, FLAG_REPEAT, 0));
            reader.receive_all().unwrap();
        }
        linked.send(2, 0, 0);
        assert_eq!(poll(&mut reader, 2), Some(2));
    }

    #[test]
    fn a_new_reader_behind_a_link_starts_with_the_oldest_repeat() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader().unwrap();
        linked.send(8, FLAG_REPEAT, 0);
        assert_eq!(next(&mut reader), None, "there may be an older one");
        linked.send(7, FLAG_REPEAT, 0);
        assert_eq!(next(&mut reader), None);
        linked.send(8, FLAG_REPEAT, 0);
        assert_eq!([(); 3].map(|()| next(&mut reader)), [Some(7), Some(8), None]);
    }

    #[test]
    fn a_new_reader_behind_a_link_does_not_wait_where_nothing_is_repeated() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader().unwrap();
        linked.send(0, FLAG_REPEAT, 0);
        assert_eq!(next(&mut reader), Some(0), "the first of all");
        let running = Linked::new(LINK);
        let mut reader = running.ring.commit.reader().unwrap();
        running.send(8, 0, 0);
        assert_eq!([(); 2].map(|()| next(&mut reader)), [Some(8), None]);
    }

    #[test]
    fn a_restarted_process_is_admitted_behind_the_same_link() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader().unwrap();
        [1, 2].into_iter().for_each(|slot| linked.send(slot, 0, 0));
        assert_eq!([1, 2].map(|slot| poll(&mut reader, slot)), [Some(1), Some(2)]);
        [1, 2, 3].into_iter().for_each(|slot| linked.send(slot, 0, 1));
        assert_eq!(poll(&mut reader, 3), Some(3));
        assert_eq!(linked.ring.refusals.total(), 0);
    }

    #[test]
    fn a_received_sample_is_not_received_again_from_its_repeat() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader().unwrap();
        [1, 2].into_iter().for_each(|slot| linked.send(slot, 0, 0));
        assert_eq!([(); 3].map(|()| next(&mut reader)), [Some(1), Some(2), None]);
        [2, 1].into_iter().for_each(|slot| linked.send(slot, FLAG_REPEAT, 0));
        assert_eq!(next(&mut reader), None);
        [1, 2].into_iter().for_each(|slot| linked.send(slot, 0, 1)); // by a restarted process
        assert_eq!([(); 3].map(|()| next(&mut reader)), [Some(1), Some(2), None]);
        linked.send(1, 0, 1); // a restarted link
        assert_eq!(next(&mut reader), None);
    }

    #[test]
    fn a_new_reader_with_a_full_buffer_does_not_wait_for_older_repeats() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader().unwrap();
        (5..5 + MAX_EARLY as u64).for_each(|slot| linked.send(slot, FLAG_REPEAT, 0));
        assert_eq!(next(&mut reader), Some(5));
    }

    #[test]
    fn an_observer_reports_a_missed_slot_only_after_its_last_possible_repeat() {
        let linked = Linked::new(LINK);
        let mut reader = linked.observer();
        linked.send(3, FLAG_REPEAT, 0);
        assert!(matches!(reader.poll_slot(2).unwrap(), SlotSample::Pending));
        linked.send(2, FLAG_REPEAT, 0);
        assert_eq!([2, 3].map(|slot| poll(&mut reader, slot)), [Some(2), Some(3)]);
        linked.send(5, 0, 0);
        assert!(matches!(reader.poll_slot(4).unwrap(), SlotSample::Passed));
    }

    #[test]
    fn a_sample_of_another_run_or_a_future_slot_is_refused() {
        let linked = Linked::new(None);
        let mut reader = linked.ring.commit.reader().unwrap();
        let header = linked.ring.header(1, 0);
        send(&linked.link, SlotHeader { mission: header.mission + 1, ..header });
        assert_eq!((poll(&mut reader, 1), linked.ring.refusals.total()), (None, 1));
        linked.send(1 + MAX_AHEAD + 1, 0, 0);
        assert_eq!((poll(&mut reader, 1), linked.ring.refusals.total()), (None, 2));
        linked.send(1 + MAX_AHEAD, 0, 0);
        assert_eq!((poll(&mut reader, 1), linked.ring.refusals.total()), (None, 2));
        assert_eq!(poll(&mut reader, 1 + MAX_AHEAD), Some(1 + MAX_AHEAD));
    }

    #[test]
    fn a_second_writer_is_ignored_while_the_first_is_alive() {
        let linked = Linked::new(None);
        let mut reader = linked.ring.commit.reader().unwrap();
        linked.send(1, 0, 0);
        assert_eq!(poll(&mut reader, 1), Some(1));
        let second = linked.ring.commit.0.data.publisher_builder().create().unwrap();
        send(&second, linked.ring.header(2, 0));
        assert_eq!((poll(&mut reader, 2), linked.ring.refusals.total()), (None, 1));
        linked.send(2, 0, 0);
        assert_eq!(poll(&mut reader, 2), Some(2));
    }

    #[test]
    fn the_end_is_delivered_after_the_sample_of_the_same_slot() {
        let linked = Linked::new(None);
        let mut reader = linked.ring.commit.reader().unwrap();
        [0, FLAG_END].into_iter().for_each(|flags| linked.send(5, flags, 0));
        let mut flags = || reader.next_sample().unwrap().map(|sample| sample.user_header().flags);
        assert_eq!([(); 3].map(|()| flags()), [Some(0), Some(FLAG_END), None]);
        assert_eq!(linked.ring.refusals.total(), 0);
    }

    #[test]
    fn without_a_link_a_repeat_without_its_flag_is_refused() {
        let linked = Linked::new(None);
        let mut reader = linked.ring.commit.reader().unwrap();
        [1, 2, 1].into_iter().for_each(|slot| linked.send(slot, 0, 0));
        assert_eq!([1, 2].map(|slot| poll(&mut reader, slot)), [Some(1), Some(2)]);
        assert_eq!(poll(&mut reader, 3), None);
        assert_eq!(linked.ring.refusals.total(), 1);
        linked.send(2, FLAG_REPEAT, 0);
        assert_eq!(poll(&mut reader, 3), None);
        assert_eq!(linked.ring.refusals.total(), 1, "with the flag");
    }
}
