//! The reading end of a topic: the sample of a slot or the next one, with or without waiting.

use std::collections::VecDeque;
use std::rc::Rc;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use skysink_common::message::{FLAG_REPEAT, SlotHeader};

use crate::admission::{Admission, Entry, order};
use crate::error::{NodeError, RingError};
use crate::refusals::Refusal;
use crate::sample::{Header, Payload};
use crate::topic::{MAX_EARLY, Shared, Topic};
use crate::wait::WaitContext;

/// Samples received in a row before the process does something else: a flood must not keep it from ending.
const MAX_IN_A_ROW: usize = 256;

/// Slots by which its peers can be ahead of a process without which the ring cannot go on.
pub(crate) const MAX_AHEAD: u64 = 2;

/// The reading end of a topic. Samples of slots that have passed are dropped, those that came early are held; foreign,
/// old and far samples are refused.
#[derive(Debug)]
pub struct Reader<S: Service + 'static, P: Payload + ?Sized, H: Header> {
    topic: Rc<Shared<S, P, H>>,
    subscriber: Subscriber<S, P, H>,
    /// The wake-ups of the topic; attached by the first wait.
    listener: Option<Listener<S>>,
    early: VecDeque<Sample<S, P, H>>,
    /// The order of the last sample that was taken, or dropped because its slot had passed.
    taken: Option<u64>,
    /// Whether the first sample that is held is the oldest that comes. Behind a link, a new reader begins anywhere among
    /// those that a writer repeats: it waits until one comes twice, or a new one.
    is_settled: bool,
    admission: Admission,
    /// The last slot that [`Reader::wait_until`] has seen.
    reached: Option<u64>,
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Topic<S, P, H> {
    /// A reader with room for `buffer` samples, which gets the newest samples even if they were sent before.
    ///
    /// # Errors
    /// If all readers' places are taken, or the system refuses.
    pub fn reader(&self, buffer: usize) -> Result<Reader<S, P, H>, RingError> {
        let topic = Rc::clone(&self.0);
        let builder = topic.data.subscriber_builder().history_request(topic.row.history).buffer_size(buffer);
        let subscriber = builder.create().map_err(|error| topic.refuse("read", &error))?;
        Ok(Reader {
            is_settled: topic.member.terms.link.is_none(),
            topic,
            subscriber,
            listener: None,
            early: VecDeque::with_capacity(MAX_EARLY),
            taken: None,
            admission: Admission::default(),
            reached: None,
        })
    }
}

/// What a reader finds of a slot.
#[derive(Debug)]
pub enum SlotSample<T> {
    /// Its sample.
    Here(T),
    /// Nothing yet.
    NotYet,
    /// A later sample; its own was sent before this process listened, and will not come. Only a process that may lag is
    /// told so.
    Passed,
}

impl<T> SlotSample<T> {
    /// The sample, if it is here.
    pub fn here(self) -> Option<T> {
        match self {
            Self::Here(sample) => Some(sample),
            Self::NotYet | Self::Passed => None,
        }
    }
}

