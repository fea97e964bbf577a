//! Plans to start from that are offered from outside: the flights of other strategies.

use skysink_common::geometry::Position;

use super::forecast::Forecast;
use super::service_disk::ServiceDisk;
use super::{Horizon, Search, start};
use crate::strategies::View;

/// Searches after which plans to start from are compared.
const ROUNDS: u32 = 8;

/// A plan to start from.
#[derive(Debug, Clone)]
struct StartPlan {
    loss_bits: f64,
    stops: Vec<u32>,
    /// Disks of the model that were added for it.
    added: Vec<ServiceDisk>,
    temperature: f64,
}

impl Horizon {
    /// Replaces the plan by the one that the best of `flights`, each where its slots end and their schedules, leads to,
    /// if that loses less after a first search of `steps` steps, as the plan itself gets one. Its stops become disks of
    /// the model.
    ///
    /// The plans are compared after a search, because one that loses less may be hard to improve: a slot that serves as
    /// many as it can is a stop that hardly anything fits in place of.
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
            best = self.tried(view, forecast, best, steps, &is_over);
            let own = self.tried(view, forecast, own, steps, &is_over);
            if own.loss_bits <= best.loss_bits {
                best = own;
            }
        }
        self.load(forecast, best);
    }

    /// Replaces the plan by the stops of a `flight`, and what is best after its end.
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

    /// The plan that `begun` becomes by a first search.
    fn tried(
        &mut self,
        view: &View,
        forecast: &mut Forecast,
        begun: StartPlan,
        steps: u32,
        is_over: &dyn Fn() -> bool,
    ) -> StartPlan {
        self.load(forecast, begun);
        for round in 1..=ROUNDS {
            self.improve(Search { slot: view.slot, round, steps }, forecast, is_over);
        }
        self.plan(forecast)
    }

    /// The plan of `forecast`, with what it takes to resume it.
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
