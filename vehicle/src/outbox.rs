//! The orders to a vehicle that it has not answered yet, which are repeated because a link may lose them.

use crate::telemetry::{IN_PROGRESS, Order};

/// Time after which an order without an answer is repeated [s].
const REPEAT_S: f64 = 0.5;

/// The same of an order to arm [s]: longer than answers take on slow links, so that there is one answer.
const REPEAT_ARMING_S: f64 = 3.0;

/// Unanswered orders, one of each command: a newer one replaces it.
#[derive(Debug, Clone, Default)]
pub struct Outbox {
    orders: Vec<Unanswered>,
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

    /// Forgets all orders.
    pub fn clear(&mut self) {
        self.orders.clear();
    }

    /// Whether the order of the command of `order` is unanswered.
    #[must_use]
    pub fn has(&self, order: &Order) -> bool {
        self.orders.iter().any(|unanswered| unanswered.order.command() == order.command())
    }

    /// Takes in the answer to the order of `command`; returns that order if it is final.
    pub fn answer(&mut self, command: u16, result: u8) -> Option<Order> {
        let index = self.orders.iter().position(|unanswered| unanswered.order.command() == Some(command))?;
        (result != IN_PROGRESS).then(|| self.orders.remove(index).order)
    }

    /// The orders that are due at `now_s` [s] and that `may_send`, in the order in which they were given; the others
    /// stay due.
    pub fn due(&mut self, now_s: f64, may_send: impl Fn(&Order) -> bool) -> impl Iterator<Item = Order> {
        let is_due = move |unanswered: &&mut Unanswered| now_s >= unanswered.due_s && may_send(&unanswered.order);
        let due = self.orders.iter_mut().filter(is_due);
        due.map(move |unanswered| {
            unanswered.due_s = now_s + if unanswered.order == Order::Arm { REPEAT_ARMING_S } else { REPEAT_S };
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
        assert_eq!(outbox.answer(400, 4), Some(Order::Arm), "also if it is refused");
        assert_eq!(outbox.answer(20, IN_PROGRESS), None);
        assert_eq!(due(&mut outbox, 1.5), [Order::Return]);
        assert_eq!(outbox.answer(192, 0), None, "nobody has asked");
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
