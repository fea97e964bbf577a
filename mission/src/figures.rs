//! The figures of a mission: a row of this table makes the key of `summary.json`, the column of a sweep's results, the
//! row of the printed report, and what plots, LaTeX, Python and the book say of it.
//!
//! The sums that figures are computed from are left to [`crate::sums`].

use std::borrow::Cow;

use serde::{Deserialize, Serialize};
use skysink_common::build::{VERSION, build};
use skysink_common::figure::{Figure, FigureKind, FigureSource, Printed, Support};
use skysink_common::figures;
use skysink_common::message::{Mode, SolverOutcome};
use skysink_common::nodes::energy::NodeEnergyUse;
use strum::{EnumCount, VariantArray};

use crate::numbers::{figure, grouped, jain};
use crate::summary::{EnergyUse, Event, FleetUse, OperatorUse, RunTiming};
use crate::sums::{CountedSlot, MissionSums};

type Row = Figure<Summary>;

const REAL: Row = Row::REAL;
const FRACTION: Row = Row { support: Support::Fraction, ..REAL };
const COUNT: Row = Row { kind: FigureKind::Count, report: COUNTED, ..REAL };
const BITS: Row = Row { unit: "bit", ..REAL };
const BIT_COUNT: Row = Row { unit: "bit", ..COUNT };
const METRES: Row = Row { unit: "m", ..REAL };
const JOULES: Row = Row { unit: "J", ..REAL };
const SECONDS: Row = Row { unit: "s", ..REAL };
const WALL_CLOCK: Row = Row { kind: FigureKind::WallClock, unit: "µs", source: FigureSource::Run, ..REAL };
const OTHER: Row = Row { kind: FigureKind::Other, ..REAL };
/// What a run has measured of itself.
const OF_RUN: Row = Row { source: FigureSource::Run, ..OTHER };

const COUNTED: Printed<Summary> = Printed::Count(grouped);
const RATE: Printed<Summary> = Printed::Number(|rate| format!("{rate:.6}"));

