//! The time of the vehicles, and whether the bridge was suspended meanwhile.

use std::time::Duration;

use skysink_ring::topics::boot_ns;

/// Time after which messages that wait are out of date: the bridge was suspended, or its machine.
const STALE: Duration = Duration::from_secs(1);

/// Time after that in which messages may still have waited somewhere.
const SETTLED: Duration = Duration::from_millis(300);

/// The time of the vehicles, on the clock of [`boot_ns`]: it goes on while this machine is suspended.
#[derive(Debug, Clone, Copy)]
pub struct VehicleClock {
    begin_ns: u64,
    /// Seconds of the vehicles in a second.
    factor: f64,
}

impl VehicleClock {
    /// A clock that starts now, of vehicles that fly `factor` seconds in a second.
    pub fn new(factor: f64) -> Self {
        Self { begin_ns: boot_ns(), factor }
    }

    /// Time since the start of the process [s], of this machine.
    pub fn elapsed_s(&self) -> f64 {
        Duration::from_nanos(boot_ns() - self.begin_ns).as_secs_f64()
    }

    /// The same of the vehicles.
    pub fn now_s(&self) -> f64 {
        self.of_vehicles_s(self.elapsed_s())
    }

    /// A duration of this machine [s] as one of the vehicles [s].
    pub fn of_vehicles_s(&self, duration_s: f64) -> f64 {
        duration_s * self.factor
    }
}

/// Whether messages may have waited while the bridge was suspended, on the clock of [`boot_ns`].
#[derive(Debug, Clone, Copy)]
pub struct Attention {
    /// When messages were taken in last [ns].
    polled_ns: u64,
    /// Until when they may have waited [ns].
    stale_until_ns: u64,
}

impl Default for Attention {
    /// Nothing waits yet.
    fn default() -> Self {
        Self { polled_ns: boot_ns(), stale_until_ns: 0 }
    }
}

impl Attention {
    /// Notes that messages are taken in now. Returns how long the bridge was suspended before, if it was.
    pub fn poll(&mut self) -> Option<Duration> {
        let before_ns = std::mem::replace(&mut self.polled_ns, boot_ns());
        let suspended = Some(Duration::from_nanos(self.polled_ns - before_ns)).filter(|pause| *pause > STALE);
        if suspended.is_some() {
            self.stale_until_ns = self.polled_ns + SETTLED.as_nanos() as u64;
        }
        suspended
    }

    /// Whether messages that come now may have waited.
    pub fn is_stale(&self) -> bool {
        self.polled_ns < self.stale_until_ns
    }
}
