//! The orders to a vehicle that it has not answered yet, which are repeated because a link may lose them: speeds and
//! waypoints, which change no mode.
//!
//! An answer repeats only the command of its order, so that one may belong to an order that a newer one has replaced:
//! each copy that was sent has one answer, and the oldest copy is answered first.

use crate::telemetry::{ACCEPTED, IN_PROGRESS, Order};

/// Time after which an order without an answer is repeated [s].
const REPEAT_S: f64 = 0.5;

/// Time after which the answer to a copy of an order is lost [s].
const ANSWERED_S: f64 = 4.0;

/// Time after which a take-off or return without an answer was lost [s], after which one that was refused may be
/// accepted, and after which an accepted return has had no effect.
const LOST_S: f64 = 3.0;
const REFUSED_S: f64 = 1.0;
const IGNORED_S: f64 = 6.0;

/// The last order that changes a mode, or arms: it is repeated by the table alone.
#[derive(Debug, Clone, Copy)]
struct SentOrder {
    order: Order,
    sent_s: f64,
    /// The result, and when it came [s].
    answer: Option<(u8, f64)>,
}

/// Unanswered orders, one of each command: a newer one replaces it.
#[derive(Debug, Clone, Default)]
pub struct Outbox {
    sent: Option<SentOrder>,
    orders: Vec<Unanswered>,
    /// The copies that were sent and not answered, of orders that were replaced, too.
    copies: Vec<SentCopy>,
}

#[derive(Debug, Clone)]
struct SentCopy {
    order: Order,
    sent_s: f64,
}

#[derive(Debug, Clone)]
struct Unanswered {
    order: Order,
    /// When it is sent for the next time [s].
    due_s: f64,
}

impl Outbox {
    /// Sends `order` at `now_s` [s], again and again until it is answered.
    pub fn send(&mut self, order: Order, now_s: f64) {
        self.orders.retain(|unanswered| unanswered.order.command() != order.command());
        self.orders.push(Unanswered { order, due_s: now_s });
    }

    /// Forgets all orders, not their copies: answers to them may still come.
    pub fn clear(&mut self) {
        self.orders.clear();
    }

    /// Notes that an order was sent that changes a mode, or arms.
    pub fn note_sent(&mut self, order: Order, now_s: f64) {
        self.sent = Some(SentOrder { order, sent_s: now_s, answer: None });
    }

    /// Takes in an answer to the last of these. Returns whether it is its first final one.
    pub fn hear_answer(&mut self, command: u16, result: u8, now_s: f64) -> bool {
        let sent = self.sent.as_mut().filter(|sent| sent.order.command() == Some(command) && result != IN_PROGRESS);
        sent.is_some_and(|sent| sent.answer.replace((result, now_s)).is_none())
    }

    /// The result of the last of these, if it was answered.
    pub fn result(&self) -> Option<u8> {
        self.sent.and_then(|sent| sent.answer).map(|(result, _)| result)
    }

    /// Whether the last of these was refused.
    pub fn is_refused(&self) -> bool {
        self.result().is_some_and(|result| result != ACCEPTED)
    }

    /// Whether the last of these was lost or refused, or has had no effect, so that it may be sent again.
    pub fn may_repeat(&self, now_s: f64) -> bool {
        self.sent.is_none_or(|SentOrder { order, sent_s, answer }| match answer {
            None => now_s - sent_s >= LOST_S,
            Some((ACCEPTED, _)) => order == Order::Return && now_s - sent_s >= IGNORED_S,
            Some((_, answered_s)) => now_s - answered_s >= REFUSED_S,
        })
    }

    /// Takes in an answer to the oldest copy of an order of `command` at `now_s` [s]; returns that order if the answer
    /// is final, and no newer one has replaced it. The others of its copies count as unanswered, as their answers come
    /// late.
    pub fn answer(&mut self, command: u16, result: u8, now_s: f64) -> Option<Order> {
        if result == IN_PROGRESS {
            return None;
        }
        self.copies.retain(|copy| now_s - copy.sent_s < ANSWERED_S);
        let copy = self.copies.iter().position(|copy| copy.order.command() == Some(command))?;
        let SentCopy { order, .. } = self.copies.remove(copy);
        let index = self.orders.iter().position(|unanswered| unanswered.order == order)?;
        Some(self.orders.remove(index).order)
    }

    /// Whether an order is due at `now_s` [s].
    pub fn is_due(&self, now_s: f64) -> bool {
        self.orders.iter().any(|unanswered| now_s >= unanswered.due_s)
    }

