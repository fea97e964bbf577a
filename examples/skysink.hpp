// The messages of Skysink's ring (docs/src/interfaces.md), generated from common/src/message.rs by
// cargo test --workspace --test it write_the_layouts -- --ignored

#pragma once

#include <cstddef>
#include <cstdint>

namespace skysink {

/// Most resource blocks of a UAV, and so most served sensor nodes in a message.
constexpr static const size_t MAX_RESOURCE_BLOCKS = 64;

/// Most sensor nodes in one plan.
constexpr static const size_t MAX_SERVED = MAX_RESOURCE_BLOCKS;

/// Most points of a path.
constexpr static const size_t MAX_PATH_POINTS = 64;

/// Id of no sensor node.
constexpr static const uint32_t NOBODY = UINT32_MAX;

/// [`SlotHeader::flags`]: the last slot of the mission; nothing follows.
constexpr static const uint32_t FLAG_END = 1;

/// [`SlotHeader::flags`]: sent before, because a link between hosts may have lost it. Readers drop a slot that they
/// have.
constexpr static const uint32_t FLAG_REPEAT = 2;

/// Mode of the UAV in a slot, by its number in messages and its name in `slots.csv`; an unknown number is a hold.
enum class Mode : uint32_t {
    /// Flies to the strategy's own waypoint and serves there. A plan may say so whether it serves or not.
    Serve,
    /// Flies straight toward the fullest queue, because the strategy finds no sensor node in reach.
    Transit,
    /// Holds its position and serves no sensor node.
    Hold,
    /// Flies to the strategy's own waypoint and serves no sensor node there.
    Fly,
    /// Stays in the base, serves no sensor node, and charges (decision D11).
    Charge,
    /// Flies toward the base, because of the energy or the time that is left (decision D13), and serves on the way.
    Return,
    /// Is down where its energy ended, for the rest of the mission (decision D12).
    Down,
    /// Has not reached the waypoint by the end of the slot: the next plan begins where the vehicle is. Only vehicles
    /// from outside report it.
    EnRoute,
};

/// How the waypoint was found, by its number in messages; an unknown one, from an external planner, is its own rule.
enum class SolverOutcome : uint32_t {
    /// By the strategy's own rule; no problem was solved.
    Rule,
    /// By the chosen solver.
    Solved,
    /// The chosen solver gave no usable point: by the geometric solver, or the centre that `exact` found.
    Fallback,
    /// The end of a recorded flight, which is flown again without a position error (decision D29).
    Recorded,
};

/// Why the UAV held its position, by its number in messages; an unknown number is read as `None`.
enum class HoldReason : uint32_t {
    /// It did not hold.
    None,
    /// No plan had arrived when the slot began.
    NoPlan,
    /// The waypoint was not finite, out of reach or outside the area.
    Waypoint,
    /// It was to charge, and is not in the base.
    Base,
    /// The way to the waypoint led through a no-fly zone or a building.
    Zone,
    /// The slot would have ended too near to a UAV of lower number (decision D23).
    Separation,
    /// There was a plan, but the vehicle was not heard, or not believed to be where it said.
    Unknown,
    /// It has landed to charge, and all pads of its site are taken: it waits, in mode `charge` (decision D34).
    Pad,
};

/// User header of every sample; those of `sensors`, `belief` and `queues` begin with it.
struct SlotHeader {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.SlotHeader.v1";
    /// The run that the sample belongs to.
    uint64_t mission;
    /// The slot, from 1; 0 is the state before the first.
    uint64_t slot;
    /// Restart count of the writer.
    uint32_t epoch;
    /// [`FLAG_END`], [`FLAG_REPEAT`].
    uint32_t flags;
    /// When it was sent, on the monotonic clock [ns].
    uint64_t sent_ns;
};

/// The constraints on every plan of a mission, so that a planner needs no scenario file.
struct Limits {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.Limits.v2";
    /// The area, 0 to this, east [m].
    double width_m;
    /// The area, 0 to this, north [m].
    double height_m;
    /// Horizontal distance that one slot reaches in every direction, `V_max τ` [m]; less with wind and acceleration.
    double reach_m;
    /// Farthest horizontal distance at which a sensor node can be served, `d_c` [m].
    double comm_radius_m;
    /// Length of a slot, `τ` [s].
    double slot_s;
    /// Time to communicate at the end of a slot, `τ_c` [s].
    double comm_s;
    /// Lowest altitude [m]; `H` where it is fixed.
    double min_altitude_m;
    /// Highest altitude [m]; `H` where it is fixed.
    double max_altitude_m;
    /// Farthest climb or descent in one slot [m]; 0 where the altitude is fixed.
    double climb_m;
    /// Slots of the mission, `T`.
    uint64_t slots;
    /// Resource blocks `n`: the most sensor nodes served in a slot.
    uint32_t resource_blocks;
    /// Zero.
    uint32_t reserved;
    /// Latitude of the south-west corner of the area [deg]; infinite without an origin.
    double origin_lat_deg;
    /// Longitude of the south-west corner of the area [deg]; infinite without an origin.
    double origin_lon_deg;
    /// Start of the first UAV, east, north, up [m].
    double start_m[3];
    /// Seed of the mission's draws.
    uint64_t seed;
};

/// User header of `sensors`.
struct SensorsHeader {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.SensorsHeader.v2";
    /// Mission and slot.
    SlotHeader head;
    /// The constraints on every plan.
    Limits limits;
};

/// Payload element of `sensors`: one sensor node.
struct SensorNode {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.SensorNode.v2";
    /// Position, east [m].
    double x_m;
    /// Position, north [m].
    double y_m;
    /// Reference channel gain at 1 m, `α_i`, as a linear ratio.
    double gain;
    /// Sampling rate `s_i` [bit/s].
    double sampling_bps;
    /// Buffer `B` [bit].
    uint32_t capacity_bits;
    /// Zero.
    uint32_t reserved;
    /// Weight `w_i` of its bits (decision D25), above 0; 1 if the list has no weights.
    double weight;
};

/// Payload element of `answers`: what a sensor node does when it is served in the next slot (decision D33), as a number:
/// 0 sends its queue, 1 is silent, and sends later, 2 is dead.
struct NodeAnswer {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.NodeAnswer.v1";
    /// What it does.
    uint8_t answer;
    /// That as the UAVs know it: where queues are estimated, only a contact shows a death.
    uint8_t known;
};

/// Bits of the whole field since the mission's start.
struct Totals {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.Totals.v1";
    /// Queued before slot 1.
    uint64_t initial_bits;
    /// Sampled by the sensor nodes.
    uint64_t sampled_bits;
    /// Uploaded to the UAV.
    uint64_t delivered_bits;
    /// Lost to full buffers, `Σ D_i` (UTS eq. 8), or expired.
    uint64_t lost_bits;
    /// Queued now.
    uint64_t queued_bits;
    /// `Σ_t Σ_i D_i(t) / (s_i τ)`: the loss in slots of sampling, for the paper's loss rate.
    double lost_slots;
};

/// User header of `queues`, and of `belief`, there without totals.
struct QueuesHeader {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.QueuesHeader.v1";
    /// Mission and slot.
    SlotHeader head;
    /// Every bit since the mission's start, after this slot.
    Totals totals;
    /// Bits uploaded in this slot.
    uint64_t delivered_bits;
    /// Bits lost in this slot.
    uint64_t lost_bits;
};

/// Payload element of `plan`: the schedule and the waypoint of a UAV in the slot.
struct Plan {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.Plan.v1";
    /// Waypoint at the end of the slot, east [m].
    double x_m;
    /// Waypoint, north [m].
    double y_m;
    /// Waypoint, up [m].
    double z_m;
    /// Bits that the planner expects to collect in the slot.
    uint64_t expected_bits;
    /// Time that planning took [ns]; 0 if not measured.
    uint64_t plan_ns;
    /// Centres [m] of the five candidate circles of the winning anchor, C1 to C5; NaN where there are none.
    double circles_m[5][2];
    /// Anchor SN i of the winning set, or [`NOBODY`].
    uint32_t anchor;
    /// Its partner SN k, or [`NOBODY`].
    uint32_t partner;
    /// Index of the winning circle, from 0; 5 or more: none.
    uint32_t chosen;
    /// [`Mode`], as a number.
    uint32_t mode;
    /// [`SolverOutcome`], as a number.
    uint32_t solver;
    /// Number of valid `ids`.
    uint32_t served;
    /// Scheduled sensor nodes, ascending.
    uint32_t ids[MAX_SERVED];
};

/// Payload element of `links`: what a UAV hears of a sensor node within `link.beacon_radius_m` at the end of the slot,
/// scheduled or not (decision D32). They ascend by UAV, and then by sensor node.
struct HeardLink {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.HeardLink.v1";
    /// Number of the UAV, from 0.
    uint32_t uav;
    /// The sensor node.
    uint32_t sensor;
    /// Signal-to-noise ratio [dB].
    float snr_db;
};

/// Payload element of `path`: a planned waypoint. The first of each UAV is that of the slot's own plan.
struct PathPoint {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.PathPoint.v2";
    /// East [m].
    double x_m;
    /// North [m].
    double y_m;
    /// Up [m].
    double z_m;
    /// Number of the UAV, from 0. All points of a UAV follow one another, and UAVs ascend.
    uint32_t uav;
    /// 0.
    uint32_t reserved;
};

/// One served link of a slot.
struct LinkReport {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.LinkReport.v1";
    /// The sensor node.
    uint32_t sensor;
    /// 1 in line of sight, 0 not.
    uint32_t line_of_sight;
    /// Horizontal distance `d` [m].
    double distance_m;
    /// Elevation angle of the UAV, seen from the sensor node [deg].
    double elevation_deg;
    /// Rate `r_i` [bit/s].
    double rate_bps;
    /// Whole bits that the link can carry in the slot, `floor(r_i τ_c)`.
    uint64_t capacity_bits;
};

/// Payload element of `flight`: the position of a UAV after the slot, and the capacity of each of its links.
struct FlightReport {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.FlightReport.v4";
    /// Position, east [m].
    double x_m;
    /// Position, north [m].
    double y_m;
    /// Position, up [m].
    double z_m;
    /// Energy in the battery after the slot, `E(t)` [J]; infinite without a battery.
    double energy_j;
    /// When the vehicle was there [s], from the start of slot 1, by its own clock; the end of the slot if it is
    /// simulated.
    double time_s;
    /// Velocity there, east, north, up [m/s].
    double velocity_mps[3];
    /// Heading, clockwise from north [deg]; infinite if it is not known.
    double heading_deg;
    /// Covariance of the position [m²]: xx, xy, xz, yy, yz, zz; 0 if the position is exact.
    double covariance_m2[6];
    /// [`Mode`] flown, as a number.
    uint32_t mode;
    /// [`HoldReason`], as a number.
    uint32_t hold;
    /// Requests of the plan that were refused: sensor nodes, or the waypoint.
    uint32_t refused;
    /// How many of `links` count.
    uint32_t served;
    /// Slots that a swap of the battery has taken so far (decision D34); 0 outside of one.
    uint32_t swapped_slots;
    /// 0.
    uint32_t reserved;
    /// The served links, by ascending sensor node.
    LinkReport links[MAX_SERVED];
};

/// Payload of `tick`, in paced runs: the slot in the sample's header begins now.
struct Tick {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.Tick.v1";
    /// Wall time from one slot to the next [ns].
    uint64_t period_ns;
};

/// Payload of `commit`: the slot in the sample's header is in `slots.csv`.
struct Commit {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.Commit.v1";
    /// Chained hash of the slot records up to this one.
    uint64_t hash;
};

/// Payload of `ready`: the process is connected to all writers; the sample's slot is the first that it has drawn.
struct Ready {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.Ready.v1";
    /// The process, by its number in [`Health`]: 3, the viewer.
    uint32_t process;
    /// Restart count of the process.
    uint32_t restarts;
};

/// Payload of `health`; the sample's slot is the one under way.
struct Health {
    static constexpr const char* IOX2_TYPE_NAME = "skysink.Health.v1";
    /// The process: 0 field-sim, 1 flight-sim, 2 planner, 3 viewer, 4 the launcher.
    uint32_t process;
    /// 0 killed, 1 exited, 2 restarted, 3 silent, 4 recovered, 5 overdue, 6 missing, 7 joined, 8 held.
    uint32_t event;
    /// The signal, the exit code, the number of restarts or held slots, or the time [ms]; of a missing process 0 if the
    /// run waits for it, else 1; 0 for joined.
    int32_t detail;
    /// Zero.
    uint32_t reserved;
};

}  // namespace skysink

static_assert(sizeof(skysink::SlotHeader) == 32, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::SensorsHeader) == 168, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::Limits) == 136, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::SensorNode) == 48, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::NodeAnswer) == 2, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::QueuesHeader) == 96, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::Totals) == 48, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::Plan) == 400, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::HeardLink) == 12, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::PathPoint) == 32, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::FlightReport) == 2704, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::LinkReport) == 40, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::Tick) == 8, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::Commit) == 8, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::Ready) == 8, "the layout of docs/src/interfaces.md");
static_assert(sizeof(skysink::Health) == 16, "the layout of docs/src/interfaces.md");
