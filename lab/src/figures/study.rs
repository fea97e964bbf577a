//! Sweeps over one key of the letter's mission, by every strategy, and the charts made of them.

use super::campaign::{Campaign, Choice, FigurePart, LETTER_BASE, Quantity, curve, numbers, plan};
use super::chart::{Chart, Scale};
use crate::error::LabError;
use crate::sweep::journal::{MissionRow, MissionRows, missions_of};
use crate::sweep::plan::Sweep;
use crate::sweep::results::{BEST_KNOWN, best_known};
use skysink_planner::strategies::{
    Registered, exact, gfs, horizon, max_age_first, offline, rfs, round_robin, tour, uts, uts_wide,
};

/// Strategies that take microseconds a slot, in the order of legends and tables.
pub(super) const AT_ONCE: [&Registered; 8] = [
    &rfs::STRATEGY,
    &gfs::STRATEGY,
    &uts::STRATEGY,
    &uts_wide::STRATEGY,
    &exact::STRATEGY,
    &tour::STRATEGY,
    &round_robin::STRATEGY,
    &max_age_first::STRATEGY,
];

/// Those that take milliseconds; the last is only shown as a part of the best known.
const AHEAD: [&Registered; 2] = [&horizon::STRATEGY, &offline::STRATEGY];

/// Most fields per point of those.
const AHEAD_RUNS: u64 = 20;

/// A regime of the radio.
struct Regime {
    /// Its name in files.
    name: &'static str,
    /// Its name for people.
    title: &'static str,
    bandwidth_hz: f64,
}

/// A visit that empties every queue.
const LETTER: Regime = Regime { name: "letter", title: "W = 5 MHz, the letter's", bandwidth_hz: 5e6 };

/// A visit that carries a part of a queue.
const NARROW: Regime = Regime { name: "narrow", title: "W = 5 kHz", bandwidth_hz: 5e3 };

/// A sweep over one key, and what is plotted of it.
pub(super) struct Study {
    /// The figures that it is.
    pub part: FigurePart,
    name: &'static str,
    key: &'static str,
    values: &'static [i64],
    x_label: &'static str,
    /// Regimes of the radio, with charts of their own.
    regimes: &'static [Regime],
    /// What differs from the letter's mission.
    fixed: &'static [(&'static str, i64)],
    /// Missions at the same time; 1 where time itself is measured, 0 for as many as asked for.
    threads: usize,
    /// Times as many search steps of `horizon` as elsewhere.
    effort: u32,
    /// Most fields per point of strategies that take milliseconds a slot.
    ahead_runs: u64,
    quantities: &'static [Quantity],
}

/// The missions of a study.
struct Flown {
    all: MissionRows,
    /// Those over the fields that every strategy has flown over.
    common: MissionRows,
}

/// The letter's Fig. 2 (a) to (c), the bits per waypoint that its text speaks of, and fields larger than the letter's.
pub(super) const STUDIES: [Study; 4] = [
    Study {
        part: FigurePart::Area,
        name: "area",
        key: "area.side_m",
        values: &[100, 150, 200, 250, 300],
        x_label: "side of the area [m]",
        regimes: &[LETTER, NARROW],
        fixed: &[("slots", 500)],
        threads: 0,
        effort: 1,
        ahead_runs: AHEAD_RUNS,
        quantities: &[
            Quantity::loss("fig2a-loss-area", "Data loss against the area"),
            Quantity::bits("bits-area", "Bits per waypoint against the area"),
        ],
    },
    Study {
        part: FigurePart::Sparse,
        name: "sparse",
        key: "area.side_m",
        values: &[300, 400, 500, 700, 1000],
        x_label: "side of the area [m]",
        regimes: &[LETTER],
        fixed: &[("slots", 500)],
        threads: 0,
        effort: 4,
        ahead_runs: AHEAD_RUNS,
        quantities: &[Quantity::loss("loss-sparse", "Data loss in sparse fields")],
    },
    Study {
        part: FigurePart::Rate,
        name: "rate",
        key: "sensors.sampling_bps",
        values: &[100, 200, 300, 400, 500, 600, 700, 800],
        x_label: "sampling rate s [bit/s]",
        regimes: &[LETTER, NARROW],
        fixed: &[("slots", 600)],
        threads: 0,
        effort: 1,
        ahead_runs: AHEAD_RUNS,
        quantities: &[Quantity::loss("fig2b-loss-rate", "Data loss against the sampling rate")],
    },
    Study {
        part: FigurePart::Time,
        name: "time",
        key: "sensors.count",
        values: &[50, 100, 200, 400],
        x_label: "sensor nodes N in 100 m × 100 m",
        regimes: &[LETTER, NARROW],
        fixed: &[("sensors.sampling_bps", 120), ("slots", 600)],
        threads: 1,
        effort: 1,
        ahead_runs: 5,
        quantities: &[Quantity {
            stem: "fig2c-time",
            title: "Planning time of a slot, median of each mission",
            y_label: "planning time [µs]",
            y_scale: Scale::Log,
            value: |row| row.plan_p50_us,
            is_bounded: false,
        }],
    },
];