impl<S: Service + 'static, P: Payload + ?Sized, H: Header> Reader<S, P, H> {
    /// The sample of `slot`.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn of_slot(&mut self, slot: u64) -> Result<SlotSample<Sample<S, P, H>>, RingError> {
        let limit = self.topic.member.max_ahead.map(|ahead| slot.saturating_add(ahead));
        let mut received = 0;
        loop {
            let all = self.receive(limit, &mut received)?;
            while self.early.front().is_some_and(|sample| sample.user_header().head().slot < slot) {
                self.take();
            }
            match self.early.front() {
                Some(sample) if sample.user_header().head().slot == slot => {
                    return Ok(self.take().map_or(SlotSample::NotYet, SlotSample::Here));
                }
                Some(_) if self.topic.member.max_ahead.is_none() && self.is_settled => return Ok(SlotSample::Passed),
                Some(_) => return Ok(SlotSample::NotYet),
                None if all || received >= MAX_IN_A_ROW => return Ok(SlotSample::NotYet),
                None => {}
            }
        }
    }

    /// Waits for the sample of `slot`; none if it has passed, which only happens to a process that may lag.
    ///
    /// # Errors
    /// A requested stop, the supervisor's death, or a broken ring.
    pub fn wait_for_slot(&mut self, wait: &mut WaitContext, slot: u64) -> Result<Option<Sample<S, P, H>>, NodeError> {
        self.wait(wait, slot, |reader| match reader.of_slot(slot)? {
            SlotSample::Here(sample) => Ok(Some(Some(sample))),
            SlotSample::NotYet => Ok(None),
            SlotSample::Passed => Ok(Some(None)),
        })
    }

    /// The next sample, in the order in which they were sent.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn next_sample(&mut self) -> Result<Option<Sample<S, P, H>>, RingError> {
        self.receive(None, &mut 0)?;
        Ok(if self.is_settled { self.take() } else { None })
    }

    /// Receives what has arrived, as far as there is room, so that its writer finds room in the buffer.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    pub fn receive_all(&mut self) -> Result<(), RingError> {
        self.receive(None, &mut 0).map(drop)
    }

    /// Waits for the next sample, which should be that of `slot`.
    ///
    /// # Errors
    /// As [`Reader::wait_for_slot`].
    pub fn wait_for_next(&mut self, wait: &mut WaitContext, slot: u64) -> Result<Sample<S, P, H>, NodeError> {
        self.wait(wait, slot, Self::next_sample)
    }

    /// Takes in samples until one is of `slot`, or of a later one.
    ///
    /// # Errors
    /// As [`Reader::wait_for_slot`].
    pub fn wait_until(&mut self, wait: &mut WaitContext, slot: u64) -> Result<(), NodeError> {
        while self.reached.is_none_or(|reached| reached < slot) {
            self.reached = Some(self.wait_for_next(wait, slot)?.user_header().head().slot);
        }
        Ok(())
    }

    /// Waits until `poll` finds something. It polls before the first pause and after each: notifications may be lost.
    fn wait<T>(
        &mut self,
        wait: &mut WaitContext,
        slot: u64,
        mut poll: impl FnMut(&mut Self) -> Result<Option<T>, RingError>,
    ) -> Result<T, NodeError> {
        let mut awaited = wait.begin(self.topic.row.name, slot, self.topic.row.from)?;
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

    /// Receives what has arrived, as far as there is room; true if that was all. Samples beyond slot `limit` are
    /// refused.
    fn receive(&mut self, limit: Option<u64>, received: &mut usize) -> Result<bool, RingError> {
        while self.early.len() < MAX_EARLY && *received < MAX_IN_A_ROW {
            *received += 1;
            let sample = P::receive(&self.subscriber).map_err(|error| self.topic.refuse("receive", &error))?;
            let Some(sample) = sample else { return Ok(true) };
            let publisher = sample.header().publisher_id();
            let entry = self.admission.check(&self.topic, publisher, sample.user_header().head(), limit);
            self.settle(&entry, sample.user_header().head());
            match entry {
                Entry::Refused => {}
                Entry::Known => self.early.push_back(sample),
                Entry::Repeated if self.has(sample.user_header().head()) => {}
                Entry::New | Entry::Repeated => {
                    self.early.push_back(sample);
                    self.early.make_contiguous().sort_by_key(|sample| order(sample.user_header().head()));
                }
            }
        }
        self.is_settled |= self.early.len() >= MAX_EARLY; // there is no room for older ones
        Ok(false)
    }

    /// Notes whether an admitted sample shows that none that is older will come: it is the first of all, new, or held.
    fn settle(&mut self, entry: &Entry, header: &SlotHeader) {
        let is_repeated = header.flags & FLAG_REPEAT != 0;
        self.is_settled |= !matches!(entry, Entry::Refused) && (header.slot == 0 || !is_repeated || self.has(header));
    }

    /// Whether a sample of this order was taken, or is held.
    fn has(&self, header: &SlotHeader) -> bool {
        let order_of = order(header);
        self.topic.row.several
            || self.taken.is_some_and(|taken| order_of <= taken)
            || self.early.iter().any(|sample| order(sample.user_header().head()) == order_of)
    }

    /// The first of the samples that are held.
    fn take(&mut self) -> Option<Sample<S, P, H>> {
        let sample = self.early.pop_front()?;
        self.taken = Some(order(sample.user_header().head()));
        Some(sample)
    }

    /// Counts a sample of `slot` that was admitted and then refused for its content.
    pub fn refuse(&self, slot: u64, refusal: Refusal) {
        self.topic.member.refusals.add(self.topic.row.name, slot, refusal, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::folder::RingFolder;
    use crate::role::Role;
    use crate::terms::LinkTerms;
    use crate::topics::{RING_BUFFER, Ring};
    use iceoryx2::port::publisher::Publisher;
    use skysink_common::message::{Commit, FLAG_END};
    use skysink_common::pace::Pace;
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::stop::Stop;
    use std::path::Path;

    type Commits = Reader<local::Service, Commit, SlotHeader>;

    /// A ring, and a writer of `commit` that is a link.
    struct Linked {
        ring: Ring<local::Service>,
        link: Publisher<local::Service, Commit, SlotHeader>,
        _folder: RingFolder,
    }

    impl Linked {
        fn new(terms: Option<LinkTerms>) -> Self {
            let scenario = Scenario::parse("name = 'x'\n", Path::new("x.toml"), Overrides::default()).unwrap();
            let mut folder = RingFolder::create(Pace::Max, Default::default(), 60.0, false, None).unwrap();
            terms.into_iter().for_each(|terms| folder.link(terms).unwrap());
            let (ring, _) = Ring::join(&folder, &scenario, Role::Launcher, &Stop::default()).unwrap();
            let link = ring.commit.0.data.publisher_builder().create().unwrap();
            Self { ring, link, _folder: folder }
        }

        fn send(&self, slot: u64, flags: u32, epoch: u32) {
            send(&self.link, SlotHeader { epoch, ..self.ring.header(slot, flags) });
        }

        /// A reader that the ring does not wait for.
        fn observer(&self) -> Commits {
            Ring::observe(&self._folder).unwrap().commit.reader(RING_BUFFER).unwrap()
        }
    }

    fn send(writer: &Publisher<local::Service, Commit, SlotHeader>, header: SlotHeader) {
        let mut sample = writer.loan_uninit().unwrap();
        *sample.user_header_mut() = header;
        sample.write_payload(Commit { hash: header.slot }).send().unwrap();
    }

    const LINK: Option<LinkTerms> = Some(LinkTerms { version: 0, scenario: 0 });

    fn here(reader: &mut Commits, slot: u64) -> Option<u64> {
        reader.of_slot(slot).unwrap().here().map(|sample| sample.payload().hash)
    }

    fn next(reader: &mut Commits) -> Option<u64> {
        reader.next_sample().unwrap().map(|sample| sample.payload().hash)
    }

    #[test]
    fn a_sample_that_a_link_has_lost_is_taken_from_its_repeat() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        [1, 3].into_iter().for_each(|slot| linked.send(slot, 0, 0));
        assert_eq!([1, 2].map(|slot| here(&mut reader, slot)), [Some(1), None]);
        [2, 3, 2, 3].into_iter().for_each(|slot| linked.send(slot, FLAG_REPEAT, 0));
        assert_eq!([2, 3, 4].map(|slot| here(&mut reader, slot)), [Some(2), Some(3), None], "each once");
        linked.send(4, 0, 0);
        assert_eq!(here(&mut reader, 4), Some(4));
        assert_eq!(linked.ring.refusals.total(), 0);
    }

    #[test]
    fn repeats_do_not_fill_the_buffer_of_a_reader_that_receives_them() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        linked.send(1, 0, 0);
        assert_eq!(here(&mut reader, 1), Some(1));
        for _ in 0..2 {
            (1..RING_BUFFER).for_each(|_| linked.send(1, FLAG_REPEAT, 0));
            reader.receive_all().unwrap();
        }
        linked.send(2, 0, 0);
        assert_eq!(here(&mut reader, 2), Some(2));
    }

    #[test]
    fn a_new_reader_behind_a_link_begins_with_the_oldest_repeat() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
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
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        linked.send(0, FLAG_REPEAT, 0);
        assert_eq!(next(&mut reader), Some(0), "the first of all");
        let running = Linked::new(LINK);
        let mut reader = running.ring.commit.reader(RING_BUFFER).unwrap();
        running.send(8, 0, 0);
        assert_eq!([(); 2].map(|()| next(&mut reader)), [Some(8), None]);
    }

    #[test]
    fn a_process_that_was_started_again_is_heard_behind_the_same_link() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        [1, 2].into_iter().for_each(|slot| linked.send(slot, 0, 0));
        assert_eq!([1, 2].map(|slot| here(&mut reader, slot)), [Some(1), Some(2)]);
        [1, 2, 3].into_iter().for_each(|slot| linked.send(slot, 0, 1));
        assert_eq!(here(&mut reader, 3), Some(3));
        assert_eq!(linked.ring.refusals.total(), 0);
    }

    #[test]
    fn what_was_taken_is_not_taken_again_from_its_repeat() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        [1, 2].into_iter().for_each(|slot| linked.send(slot, 0, 0));
        assert_eq!([(); 3].map(|()| next(&mut reader)), [Some(1), Some(2), None]);
        [2, 1].into_iter().for_each(|slot| linked.send(slot, FLAG_REPEAT, 0));
        assert_eq!(next(&mut reader), None);
        [1, 2].into_iter().for_each(|slot| linked.send(slot, 0, 1)); // by a process that was started again
        assert_eq!([(); 3].map(|()| next(&mut reader)), [Some(1), Some(2), None]);
        linked.send(1, 0, 1); // a link that was started again
        assert_eq!(next(&mut reader), None);
    }

    #[test]
    fn a_new_reader_with_no_room_for_an_older_repeat_waits_for_none() {
        let linked = Linked::new(LINK);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        (5..5 + MAX_EARLY as u64).for_each(|slot| linked.send(slot, FLAG_REPEAT, 0));
        assert_eq!(next(&mut reader), Some(5));
    }

    #[test]
    fn an_observer_has_missed_a_slot_only_once_no_older_repeat_can_come() {
        let linked = Linked::new(LINK);
        let mut reader = linked.observer();
        linked.send(3, FLAG_REPEAT, 0);
        assert!(matches!(reader.of_slot(2).unwrap(), SlotSample::NotYet));
        linked.send(2, FLAG_REPEAT, 0);
        assert_eq!([2, 3].map(|slot| here(&mut reader, slot)), [Some(2), Some(3)]);
        linked.send(5, 0, 0);
        assert!(matches!(reader.of_slot(4).unwrap(), SlotSample::Passed));
    }

    #[test]
    fn a_sample_of_another_run_or_of_a_slot_that_the_ring_cannot_have_reached_is_refused() {
        let linked = Linked::new(None);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        let header = linked.ring.header(1, 0);
        send(&linked.link, SlotHeader { mission: header.mission + 1, ..header });
        assert_eq!((here(&mut reader, 1), linked.ring.refusals.total()), (None, 1));
        linked.send(1 + MAX_AHEAD + 1, 0, 0);
        assert_eq!((here(&mut reader, 1), linked.ring.refusals.total()), (None, 2));
        linked.send(1 + MAX_AHEAD, 0, 0);
        assert_eq!((here(&mut reader, 1), linked.ring.refusals.total()), (None, 2));
        assert_eq!(here(&mut reader, 1 + MAX_AHEAD), Some(1 + MAX_AHEAD));
    }

    #[test]
    fn beside_a_writer_that_is_alive_another_is_not_heard() {
        let linked = Linked::new(None);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        linked.send(1, 0, 0);
        assert_eq!(here(&mut reader, 1), Some(1));
        let second = linked.ring.commit.0.data.publisher_builder().create().unwrap();
        send(&second, linked.ring.header(2, 0));
        assert_eq!((here(&mut reader, 2), linked.ring.refusals.total()), (None, 1));
        linked.send(2, 0, 0);
        assert_eq!(here(&mut reader, 2), Some(2));
    }

    #[test]
    fn the_end_comes_after_a_sample_of_the_same_slot() {
        let linked = Linked::new(None);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        [0, FLAG_END].into_iter().for_each(|flags| linked.send(5, flags, 0));
        let mut flags = || reader.next_sample().unwrap().map(|sample| sample.user_header().flags);
        assert_eq!([(); 3].map(|()| flags()), [Some(0), Some(FLAG_END), None]);
        assert_eq!(linked.ring.refusals.total(), 0);
    }

    #[test]
    fn without_a_link_a_writer_that_repeats_itself_unsaid_is_refused() {
        let linked = Linked::new(None);
        let mut reader = linked.ring.commit.reader(RING_BUFFER).unwrap();
        [1, 2, 1].into_iter().for_each(|slot| linked.send(slot, 0, 0));
        assert_eq!([1, 2].map(|slot| here(&mut reader, slot)), [Some(1), Some(2)]);
        assert_eq!(here(&mut reader, 3), None);
        assert_eq!(linked.ring.refusals.total(), 1);
        linked.send(2, FLAG_REPEAT, 0);
        assert_eq!(here(&mut reader, 3), None);
        assert_eq!(linked.ring.refusals.total(), 1, "it said so");
    }
}
