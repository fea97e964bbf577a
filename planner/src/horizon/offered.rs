//! Initial plans from the flights of other strategies.

use skysink_common::geometry::Position;

use super::forecast::Forecast;
use super::groups::ServiceDisk;
use super::{Horizon, Search, start};
use crate::strategy::View;

/// Searches after which two initial plans are compared.
const ROUNDS: u32 = 8;

/// An initial plan.
#[derive(Debug, Clone)]
struct StartPlan {
    loss_bits: f64,
    stops: Vec<u32>,
    /// Added disks of the model.
    added: Vec<ServiceDisk>,
    temperature: f64,
}

impl Horizon {
    /// Replaces the plan by that of the best of `flights`, if it loses less after searches of `steps` steps for both.
    /// Each flight is a list of slots, with waypoint and schedule, which become disks of the model.
    ///
    /// The plans are compared after a search, because a plan that loses less may be hard to improve: its stops serve as
    /// many sensors as possible, and are hard to replace.
    pub fn offer<'a>(
        &mut self,
        view: &View,
        forecast: &mut Forecast,
        flights: impl Iterator<Item = &'a [(Position, Vec<u32>)]>,
        steps: u32,
        is_over: impl Fn() -> bool,
    ) {
        let own = self.plan(forecast);
        let mut best = own.clone();
        for flight in flights {
            self.load_flight(forecast, flight);
            if forecast.loss_bits < best.loss_bits {
                best = self.plan(forecast);
            }
        }
        if best.loss_bits < own.loss_bits {
            let mut plans = [own, best];
            // Alternating, so that a search that ends early does so for both.
            for round in 1..=ROUNDS {
                let search = Search { slot: view.slot, round, steps };
                plans = plans.map(|plan| self.searched(forecast, plan, search, &is_over));
            }
            let [own, offered] = plans;
            best = if own.loss_bits <= offered.loss_bits { own } else { offered };
        }
        self.load(forecast, best);
    }

    /// Replaces the plan by the stops of `flight`, extended to the end of the window.
    fn load_flight(&mut self, forecast: &mut Forecast, flight: &[(Position, Vec<u32>)]) {
        let sensor = |id: &u32| self.model.ids.binary_search(id).ok().map(|sensor| sensor as u32);
        let disk = |(centre, ids): &(Position, Vec<u32>)| {
            ServiceDisk::at(&self.model.table, *centre, ids.iter().filter_map(sensor).collect())
        };
        let disks = flight.iter().filter_map(disk).collect();
        let first = (self.model.disks.len() - self.model.added().len()) as u32;
        self.model.replace_added(disks);
        forecast.load(&self.model, first..self.model.disks.len() as u32);
        start::extend(&self.model, forecast);
    }

    /// The result of a search from `plan`.
    fn searched(
        &mut self,
        forecast: &mut Forecast,
        plan: StartPlan,
        search: Search,
        is_over: &dyn Fn() -> bool,
    ) -> StartPlan {
        self.load(forecast, plan);
        self.improve(search, forecast, is_over);
        self.plan(forecast)
    }

    /// The plan of `forecast`, with the state to resume it.
    fn plan(&self, forecast: &Forecast) -> StartPlan {
        StartPlan {
            loss_bits: forecast.loss_bits,
            stops: forecast.stops(),
            added: self.model.added().to_vec(),
            temperature: self.temperature,
        }
    }

    /// Replaces the plan of `forecast`.
    fn load(&mut self, forecast: &mut Forecast, plan: StartPlan) {
        self.model.replace_added(plan.added);
        forecast.load(&self.model, plan.stops);
        self.temperature = plan.temperature;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use std::path::Path;

    use skysink_common::battery::BatteryState;
    use skysink_common::belief::Believed;
    use skysink_common::message::SensorNode;
    use skysink_common::random::{Purpose, Streams};
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::sensors::SensorList;
    use skysink_common::stop::Stop;

    use crate::horizon::anneal::{Temperature, anneal};
    use crate::horizon::{HorizonKeys, PlannedSlot, planned_slot};
    use crate::strategy::Timing;
    use crate::strategy::tests::over;

    #[test]
    fn a_flight_that_loses_less_becomes_the_plan_and_its_slots_become_stops() {
        // Two pairs 35 m apart that fill in 3 slots, with blocks for a pair: each pair has to be served in every other
        // slot.
        let positions_m = [[200.0, 200.0], [203.0, 200.0], [235.0, 200.0], [238.0, 200.0]];
        let text = "name = 'x'\nslots = 40\n[area]\nside_m = 400.0\n[link]\nresource_blocks = 2\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let sensor = |[x_m, y_m]: [f64; 2]| SensorNode {
            x_m,
            y_m,
            gain: 10f64.powf(-5.2),
            sampling_bps: 10_000.0,
            capacity_bits: 30_000,
            ..SensorNode::default()
        };
        let position = scenario.start();
        let field = over(scenario, positions_m.map(sensor).to_vec());
        let table = &field.table;
        let mut horizon = Horizon::new(&field.setup(), HorizonKeys::of(0));
        let stop = &Stop::default();
        let view = View {
            slot: 1,
            position,
            battery: BatteryState::default(),
            belief: Believed::known(0, &table.sensors, &[0; 4]),
            table,
            timing: Timing::Free,
            others: None,
            stop,
        };
        let mut forecast = horizon.forecast(&view).unwrap();
        let permanent = horizon.model.disks.len();
        let between = |slot: usize| {
            let x_m = [202.0, 232.0][slot % 2];
            (Position::new(x_m, 200.0), [vec![0, 1], vec![2, 3]][slot % 2].clone())
        };
        // A flight that hovers over one pair loses more than any plan to start from: nothing changes.
        let begun = (forecast.stops(), forecast.loss_bits);
        horizon.offer(&view, &mut forecast, [&vec![between(0); 40][..]].into_iter(), 0, || false);
        assert_eq!((forecast.stops(), forecast.loss_bits), begun);
        assert!(horizon.model.added().is_empty());
        // From an empty plan, the flight to and fro is better. A slot that serves nobody is no stop.
        forecast.load(&horizon.model, []);
        let mut flight: Vec<_> = (0..40).map(between).collect();
        flight.push((Position::new(200.0, 200.0), Vec::new()));
        horizon.offer(&view, &mut forecast, [&flight[..]].into_iter(), 0, || false);
        assert_eq!(horizon.model.added().len(), 40);
        assert_eq!(forecast.trace.legs[0].stop as usize, permanent);
        assert!(forecast.loss_bits <= begun.1, "{} against {}", forecast.loss_bits, begun.1);
        // Another that is worse leaves these stops as they are.
        let taken = (forecast.stops(), forecast.loss_bits);
        horizon.offer(&view, &mut forecast, [&vec![between(1); 40][..]].into_iter(), 0, || false);
        assert_eq!((forecast.stops(), forecast.loss_bits, horizon.model.added().len()), (taken.0, taken.1, 40));
    }

    #[test]
    fn the_better_of_flight_and_plan_is_chosen_after_a_search() {
        // In fields where the flight loses less before any search.
        let taken = (1..=24).filter_map(offered_in);
        let [flights, plans] = taken.fold([0, 0], |[flights, plans], is_flight| match is_flight {
            true => [flights + 1, plans],
            false => [flights, plans + 1],
        });
        assert!(flights > 0 && plans > 0, "{flights} flights, {plans} plans");
    }

    /// Offers a flight, and checks that what is taken loses least after a search; whether that is the flight. `None` if
    /// it loses no less before.
    fn offered_in(seed: u64) -> Option<bool> {
        let text = "name = 'x'\nslots = 80\n[area]\nside_m = 250.0\n[sensors]\ncount = 40\nsampling_bps = 600.0\n\
                    [link]\nbandwidth_hz = 8e3\n";
        let overrides = Overrides { seed: Some(seed), ..Overrides::default() };
        let scenario = Scenario::parse(text, Path::new("x.toml"), overrides).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let position = scenario.start();
        let field = over(scenario, list.nodes());
        let table = &field.table;
        let mut horizon = Horizon::new(&field.setup(), HorizonKeys::of(0));
        let queues_bits = &list.queues_bits()[..];
        let stop = &Stop::default();
        let view = View {
            slot: 1,
            position,
            battery: BatteryState::default(),
            belief: Believed::known(0, &table.sensors, queues_bits),
            table,
            timing: Timing::Free,
            others: None,
            stop,
        };
        let mut forecast = horizon.forecast(&view).unwrap();
        let begun = forecast.stops();
        let begun_bits = forecast.loss_bits;
        // The plan after a short search, slot by slot, each with all that it serves, as a flight of another strategy.
        let mut random = Streams::new(1).stream(Purpose::Horizon, 0, 0);
        let temperature = Temperature { far_bits: 0.0, now: 0, near_fraction: 1.0 };
        anneal(&horizon.model, &mut forecast, temperature, 40, || false, &mut random);
        let slots = (1..=80).scan(position.xy(), |at, slot| {
            let PlannedSlot { waypoint, ids, .. } = planned_slot(&horizon.model, &forecast, slot, at)?;
            *at = waypoint;
            Some((waypoint, ids))
        });
        let flight: Vec<_> = slots.collect();
        let begin = |horizon: &mut Horizon, forecast: &mut Forecast| {
            horizon.model.replace_added(Vec::new());
            horizon.temperature = 1.0;
            forecast.load(&horizon.model, begun.iter().copied());
        };
        begin(&mut horizon, &mut forecast);
        horizon.offer(&view, &mut forecast, [&flight[..]].into_iter(), 0, || false);
        let is_better = forecast.loss_bits < begun_bits;
        assert_eq!(
            is_better,
            !horizon.model.added().is_empty(),
            "seed {seed}: without a search the better one is taken"
        );
        begin(&mut horizon, &mut forecast);
        horizon.offer(&view, &mut forecast, [&flight[..]].into_iter(), 300, || false);
        let taken_bits = forecast.loss_bits;
        let is_flight = !horizon.model.added().is_empty();
        begin(&mut horizon, &mut forecast);
        (1..=8).for_each(|round| horizon.improve(Search { slot: 1, round, steps: 300 }, &mut forecast, || false));
        let alone_bits = forecast.loss_bits;
        is_better.then(|| {
            assert!(if is_flight { taken_bits < alone_bits } else { taken_bits == alone_bits }, "seed {seed}");
            is_flight
        })
    }
}
