//! The orders to a vehicle that it has not answered yet, which are repeated because a link may lose them.
//!
//! An answer repeats only the command of its order, so that one may belong to an order that a newer one has replaced: each
//! copy that was sent has one answer, and the oldest copy is answered first.

use crate::telemetry::{IN_PROGRESS, Order};

/// Time after which an order without an answer is repeated [s].
const REPEAT_S: f64 = 0.5;

/// The same of an order to arm [s]: longer than answers take on slow links, so that there is one answer.
const REPEAT_ARMING_S: f64 = 3.0;

/// Time after which the answer to a copy of an order is lost [s].
const ANSWERED_S: f64 = 4.0;

/// Unanswered orders, one of each command: a newer one replaces it.
#[derive(Debug, Clone, Default)]
pub struct Outbox {
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

    /// Whether the order of the command of `order` is unanswered.
    pub fn has(&self, order: &Order) -> bool {
        self.orders.iter().any(|unanswered| unanswered.order.command() == order.command())
    }

    /// Takes in an answer to the oldest copy of an order of `command` at `now_s` [s]; returns that order if the answer is
    /// final, and no newer one has replaced it. The others of its copies count as unanswered, as their answers come late.
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

    /// The orders that are due at `now_s` [s] and that `may_send`, in the order in which they were given; the others
    /// stay due.
    pub fn due(&mut self, now_s: f64, may_send: impl Fn(&Order) -> bool) -> impl Iterator<Item = Order> {
        let is_due = move |unanswered: &&mut Unanswered| now_s >= unanswered.due_s && may_send(&unanswered.order);
        let Self { orders, copies } = self;
        copies.retain(|copy| now_s - copy.sent_s < ANSWERED_S);
        orders.iter_mut().filter(is_due).map(move |unanswered| {
            unanswered.due_s = now_s + if unanswered.order == Order::Arm { REPEAT_ARMING_S } else { REPEAT_S };
            copies.push(SentCopy { order: unanswered.order, sent_s: now_s });
            unanswered.order
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn due(outbox: &mut Outbox, now_s: f64) -> Vec<Order> {
        outbox.due(now_s, |_| true).collect()
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
    fn an_order_that_may_not_be_sent_stays_due() {
        let mut outbox = Outbox::default();
        outbox.send(Order::Arm, 0.0);
        outbox.send(Order::Speed(1.0), 0.0);
        let held: Vec<Order> = outbox.due(0.0, |order| *order != Order::Arm).collect();
        assert_eq!((held, due(&mut outbox, 0.1)), (vec![Order::Speed(1.0)], vec![Order::Arm]));
    }

    #[test]
    fn a_newer_order_of_the_same_command_replaces_the_older_one() {
        let mut outbox = Outbox::default();
        outbox.send(Order::Speed(1.0), 0.0);
        outbox.send(Order::Speed(2.0), 0.1);
        assert_eq!(due(&mut outbox, 0.1), [Order::Speed(2.0)]);
        assert!(outbox.has(&Order::Speed(0.0)) && !outbox.has(&Order::Arm));
    }
}
