//! Tiny missions of Poisson arrivals whose least expected loss is computed by stochastic dynamic programming.

use std::path::Path;

use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

/// Bits of a packet.
const PACKET_BITS: u32 = 10;

/// Packets of a slot that are counted: more are as unlikely as 10^-12 for a mean of at most 3.
const MOST_ARRIVALS: usize = 24;

/// SNs at the start of the UAV, and one that it reaches in a slot from there; a visit empties a queue, one in each
/// slot.
#[derive(Debug, Clone)]
pub struct Tiny {
    /// Mean packets per slot, by SN.
    pub means: Vec<f64>,
    /// Packets of each buffer.
    pub capacity: usize,
    /// Packets before slot 1, by SN.
    pub queues: Vec<usize>,
    pub slots: usize,
}

impl Tiny {
    /// The keys of the mission.
    pub fn text(&self) -> String {
        format!(
            "slots = {}\n[area]\nside_m = 60.0\n[uav]\nstart_m = [10.0, 10.0]\n[link]\nresource_blocks = 1\n\
             [sensors]\nfile = 'list.csv'\ncapacity_bits = {}\n[sensors.arrivals]\nmodel = 'poisson'\n\
             packet_bits = {PACKET_BITS}\n",
            self.slots,
            self.capacity * PACKET_BITS as usize
        )
    }

    /// Its SNs.
    pub fn list(&self, scenario: &Scenario) -> SensorList {
        let row = |((id, mean), queue): ((usize, &f64), &usize)| {
            let x_m = if id == 2 { 50 } else { 10 };
            format!("{x_m},10,{},{}\n", queue * PACKET_BITS as usize, mean * f64::from(PACKET_BITS))
        };
        let rows: String = self.means.iter().enumerate().zip(&self.queues).map(row).collect();
        let text = format!("x_m,y_m,queue_bits,sampling_bps\n{rows}");
        SensorList::parse(&text, Path::new("list.csv"), scenario).unwrap()
    }

    /// The least expected loss [bit] of any policy that sees the queues.
    pub fn least_expected_bits(&self) -> f64 {
        let levels = self.capacity + 1;
        let count = self.means.len();
        let states = levels.pow(count as u32);
        let laws: Vec<Vec<f64>> = self.means.iter().map(|&mean| poisson(mean)).collect();
        // What comes of a queue in a slot without a visit: the probability of each level, and the expected loss.
        let after = |sensor: usize, queue: usize| {
            let mut levels = vec![0.0; levels];
            let mut lost = 0.0;
            for (arrivals, probability) in laws[sensor].iter().enumerate() {
                levels[(queue + arrivals).min(self.capacity)] += probability;
                lost += probability * (queue + arrivals).saturating_sub(self.capacity) as f64;
            }
            (levels, lost)
        };
        let mut later = vec![0.0; states];
        for _ in 0..self.slots {
            let value = |state: usize| {
                let queues: Vec<usize> = (0..count).map(|sensor| state / levels.pow(sensor as u32) % levels).collect();
                let next: Vec<(Vec<f64>, f64)> =
                    queues.iter().enumerate().map(|(id, &queue)| after(id, queue)).collect();
                let lost: f64 = next.iter().map(|(_, lost)| lost).sum();
                let with_visit = |served: usize| {
                    let mut expected = 0.0;
                    for (state, later) in later.iter().enumerate() {
                        let probability: f64 = (0..count)
                            .map(|sensor| match state / levels.pow(sensor as u32) % levels {
                                level if sensor == served => f64::from(level == 0),
                                level => next[sensor].0[level],
                            })
                            .product();
                        expected += probability * later;
                    }
                    expected
                };
                lost + (0..count).map(with_visit).fold(f64::INFINITY, f64::min)
            };
            later = (0..states).map(value).collect();
        }
        let start: usize = self.queues.iter().enumerate().map(|(id, queue)| queue * levels.pow(id as u32)).sum();
        later[start] * f64::from(PACKET_BITS)
    }
}

/// Probabilities of 0, 1, … packets.
fn poisson(mean: f64) -> Vec<f64> {
    let next = |probability: &mut f64, packets: usize| {
        let now = *probability;
        *probability *= mean / (packets + 1) as f64;
        Some(now)
    };
    (0..MOST_ARRIVALS).scan((-mean).exp(), next).collect()
}
