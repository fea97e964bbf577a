//! The report as tables that a person can read.

use std::fmt;

use comfy_table::Table;

use super::Report;
use crate::report::{self, with_numbers_right};
use skysink_mission::latency::Spread;

impl fmt::Display for Report {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let machine = &self.machine;
        writeln!(
            formatter,
            "{}, {} cores, {} MiB, Linux {}, load {:.1}; skysink {} ({}, {})",
            machine.cpu,
            machine.cores,
            machine.memory_mib,
            machine.kernel,
            machine.load_average,
            self.version,
            machine.build,
            machine.rustc,
        )?;
        for table in [self.planner(), self.field(), self.mission(), self.ring(), self.transport()].into_iter().flatten()
        {
            writeln!(formatter, "\n{table}")?;
        }
        Ok(())
    }
}

impl Report {
    fn planner(&self) -> Option<Table> {
        let measured = self.planner.as_ref()?;
        let mut table = table(["a slot's plan", "N", "p50", "p99", "no grid p50", "p99", "ratio"]);
        for row in &measured.plans {
            table.add_row([
                row.strategy.to_owned(),
                row.sensors.to_string(),
                us(row.plan.p50_us),
                us(row.plan.p99_us),
                us(row.undivided.p50_us),
                us(row.undivided.p99_us),
                ratio(row.undivided_over_plan),
            ]);
        }
        for (name, spread) in
            [("waypoint, geometric", measured.waypoint_geometric), ("waypoint, clarabel", measured.waypoint_clarabel)]
        {
            table.add_row([name, "4", &us(spread.p50_us), &us(spread.p99_us)]);
        }
        Some(with_numbers_right(table))
    }

    fn field(&self) -> Option<Table> {
        let mut table = table(["a slot of the field", "N", "p50", "p99", "copy p50", "p99", "ratio"]);
        for row in self.field.as_ref()? {
            table.add_row([
                "into a message".to_owned(),
                row.sensors.to_string(),
                us(row.step.p50_us),
                us(row.step.p99_us),
                us(row.copy.p50_us),
                us(row.copy.p99_us),
                ratio(row.step_over_copy),
            ]);
        }
        Some(with_numbers_right(table))
    }

    fn mission(&self) -> Option<Table> {
        let measured = self.mission.as_ref()?;
        let mut table = table(["missions in one process, uts, N = 200", "slots/s"]);
        let all = format!("a sweep on {} cores", measured.cores);
        for (name, slots_per_s) in [
            ("one after the other", measured.slots_per_s),
            ("a sweep on 1 core", measured.sweep_slots_per_s),
            (&all, measured.sweep_all_slots_per_s),
        ] {
            table.add_row([name, &format!("{slots_per_s:.0}")]);
        }
        table.add_row(["speed per core, all over one", &ratio(measured.per_core)]);
        Some(with_numbers_right(table))
    }

    fn ring(&self) -> Option<Table> {
        let mut table = table([
            "the ring, wait",
            "pace",
            "N",
            "slots/s",
            "p50",
            "p99",
            "p99.9",
            "max",
            "plan",
            "hops",
            "p50/floor",
            "p99/p50",
        ]);
        for row in self.ring.as_ref()? {
            let Spread { p50_us, p99_us, p999_us, max_us } = row.slot;
            table.add_row([
                row.wait.to_string(),
                row.pace.to_string(),
                row.sensors.to_string(),
                format!("{:.0}", row.slots_per_s),
                us(p50_us),
                us(p99_us),
                us(p999_us),
                us(max_us),
                us(row.plan.p50_us),
                us(row.hops.p50_us),
                ratio(row.p50_over_floor),
                ratio(row.p99_over_p50),
            ]);
        }
        Some(with_numbers_right(table))
    }

    fn transport(&self) -> Option<Table> {
        let mut table = table(["three hops, wait", "N", "shared p50", "p99", "socket p50", "p99", "ratio"]);
        for row in self.transport.as_ref()? {
            table.add_row([
                row.wait.to_string(),
                row.sensors.to_string(),
                us(row.shared_memory.p50_us),
                us(row.shared_memory.p99_us),
                us(row.socket.p50_us),
                us(row.socket.p99_us),
                ratio(row.socket_over_shared_memory),
            ]);
        }
        Some(with_numbers_right(table))
    }
}

fn table<const COLUMNS: usize>(header: [&str; COLUMNS]) -> Table {
    let mut table = report::table();
    table.set_header(header);
    table
}

/// A time, to three digits.
fn us(us: f64) -> String {
    match us {
        ..1.0 => format!("{:.0} ns", us * 1e3),
        ..10.0 => format!("{us:.2} µs"),
        ..100.0 => format!("{us:.1} µs"),
        ..1_000.0 => format!("{us:.0} µs"),
        ..10_000.0 => format!("{:.2} ms", us / 1e3),
        ..100_000.0 => format!("{:.1} ms", us / 1e3),
        _ => format!("{:.0} ms", us / 1e3),
    }
}

fn ratio(ratio: f64) -> String {
    match ratio {
        ..100.0 => format!("{ratio:.2}"),
        _ => format!("{ratio:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use super::{ratio, us};

    #[test]
    fn times_are_said_in_three_digits() {
        let said = [0.05, 1.234, 56.78, 567.8, 5_678.0, 56_780.0, 567_800.0].map(us);
        assert_eq!(said, ["50 ns", "1.23 µs", "56.8 µs", "568 µs", "5.68 ms", "56.8 ms", "568 ms"]);
        assert_eq!([0.914, 12.34, 1234.5].map(ratio), ["0.91", "12.34", "1234"]);
    }
}