    /// The orders that are due at `now_s` [s], in the order in which they were given.
    pub fn due(&mut self, now_s: f64) -> impl Iterator<Item = Order> {
        let Self { orders, copies, .. } = self;
        copies.retain(|copy| now_s - copy.sent_s < ANSWERED_S);
        orders.iter_mut().filter(move |unanswered| now_s >= unanswered.due_s).map(move |unanswered| {
            unanswered.due_s = now_s + REPEAT_S;
            copies.push(SentCopy { order: unanswered.order, sent_s: now_s });
            unanswered.order
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn due(outbox: &mut Outbox, now_s: f64) -> Vec<Order> {
        outbox.due(now_s).collect()
    }

    #[test]
    fn an_order_is_repeated_until_acknowledged() {
        let mut outbox = Outbox::default();
        outbox.send(Order::Arm, 1.0);
        outbox.send(Order::Return, 1.0);
        assert_eq!(due(&mut outbox, 1.0), [Order::Arm, Order::Return]);
        assert_eq!(due(&mut outbox, 1.4), []);
        assert_eq!(outbox.answer(400, 4, 1.4), Some(Order::Arm), "also if it is refused");
        assert_eq!(outbox.answer(20, IN_PROGRESS, 1.4), None);
        assert_eq!(due(&mut outbox, 1.5), [Order::Return]);
        assert_eq!(outbox.answer(192, 0, 1.5), None, "nobody has asked");
    }

    #[test]
    fn a_late_answer_belongs_to_the_order_that_was_replaced() {
        let mut outbox = Outbox::default();
        outbox.send(Order::Speed(1.0), 0.0);
        assert_eq!([0.0, 0.5].map(|now_s| due(&mut outbox, now_s).len()), [1, 1], "repeated");
        outbox.send(Order::Speed(2.0), 0.6);
        assert_eq!(due(&mut outbox, 0.6), [Order::Speed(2.0)]);
        assert_eq!([outbox.answer(178, 4, 0.7), outbox.answer(178, 0, 0.7)], [None, None], "to the first");
        assert_eq!(outbox.answer(178, 4, 0.8), Some(Order::Speed(2.0)));
        assert_eq!(outbox.answer(178, 0, 0.9), None, "one too many");
    }

    #[test]
    fn an_order_is_repeated_until_it_is_answered_itself_also_after_lost_answers() {
        let mut outbox = Outbox::default();
        outbox.send(Order::Speed(1.0), 0.0);
        assert_eq!(due(&mut outbox, 0.0).len(), 1, "its answer is lost");
        outbox.send(Order::Speed(2.0), 1.0);
        assert_eq!(due(&mut outbox, 1.0).len(), 1);
        assert_eq!(outbox.answer(178, 0, 1.1), None, "it may be to the first");
        assert_eq!(due(&mut outbox, 1.5), [Order::Speed(2.0)]);
        assert_eq!(outbox.answer(178, 0, 1.6), Some(Order::Speed(2.0)));
        outbox.send(Order::Speed(3.0), 6.0);
        assert_eq!(due(&mut outbox, 6.0).len(), 1);
        assert_eq!(outbox.answer(178, 0, 6.1), Some(Order::Speed(3.0)), "the lost ones do not come any more");
    }

    #[test]
    fn an_order_that_changes_the_mode_may_be_repeated_once_it_was_lost_or_refused() {
        let repeats = |order: Order, answer: Option<u8>| {
            let mut outbox = Outbox::default();
            assert!(outbox.may_repeat(0.0));
            outbox.note_sent(order, 0.0);
            assert!(!outbox.hear_answer(192, 4, 0.5) && !outbox.hear_answer(20, IN_PROGRESS, 0.5));
            let command = order.command().unwrap();
            answer.iter().for_each(|result| assert!(outbox.hear_answer(command, *result, 0.5)));
            let first = (0..100).find(|tenth| outbox.may_repeat(f64::from(*tenth) / 10.0));
            (first, outbox.is_refused())
        };
        assert_eq!(
            [None, Some(4), Some(0)].map(|answer| repeats(Order::Return, answer)),
            [(Some(30), false), (Some(15), true), (Some(60), false)]
        );
        let take_off = Order::TakeOff(crate::autopilot::Altitude::AboveHome(20.0));
        assert_eq!(repeats(take_off, Some(0)), (None, false), "its motors spool up");
    }

    #[test]
    fn a_newer_order_of_the_same_command_replaces_the_older_one() {
        let mut outbox = Outbox::default();
        outbox.send(Order::Speed(1.0), 0.0);
        outbox.send(Order::Speed(2.0), 0.1);
        assert_eq!(due(&mut outbox, 0.1), [Order::Speed(2.0)]);
        assert!(!outbox.is_due(0.1) && outbox.is_due(0.6), "it was sent");
    }
}
