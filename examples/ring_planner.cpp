// An external planner: flies to the fullest queue in reach, or else straight toward the fullest of all, and serves the
// n fullest in range, as `gfs` does. CMakeLists.txt says how to build and start it.

#include "ring.hpp"

using namespace skysink;

Plan greedy(const View& view) {
    const Limits& limits = view.limits;
    const auto fullest_around = [&](const Position& place, double radius_m) { // at most n; of equals the lowest ids
        std::vector<uint32_t> ids;
        for (uint32_t id = 0; id < view.nodes.number_of_elements(); ++id) {
            if (within(view.position(id), place, radius_m)) ids.push_back(id);
        }
        const auto is_fuller = [&](uint32_t a, uint32_t b) { return view.queues_bits[a] > view.queues_bits[b]; };
        std::stable_sort(ids.begin(), ids.end(), is_fuller);
        ids.resize(std::min<size_t>(ids.size(), limits.resource_blocks));
        return ids;
    };
    const Position uav = view.uav();
    const auto reached = fullest_around(uav, limits.reach_m);
    if (!reached.empty()) {
        const Position goal = view.position(reached[0]);
        return plan_to(goal, view.flight.z_m, Mode::Serve, fullest_around(goal, limits.comm_radius_m));
    }
    Position goal = view.position(0);
    for (uint32_t id = 0, fullest = 0; id < view.nodes.number_of_elements(); ++id) { // of equals the nearest
        const int64_t more = int64_t(view.queues_bits[id]) - view.queues_bits[fullest];
        if (more < 0 || (more == 0 && distance_m2(view.position(id), uav) >= distance_m2(goal, uav))) continue;
        fullest = id;
        goal = view.position(id);
    }
    const double away_m = std::sqrt(distance_m2(goal, uav));
    const auto along = [&](double from_m, double to_m) { return from_m + (to_m - from_m) / away_m * limits.reach_m; };
    const Position waypoint { std::clamp(along(uav.x_m, goal.x_m), 0.0, limits.width_m),
                              std::clamp(along(uav.y_m, goal.y_m), 0.0, limits.height_m) };
    return plan_to(waypoint, view.flight.z_m, Mode::Transit, fullest_around(waypoint, limits.comm_radius_m));
}

int main() { return plan_slots(greedy); }
