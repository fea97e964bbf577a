// A vehicle of your own in the place of flight-sim: it flies at most 12 m/s, so that longer legs end before their waypoint, and
// reports what its radio has measured. CMakeLists.txt says how to build and start it.

#include "ring_flight.hpp"

using namespace skysink;

// Highest speed [m/s].
constexpr double SPEED_MPS = 12.0;

// Rates of the radio above a sensor node and at the end of its range [bit/s].
constexpr double NEAREST_BPS = 2e5;
constexpr double FARTHEST_BPS = 5e4;

FlightReport fly(const Order& order) {
    std::array<double, 3> leg_m {};
    for (size_t axis = 0; axis < 3; ++axis) {
        leg_m[axis] = order.waypoint_m[axis] - order.position_m[axis];
    }
    const double length_m = std::sqrt(leg_m[0] * leg_m[0] + leg_m[1] * leg_m[1] + leg_m[2] * leg_m[2]);
    const double farthest_m = SPEED_MPS * order.limits.slot_s;
    const double flown = length_m > farthest_m ? farthest_m / length_m : 1.0; // fraction of the leg
    std::array<double, 3> at_m = order.waypoint_m;
    for (size_t axis = 0; axis < 3 && flown < 1.0; ++axis) {
        at_m[axis] = order.position_m[axis] + flown * leg_m[axis];
    }
    FlightReport report = report_at(at_m);
    for (size_t axis = 0; axis < 3; ++axis) {
        report.velocity_mps[axis] = flown * leg_m[axis] / order.limits.slot_s;
    }
    return report;
}

// Stands for a measurement: a rate that falls linearly with the horizontal distance, over the time to communicate.
uint64_t measure_bits(const Order& order, const FlightReport&, const SensorNode&, double distance_m) {
    const double fraction = std::min(distance_m / order.limits.comm_radius_m, 1.0);
    const double rate_bps = NEAREST_BPS + (FARTHEST_BPS - NEAREST_BPS) * fraction;
    return static_cast<uint64_t>(rate_bps * order.limits.comm_s);
}

int main() { return fly_slots({ fly, measure_bits }); }