// A figure that a mission does not have is `None`, which is an empty cell of the results.
figures! {
    /// The results of a run, as in `summary.json`.
    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    pub struct Summary of MissionSums;
    /// The figures that are counted slot by slot.
    #[derive(Debug, Clone, Default)]
    pub struct SlotCounts of CountedSlot;
    /// A metric, which is a column of the results.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, EnumCount, VariantArray)]
    pub enum Metric;

    /// Name of the scenario.
    name: String = OTHER {}, |m| m.run.labels.name.clone();
    /// Strategy, or the label of an external planner.
    strategy: String = OTHER {}, |m| m.run.labels.strategy.clone();
    /// Roles of external processes; a strategy in Python is an external planner.
    #[serde(default)] // runs of older builds do not say
    external: Vec<String> = OTHER {}, |m| m.run.labels.external.clone();
    /// Seed.
    seed: u64 = OTHER {}, |m| m.run.labels.seed;
    /// Slots flown.
    slots: u64 = OTHER {}, |m| m.run.slots;
    /// Slots of the scenario.
    planned_slots: u64 = OTHER {}, |m| m.run.labels.planned_slots;
    /// Sensor nodes.
    sensors: usize = OTHER {}, |m| m.run.labels.sensors;

    /// η = Σ_t Σ_i D_i(t) / (Σ_i s_i τ T), bits lost over bits sampled (decision D3).
    loss_rate (LossRate): f64 = FRACTION { label: "data loss rate η", report: RATE }, |m| m.run.loss_rate();
    /// Σ_i Σ_t D_i(t) / (s_i τ T), the paper's figure, which grows with N (decision D3).
    eta_letter (EtaLetter): f64 = REAL { label: "η as in the paper", source: FigureSource::Links, report: RATE },
        |m| m.run.eta_letter();
    /// η_w, by the weights of the sensor list (decision D25); no value where all weights are equal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    weighted_loss_rate (WeightedLossRate): Option<f64> = FRACTION {
        label: "weighted data loss rate η_w", source: FigureSource::Links, report: RATE
    }, |m| m.run.weighted_loss_rate();
    /// Bits queued before slot 1.
    initial_bits: u64 = BIT_COUNT { label: "bits queued at start" }, |m| m.run.totals.initial_bits;
    /// Bits sampled by the SNs.
    sampled_bits: u64 = BIT_COUNT { label: "bits sampled" }, |m| m.run.totals.sampled_bits;
    /// Bits uploaded to the UAV.
    delivered_bits (DeliveredBits): u64 = BIT_COUNT { label: "bits delivered" }, |m| m.run.totals.delivered_bits;
    /// Bits lost to full buffers, `Σ D_i` (UTS eq. 8), or expired.
    lost_bits: u64 = BIT_COUNT { label: "bits lost" }, |m| m.run.totals.lost_bits;
    /// Bits queued at the end.
    queued_bits: u64 = BIT_COUNT { label: "bits queued at end" }, |m| m.run.totals.queued_bits;
    /// Bits lost because they were older than `sensors.expiry_s` (decision D36), a part of all losses; no value without
    /// this key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    expired_bits (ExpiredBits): Option<u64> = BITS {
        label: "bits lost because they were too old", source: FigureSource::Links
    }, |m| m.run.expired_bits();
    /// `delivered_bits` over T and the number of UAVs.
    bits_per_waypoint (BitsPerWaypoint): f64 = BITS {
        label: "bits delivered per waypoint", heading: "bits per waypoint",
        report: Printed::Number(|bits| format!("{bits:.1}"))
    }, |m| m.run.bits_per_waypoint();
    /// SNs served per slot.
    mean_served (MeanServed): f64 = REAL {
        label: "SNs served per slot", source: FigureSource::Answers,
        report: Printed::Number(|served| format!("{served:.3}"))
    }, |m| m.run.mean_served();
    /// Length of the flight, from waypoint to waypoint, including climb.
    flown_m (FlownM) = METRES { label: "flown distance" }, |m| m.of_field(|field| field.flown_m);
    /// Energy of the flight (decision D10): Σ_t τ P(v_t) + w max(0, Δz_t), with the horizontal speed v_t; without
    /// `uav.battery` w is 20 N. Hovering costs P(0), charging and being down cost nothing.
    energy_j (EnergyJ) = JOULES { label: "propulsion energy" }, |m| m.of_field(|field| field.energy_j);
    /// What the batteries of the UAVs gave and took; no value without `uav.battery`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    energy: Option<EnergyUse> = OTHER { report: Printed::Rows(|summary| EnergyUse::report(summary.energy.as_ref())) },
        |m| m.run.energy();
    /// Energy in the battery at the end. No value without `uav.battery`, as for the next three.
    energy_left_j (EnergyLeftJ) = JOULES {
        label: "energy left in the battery", heading: "energy left",
        report: Printed::Text(|summary| Some(format!("{:.0} J", summary.energy?.left_j)))
    }, |m| m.of_batteries(|energy| energy.left_j);
    /// Energy charged in the base.
    charged_j (ChargedJ) = JOULES { label: "energy charged" }, |m| m.of_batteries(|energy| energy.charged_j);
    /// Time in the base in mode `charge`.
    charged_s (ChargedS) = SECONDS {
        label: "time charging", report: Printed::Text(|summary| Some(format!("{:.0} s", summary.energy?.charged_s)))
    }, |m| m.of_batteries(|energy| energy.charged_s);
    /// Time of waiting for a pad; no value without `[[base.site]]` (decision D34).
    pad_wait_s (PadWaitS) = SECONDS {
        label: "time waiting for a pad",
        report: Printed::Text(|summary| Some(format!("{:.0} s", summary.energy?.pad_wait_s?)))
    }, |m| m.of_batteries(|energy| energy.pad_wait_s).flatten();
    /// What the batteries of the SNs gave, and which are dead (decision D33); no value without `[sensors.energy]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    node_energy: Option<NodeEnergyUse> = OTHER {
        heading: "energy of SNs used / harvested", source: FigureSource::Links, report: Printed::Text(|summary| {
            let NodeEnergyUse { used_j, harvested_j, .. } = summary.node_energy?;
            Some(format!("{} J / {} J", figure(used_j), figure(harvested_j)))
        })
    }, |m| m.run.node_energy();
    /// End of the slot in which the first SN dies (decision D33); no value if none does. It and the next six have no
    /// value without `[sensors.energy]`.
    first_death_s (FirstDeathS) = SECONDS { label: "time of the first death of an SN", source: FigureSource::Links },
        |m| m.of_nodes(|energy| energy.first_death_s);
    /// End of the slot from which on half of the SNs are dead; no value if fewer die.
    half_dead_s (HalfDeadS) = SECONDS { label: "time at which half of the SNs are dead", source: FigureSource::Links },
        |m| m.of_nodes(|energy| energy.half_dead_s);
    /// SNs dead at the end.
    dead (Dead) = REAL { label: "dead SNs", source: FigureSource::Links, report: Printed::Text(|summary| {
        let NodeEnergyUse { dead, first_death_s, .. } = summary.node_energy?;
        let first = first_death_s.map_or_else(String::new, |death_s| format!(", the first after {death_s} s"));
        Some(format!("{dead}{first}"))
    }) }, |m| m.of_nodes(|energy| Some(energy.dead));
    /// What dead SNs held and sampled, a part of all losses.
    lost_to_death_bits (LostToDeathBits) = BITS { label: "bits lost by dead SNs", source: FigureSource::Links },
        |m| m.of_nodes(|energy| Some(energy.lost_to_death_bits));
    /// Energy of all SNs over `delivered_bits`.
    energy_per_bit_j (EnergyPerBitJ) = JOULES {
        label: "energy of the SNs for a bit delivered", source: FigureSource::Links
    }, |m| m.of_nodes(|energy| energy.energy_per_bit_j);
    /// Least energy left in an SN, over the capacity.
    residual_min (ResidualMin) = FRACTION { label: "least energy left in an SN", source: FigureSource::Links },
        |m| m.of_nodes(|energy| Some(energy.residual_min));
    /// Mean energy left, over the capacity.
    residual_mean (ResidualMean) = FRACTION { label: "mean energy left in the SNs", source: FigureSource::Links },
        |m| m.of_nodes(|energy| Some(energy.residual_mean));
    /// Services refused for want of airtime (`link.duty_cycle`); no value without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    refused_duty (RefusedDuty): Option<u64> = REAL {
        label: "services refused because the SN had no airtime left", heading: "services without airtime",
        source: FigureSource::Links, report: COUNTED
    }, |m| m.run.refused_duty();
    /// Bits delivered over the bits before slot 1 and those sampled.
    #[serde(default)] // runs of older builds have none
    collection_ratio (CollectionRatio): f64 = FRACTION { label: "fraction of all bits collected" },
        |m| m.run.collection_ratio();
    /// End of the slot that delivers the last of the initial data; no value if some is left, or where an SN
    /// samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    completed_s (CompletedS): Option<f64> = SECONDS {
        label: "time at which all initial data is delivered", heading: "all data delivered after",
        report: Printed::Text(|summary| {
            let never = || "never".to_owned();
            summary.score.map(|_| summary.completed_s.map_or_else(never, |done_s| format!("{done_s} s")))
        })
    }, |m| m.run.completed_s;
    /// T τ − `completed_s`, or 0 if data is left, plus 100 times the fraction delivered; no value where an SN
    /// samples, or without data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    score (Score): Option<f64> = REAL {
        label: "seconds left when all is delivered, and 100 times the fraction delivered", heading: "score",
        report: Printed::Number(figure)
    }, |m| m.run.score();
    /// Whether all UAVs are in the base after the last slot and none is down (decision D9), 1 or 0 in results; no value
    /// without a base.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    landed (Landed): Option<bool> = FRACTION {
        label: "fraction of missions that end in the base", heading: "in the base at the end",
        report: Printed::Text(|summary| summary.landed.map(|landed| if landed { "yes" } else { "no" }.to_owned()))
    }, |m| m.run.landed;
    /// `landed` · `collection_ratio`.
    landed_ratio (LandedRatio) = FRACTION { label: "collection ratio of those that end in the base, else 0" },
        |m| m.run.landed.map(|landed| f64::from(u8::from(landed)) * m.run.collection_ratio());
    /// Time since the last service, including services of 0 bit: mean over all SNs and slots. 0 in the slot of the
    /// service; before the first service it is counted from the start of the mission.
    aoi_mean_s (AoiMeanS) = SECONDS { label: "mean time since the last service", source: FigureSource::Answers },
        |m| m.of_field(|field| field.service_ages.mean() * field.slot_s);
    /// 99th percentile of these N T ages: the smallest age that at most 1 % of them exceed (nearest rank).
    aoi_p99_s (AoiP99S) = SECONDS {
        label: "99th percentile of the time since the last service", source: FigureSource::Answers
    }, |m| m.of_field(|field| field.service_ages.quantile(0.99) as f64 * field.slot_s);
    /// Mean of these ages with the weights w_i of the SNs: Σ_i w_i Σ_t age_i(t) / (T Σ_i w_i).
    aoi_weighted_s (AoiWeightedS) = SECONDS {
        label: "mean time since the last service, by weight", source: FigureSource::Answers
    }, |m| m.of_field(|field| field.gaps.ages * field.slot_s / (m.run.gaps().weight() * m.run.slots as f64));
    /// Age in the slot before a service, mean over all services; the end of the mission counts as a service of every
    /// SN.
    aoi_peak_mean_s (AoiPeakMeanS) = SECONDS { label: "mean age before a service", source: FigureSource::Answers },
        |m| m.of_field(|field| field.gaps.peaks as f64 * field.slot_s / field.gaps.gaps as f64);
    /// The largest of these ages.
    aoi_peak_max_s (AoiPeakMaxS) = SECONDS { label: "largest age before a service", source: FigureSource::Answers },
        |m| m.of_field(|field| field.gaps.highest as f64 * field.slot_s);
    /// Σ_i w_i times the slots with an age above `sensors.deadline_s` (w_i = 1 if all are equal); no value without it.
    deadline_slots (DeadlineSlots) = REAL {
        label: "slots of sensor nodes with an age above the limit", source: FigureSource::Answers
    }, |m| m.of_field(|field| if field.has_deadline { field.gaps.late } else { f64::NAN });
    /// What the flight costs by `planner.objective` (decision D36); for `"collect"` the bits that are not delivered. It
    /// is no key of `summary.json` where the objective is the loss or `"collect"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    objective (Objective): Option<f64> = REAL {
        label: "cost by planner.objective", source: FigureSource::Links, report: Printed::Number(figure)
    }, |m| m.run.objective().or_else(|| m.of_field(|field| field.cost_of_bits));
    /// Time in which contacts were set up: `link.setup_s` for each service of an SN that the UAV has not served in the
    /// slot before; no value where they take no time.
    setup_s (SetupS) = SECONDS { label: "time in which contacts were set up" }, |m| m.of_field(|field| field.setup_s);
    /// Age of information of the delivered data, Δ_i(t), mean over all slots and all SNs that sample (s_i > 0); 0
    /// if there are none.
    data_age_mean_s (DataAgeMeanS) = SECONDS { label: "mean age of the delivered data", source: FigureSource::Links },
        |m| m.of_field(|field| field.data_ages.mean() * field.slot_s);
    /// 99th percentile of these ages (nearest rank).
    data_age_p99_s (DataAgeP99S) = SECONDS {
        label: "99th percentile of the age of the delivered data", source: FigureSource::Links
    }, |m| m.of_field(|field| field.data_ages.quantile(0.99) as f64 * field.slot_s);
    /// Jain's fairness index of the bits delivered by each SN, (Σ x_i)² / (N Σ x_i²); 1 if nothing was delivered.
    jain (Jain) = FRACTION { label: "Jain's fairness index", source: FigureSource::Links },
        |m| m.of_field(|field| jain(field.delivered_bits));
    /// 1 if the UAVs are trapped in one part of the area: more than a quarter of the SNs lie in none of the boxes, one
    /// around the waypoints of each UAV in the second half of the mission, each enlarged by d_c; otherwise 0.
    trapped (Trapped) = FRACTION { label: "fraction of trapped fields" },
        |m| m.of_field(|field| f64::from(u8::from(field.is_trapped)));
    /// Lower bound on η of every flight of this mission; only for `offline`.
    loss_bound (LossBound) = FRACTION { label: "lower bound of the data loss rate" },
        |m| m.of_bounds(|bounds| Some(bounds.loss_bound));
    /// Over a random channel: lower bound on the mean of η over the draws of the channel, for every planner that does
    /// not know them in advance; only for `offline`.
    expected_loss_bound (ExpectedLossBound) = FRACTION { label: "lower bound of the expected data loss rate" },
        |m| m.of_bounds(|bounds| bounds.expected_loss_bound);
    /// Lower bound on `objective` of every flight; only for `offline` with an objective of ages or `"collect"`.
    objective_bound (ObjectiveBound) = REAL { label: "lower bound of the cost by planner.objective" },
        |m| m.of_bounds(|bounds| bounds.objective_bound);
    /// Upper bound on `score`; only for `offline` where no SN samples.
    score_bound (ScoreBound) = REAL { label: "upper bound of the score" },
        |m| m.of_bounds(|bounds| bounds.score_bound);
    /// Slots in which a UAV held its position, without a plan in time or because its waypoint was refused; over all
    /// UAVs.
    held_slots (HeldSlots): u64 = COUNT { label: "slots held" }, each |held, slot| *held += slot.flown(Mode::Hold);
    /// Requests of plans that were refused: waypoints, and sensor nodes to serve.
    refused (Refused): u64 = COUNT { label: "requests refused" },
        each |refused, slot| *refused += slot.refused();
    /// Slots in transit (decision D8).
    transit_slots: u64 = COUNT { label: "slots in transit" },
        each |transit, slot| *transit += slot.flown(Mode::Transit);
    /// What several UAVs did together; no value with one. Other counts are sums over them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fleet: Option<FleetUse> = OTHER { report: Printed::Rows(|summary| FleetUse::report(summary.fleet.as_ref())) },
        |m| m.run.fleet;

    /// What became of the changes that the searches of `horizon` and `offline` proposed, by operator; empty without a
    /// search, and from a planner on another host.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    search: Vec<OperatorUse> = OF_RUN {}, |_| Vec::new();
    /// Waypoints that the chosen solver did not find: those of the geometric solver, or the centre that `exact` found.
    solver_fallbacks: u64 = OF_RUN {}, each |fallbacks, slot| {
        *fallbacks += slot.plans().filter(|plan| plan.solver == SolverOutcome::Fallback as u32).count() as u64;
    };
    /// Refused samples of the ring: of another run, a second writer, or an impossible slot.
    refused_messages: u64 = OF_RUN { label: "messages refused", report: COUNTED }, |m| m.run.refused_messages;
    /// Restarts of processes.
    restarts: u64 = OF_RUN { label: "processes restarted", report: COUNTED }, |m| m.run.restarts;
    /// Events of the processes.
    events: Vec<Event> = OF_RUN {}, |m| m.run.events.clone();
    /// The slot after which the run was resumed; wall times count from there.
    resumed_after: Option<u64> = OF_RUN {}, |m| m.run.resumed_after;
    /// Chained hash (XXH3) of the lines of `slots.csv`: equal for equal traces.
    trace_hash: String = OTHER {}, |m| format!("{:016x}", m.trace_hash);
    /// Whether all slots were flown.
    complete: bool = OF_RUN {}, |m| m.run.slots == m.run.labels.planned_slots;
    /// Version of Skysink.
    version: Cow<'static, str> = OF_RUN {}, |_| VERSION.into();
    /// Commit, compiler and target of the program that has written it.
    #[serde(default)] // runs of older builds have none
    build: Cow<'static, str> = OF_RUN {}, |_| build().into();
    /// Median of the wall-clock planning times of the slots; in `timings.csv`.
    plan_p50_us (PlanP50Us) = WALL_CLOCK { label: "planning time" }, |m| m.timing.plan_p50_us;
    /// 99th percentile of these times; in `timings.csv`.
    plan_p99_us (PlanP99Us) = WALL_CLOCK { label: "99th percentile of the planning time" }, |m| m.timing.plan_p99_us;
    /// Wall-clock figures; not reproducible.
    timing: RunTiming = OF_RUN { report: Printed::Rows(|summary| summary.timing.report()) }, |m| m.timing.clone();
}
