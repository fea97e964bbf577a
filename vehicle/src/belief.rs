//! Which reports of a vehicle are believed: the last one, if it equals the one before it. Links keep old messages, and
//! deliver some twice.

use crate::autopilot::ModeMeaning;
use crate::table::Report;

/// Reports in a row that say that it is disarmed, and over what time [s], before that is believed: copies of old ones
/// come at once. The second is that of vehicles with one heartbeat a second.
const DISARMED: [(u32, f64); 2] = [(3, 0.3), (2, 0.9)];

/// The last reports of a vehicle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ReportBelief {
    last: Option<Report>,
    /// How many reports in a row that count were equal to the last one, with it.
    count: u32,
    /// When the first of them came, and the last [s].
    since_s: f64,
    counted_s: f64,
    /// When the last report came, and the last one that was believed [s].
    heard_s: Option<f64>,
    believed_s: Option<f64>,
    /// Whether a report has come that counts since the last call of [`take_new`](Self::take_new).
    is_new: bool,
    /// What was believed since then, if that was not an armed vehicle in the mode that follows, and whether any report
    /// has said that it is armed: several reports may come at once.
    missed: Option<Report>,
    said_armed: bool,
}

impl ReportBelief {
    /// Takes in a heartbeat.
    pub fn hear(&mut self, report: Report, now_s: f64) {
        self.hear_weighed(report, 1, now_s);
    }

    /// Takes in a report of the mode alone. On the ground, or of a vehicle that has said that it is disarmed, it may
    /// cast a doubt, and confirms nothing: it comes before the heartbeat that says whether the vehicle is armed.
    pub fn hear_mode(&mut self, mode: ModeMeaning, is_on_ground: bool, now_s: f64) {
        if let Some(last) = self.last {
            self.hear_weighed(Report { mode, ..last }, u32::from(last.is_armed && !is_on_ground), now_s);
        }
    }

    fn hear_weighed(&mut self, report: Report, weight: u32, now_s: f64) {
        if self.last != Some(report) {
            (self.last, self.count, self.since_s) = (Some(report), 0, now_s);
        }
        self.count = self.count.saturating_add(weight);
        if weight > 0 {
            self.counted_s = now_s;
        }
        self.heard_s = Some(now_s);
        self.is_new |= weight > 0;
        self.said_armed |= report.is_armed;
        self.believed_s = self.believed().map(|_| now_s).or(self.believed_s);
        let follows = Report { mode: ModeMeaning::Follows, is_armed: true };
        self.missed = self.missed.or(self.believed().filter(|believed| *believed != follows));
    }

    /// The last report, if it is believed.
    pub fn believed(&self) -> Option<Report> {
        let report = self.last?;
        let for_s = self.counted_s - self.since_s;
        let is_settled = report.is_armed || DISARMED.iter().any(|&(count, s)| self.count >= count && for_s >= s);
        (self.count >= 2 && is_settled).then_some(report)
    }

    /// The last report, believed or not.
    pub fn last(&self) -> Option<Report> {
        self.last
    }

    /// How long nothing was believed [s], since time 0 if nothing ever was.
    pub fn doubt_s(&self, now_s: f64) -> f64 {
        now_s - self.believed_s.unwrap_or(0.0)
    }

    /// Since when the last report was not contradicted [s].
    pub fn since_s(&self) -> f64 {
        self.since_s
    }

    /// How long no report has come [s], since time 0 if none ever has.
    pub fn silence_s(&self, now_s: f64) -> f64 {
        now_s - self.heard_s.unwrap_or(0.0)
    }

    /// Whether a report has come since the last call, what was believed meanwhile other than that the vehicle follows,
    /// and whether any report has said that it is armed.
    pub fn take_new(&mut self) -> (bool, Option<Report>, bool) {
        let is_armed = self.last.is_some_and(|report| report.is_armed);
        let said_armed = std::mem::replace(&mut self.said_armed, is_armed);
        (std::mem::take(&mut self.is_new), self.missed.take(), said_armed)
    }