impl Study {
    /// Flies the sweeps, and draws a chart per quantity and regime.
    pub fn draw(&self, campaign: &mut Campaign) -> Result<(), LabError> {
        let flown = self.fly(campaign)?;
        for quantity in self.quantities {
            for (index, regime) in self.regimes.iter().enumerate() {
                let title = format!("{} · {}", quantity.title, regime.title);
                let chart = self.chart(title, quantity, &flown, index * self.values.len(), campaign.choice);
                campaign.add_chart(&format!("{}-{}", quantity.stem, regime.name), &chart)?;
            }
        }
        Ok(())
    }

    /// Flies all strategies, those that take milliseconds over fewer fields.
    fn fly(&self, campaign: &Campaign) -> Result<Flown, LabError> {
        let ahead_runs = self.ahead_runs(campaign.choice);
        let is_bounded = self.quantities.iter().any(|quantity| quantity.is_bounded);
        let ahead = if is_bounded { &AHEAD[..] } else { &AHEAD[..1] };
        let at_once = self.sweep(campaign.choice, &AT_ONCE, campaign.choice.runs)?;
        let mut all = campaign.fly(self.name, &at_once, self.threads)?;
        let ahead = self.sweep(campaign.choice, ahead, ahead_runs)?;
        let ahead = campaign.fly(&format!("{}-ahead", self.name), &ahead, self.threads)?;
        all.extend(ahead.into_values().map(|row| {
            let row = MissionRow { strategy: row.strategy + AT_ONCE.len(), ..row };
            (row.key(), row)
        }));
        let common = all.iter().filter(|(mission, _)| mission.seed <= ahead_runs);
        Ok(Flown { common: common.map(|(mission, row)| (*mission, *row)).collect(), all })
    }

    fn ahead_runs(&self, choice: &Choice) -> u64 {
        choice.runs.min(self.ahead_runs)
    }

    /// The sweep: regime of the radio, then the key, over the letter's mission.
    fn sweep(&self, choice: &Choice, strategies: &[&'static Registered], runs: u64) -> Result<Sweep, LabError> {
        let mut axes: Vec<_> = self.fixed.iter().map(|&(key, value)| (key, numbers(key, &[value]))).collect();
        if strategies.contains(&&horizon::STRATEGY) {
            let iterations = choice.horizon_iterations.saturating_mul(self.effort);
            let steps = i64::try_from(Choice::offline_steps(iterations)).unwrap_or(i64::MAX);
            axes.push(("planner.horizon.iterations", vec![i64::from(iterations).into()]));
            axes.push(("planner.offline.steps", vec![steps.into()]));
        }
        axes.push(("link.bandwidth_hz", self.regimes.iter().map(|regime| regime.bandwidth_hz.into()).collect()));
        axes.push((self.key, numbers(self.key, self.values)));
        plan(self.name, LETTER_BASE, axes, strategies, runs)
    }

    /// One quantity in the regime whose points begin with `first`, a curve per strategy; of a loss the best known and the
    /// bound, too.
    fn chart(&self, title: String, quantity: &Quantity, flown: &Flown, first: usize, choice: &Choice) -> Chart {
        let by_strategy = |label: &str, strategy: usize, value: fn(&MissionRow) -> f64| {
            curve(label, self.values, |index| missions_of(&flown.all, first + index, strategy).map(value).collect())
        };
        let shown = AT_ONCE.iter().chain(&AHEAD[..1]).enumerate();
        let mut series: Vec<_> =
            shown.map(|(strategy, name)| by_strategy(name.name, strategy, quantity.value)).collect();
        if quantity.is_bounded {
            let least = best_known(&flown.common);
            series.push(curve(BEST_KNOWN, self.values, |index| least[&(first + index)].clone()));
            let bound = |row: &MissionRow| row.loss_bound.expect("an offline plan's mission has one");
            series.push(by_strategy("lower bound", AT_ONCE.len() + 1, bound));
        }
        let of_ahead = if quantity.is_bounded { "horizon, best-known and lower bound" } else { "horizon" };
        let fields = format!("seeds 1 to {}, of {of_ahead} 1 to {}", choice.runs, self.ahead_runs(choice));
        Chart {
            title,
            x_label: self.x_label.to_owned(),
            y_label: quantity.y_label.to_owned(),
            series,
            footer: choice.footer(&fields),
            y_scale: quantity.y_scale,
        }
    }
}