    /// Believes nothing any more: two new reports have to agree. How long none has come is not forgotten, unless nobody
    /// has listened until `heard_s` [s].
    pub fn doubt(&mut self, heard_s: Option<f64>) {
        let since = |before: Option<f64>| heard_s.filter(|_| before.is_some()).or(before);
        *self = Self { heard_s: since(self.heard_s), believed_s: since(self.believed_s), ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLIES: Report = Report { mode: ModeMeaning::Follows, is_armed: true };
    const PILOT: Report = Report { mode: ModeMeaning::Other, is_armed: true };
    const OFF: Report = Report { mode: ModeMeaning::Follows, is_armed: false };

    fn hear(belief: &mut ReportBelief, report: Report, now_s: f64) -> Option<Report> {
        belief.hear(report, now_s);
        belief.believed()
    }

    #[test]
    fn a_report_is_believed_if_it_equals_the_one_before_and_an_odd_one_is_a_doubt() {
        let mut belief = ReportBelief::default();
        let heard = [FLIES, FLIES, PILOT, FLIES, FLIES, PILOT, PILOT].map(|report| hear(&mut belief, report, 0.0));
        assert_eq!(heard, [None, Some(FLIES), None, None, Some(FLIES), None, Some(PILOT)]);
        belief.doubt(None);
        assert_eq!([0; 2].map(|_| hear(&mut belief, PILOT, 1.0)), [None, Some(PILOT)]);
    }

    #[test]
    fn that_it_is_disarmed_is_believed_after_a_time_that_copies_do_not_take() {
        let believed = |times_s: &[f64]| {
            let mut belief = ReportBelief::default();
            times_s.iter().filter_map(|now_s| hear(&mut belief, OFF, *now_s)).count()
        };
        assert_eq!(believed(&[0.0, 0.02, 0.04, 0.06]), 0, "copies");
        assert_eq!(believed(&[0.1, 0.44]), 0);
        assert_eq!(believed(&[0.0, 0.2, 0.4]), 1, "5 Hz");
        assert_eq!(believed(&[0.0, 1.0]), 1, "1 Hz");
    }

    #[test]
    fn what_was_believed_between_two_polls_is_not_missed() {
        let mut belief = ReportBelief::default();
        [FLIES, PILOT, PILOT, PILOT, FLIES, FLIES].iter().for_each(|report| belief.hear(*report, 0.0));
        assert_eq!((belief.believed(), belief.take_new()), (Some(FLIES), (true, Some(PILOT), true)));
        [(OFF, 1.0), (OFF, 2.0)].iter().for_each(|(report, now_s)| belief.hear(*report, *now_s));
        assert_eq!(belief.take_new(), (true, Some(OFF), true), "armed before");
        assert_eq!(belief.take_new(), (false, None, false));
    }

    #[test]
    fn a_doubt_does_not_end_a_silence_unless_nobody_listened() {
        let mut belief = ReportBelief::default();
        belief.doubt(Some(5.0));
        assert_eq!(belief.silence_s(6.0), 6.0, "it was never heard");
        belief.hear(FLIES, 1.0);
        assert_eq!(belief.doubt_s(6.0), 6.0, "nothing was believed");
        belief.hear(FLIES, 1.0);
        belief.doubt(None);
        assert_eq!((belief.silence_s(6.0), belief.doubt_s(6.0)), (5.0, 5.0));
        belief.doubt(Some(5.0));
        assert_eq!(belief.silence_s(6.0), 1.0);
    }

    #[test]
    fn a_mode_alone_says_nothing_of_the_motors() {
        let mut belief = ReportBelief::default();
        (0..3).for_each(|_| belief.hear(OFF, 0.0)); // copies
        belief.hear_mode(OFF.mode, false, 0.5);
        assert_eq!((belief.believed(), belief.silence_s(1.0)), (None, 0.5));
        belief.hear(OFF, 0.5);
        assert_eq!(belief.believed(), Some(OFF));
    }

    #[test]
    fn a_mode_alone_confirms_in_the_air_and_casts_a_doubt_on_the_ground() {
        for is_on_ground in [false, true] {
            let mut belief = ReportBelief::default();
            belief.hear_mode(ModeMeaning::Other, is_on_ground, 0.0);
            assert_eq!(belief.last(), None, "nobody has said whether it is armed");
            (0..2).for_each(|_| belief.hear(FLIES, 0.0));
            assert!(belief.take_new().0 && !belief.take_new().0);
            (0..2).for_each(|_| belief.hear_mode(ModeMeaning::Other, is_on_ground, 0.5));
            assert_eq!((belief.believed(), belief.take_new().0), ((!is_on_ground).then_some(PILOT), !is_on_ground));
            assert_eq!(hear(&mut belief, PILOT, 1.0), (!is_on_ground).then_some(PILOT));
            assert_eq!(hear(&mut belief, PILOT, 2.0), Some(PILOT));
        }
    }
}
