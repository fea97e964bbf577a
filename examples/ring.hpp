// Connects an external planner or vehicle in C++ to Skysink's ring: topics, waiting, and the slots to plan or to fly.
// Planning and flying are left to them; docs/src/interfaces.md specifies the protocol.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iostream>
#include <iterator>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "iox2/iceoryx2.hpp"
#include "skysink.hpp"

namespace skysink {

// A position on the ground [m].
struct Position {
    double x_m;
    double y_m;
};

inline double distance_m2(const Position& a, const Position& b) {
    return (a.x_m - b.x_m) * (a.x_m - b.x_m) + (a.y_m - b.y_m) * (a.y_m - b.y_m);
}

// Whether `a` and `b` are at most radius_m apart, up to rounding.
inline bool within(const Position& a, const Position& b, double radius_m) {
    const double limit_m = radius_m * (1.0 + 1e-9);
    return distance_m2(a, b) <= limit_m * limit_m;
}

// The input of a planner for a slot.
struct View {
    // The slot to plan, from 1.
    uint64_t slot;
    // The constraints on every plan.
    const Limits& limits;
    // The sensor nodes, by id.
    iox2::bb::ImmutableSlice<SensorNode> nodes;
    // Their queues [bit] at the start of the slot, true or believed.
    iox2::bb::ImmutableSlice<uint32_t> queues_bits;
    // Position of the UAV, and the report of the previous slot.
    const FlightReport& flight;

    Position position(uint32_t id) const { return { nodes[id].x_m, nodes[id].y_m }; }
    Position uav() const { return { flight.x_m, flight.y_m }; }
};

// A plan that flies to `waypoint`, at the altitude z_m, and serves `ids`, at most the n of the limits.
inline Plan plan_to(const Position& waypoint, double z_m, Mode mode, std::vector<uint32_t> ids) {
    Plan plan {};
    plan.x_m = waypoint.x_m;
    plan.y_m = waypoint.y_m;
    plan.z_m = z_m;
    for (auto& circle : plan.circles_m) {
        circle[0] = circle[1] = NAN;
    }
    plan.anchor = plan.partner = plan.chosen = NOBODY;
    plan.mode = static_cast<uint32_t>(mode);
    std::fill(std::begin(plan.ids), std::end(plan.ids), NOBODY);
    if (ids.size() > std::size(plan.ids)) {
        throw std::length_error("a plan with more sensor nodes than a message holds");
    }
    std::sort(ids.begin(), ids.end());
    std::copy(ids.begin(), ids.end(), plan.ids);
    plan.served = static_cast<uint32_t>(ids.size());
    return plan;
}

// Time on the monotonic clock [ns].
inline uint64_t now_ns() {
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

// Exit code of a process that skysink run does not start again.
constexpr int REFUSED = 2;

// The ring's folder, set up as iceoryx2's configuration; empty, after a line that says why, if there is none.
inline std::string join() {
    const char* folder = std::getenv("SKYSINK_RING");
    if (folder == nullptr) {
        std::cerr << "SKYSINK_RING is missing: expected the ring's folder, as skysink run prints it\n";
        return "";
    }
    iox2::set_log_level_from_env_or(iox2::LogLevel::Fatal);
    const auto config = iox2::bb::FilePath::create((std::string(folder) + "/config/iceoryx2.toml").c_str());
    if (!config.has_value() || !iox2::Config::setup_global_config_from_file(config.value()).has_value()) {
        std::cerr << "SKYSINK_RING = " << folder << ": expected the folder of a running ring\n";
        return "";
    }
    return folder;
}

// Calls `plan_slot` for each slot of the ring in the folder SKYSINK_RING, until the mission ends or a signal arrives.
// Errors of iceoryx2 end the process.
inline int plan_slots(const std::function<Plan(const View&)>& plan_slot) {
    using namespace iox2;
    if (join().empty()) {
        return REFUSED;
    }
    const auto node = NodeBuilder().create<ServiceType::Ipc>().value();
    const auto topic = [&](const char* name) { return node.service_builder(ServiceName::create(name).value()); };
    const auto events = [&](const char* name) { return topic(name).event().open().value(); };
    auto plan_topic =
        topic("skysink/plan").publish_subscribe<bb::Slice<Plan>>().user_header<SlotHeader>().open().value();
    auto sensor_topic =
        topic("skysink/sensors").publish_subscribe<bb::Slice<SensorNode>>().user_header<SensorsHeader>().open().value();
    const auto open_queues = [&](const char* name) {
        return topic(name).publish_subscribe<bb::Slice<uint32_t>>().user_header<QueuesHeader>().open();
    };
    // What the UAV knows of the queues: its belief, where they are estimated.
    const char* known_queues = open_queues("skysink/belief").has_value() ? "skysink/belief" : "skysink/queues";
    auto queue_topic = open_queues(known_queues).value();
    auto flight_topic =
        topic("skysink/flight").publish_subscribe<bb::Slice<FlightReport>>().user_header<SlotHeader>().open().value();
    auto plans = plan_topic.publisher_builder().create().value();
    auto sensors = sensor_topic.subscriber_builder().create().value();
    auto queues = queue_topic.subscriber_builder().create().value();
    auto flights = flight_topic.subscriber_builder().create().value();
    auto planned = events("skysink/plan").notifier_builder().create().value();
    auto queued = events(known_queues).listener_builder().create().value();
    auto flown = events("skysink/flight").listener_builder().create().value();
    auto waitset = WaitSetBuilder().create<ServiceType::Ipc>().value();
    const auto queued_guard = waitset.attach_notification(queued).value();
    const auto flown_guard = waitset.attach_notification(flown).value();

    auto field = sensors.receive().value();
    auto state = queues.receive().value(); // the queues to be answered
    std::map<uint64_t, FlightReport> reports; // by slot
    uint64_t next = 0;
    uint64_t connected_ns = now_ns();
    auto ran = WaitSetRunResult::AllEventsHandled;
    while (ran == WaitSetRunResult::AllEventsHandled) {
        // Events only wake the process, and may be lost: take all events, then all samples, after every wake-up.
        for (auto* listener : { &queued, &flown }) {
            while (listener->try_wait([](auto) {}).value() != 0) {
            }
        }
        for (auto report = flights.receive().value(); report.has_value(); report = flights.receive().value()) {
            if (report->payload().number_of_elements() == 1) { // one for each UAV
                reports.insert({ report->user_header().slot, report->payload()[0] });
            }
        }
        if (!field.has_value()) {
            field = sensors.receive().value();
        }
        if (!state.has_value()) {
            state = queues.receive().value();
        }
        while (field.has_value() && state.has_value()) {
            const SlotHeader head = state->user_header().head;
            const auto report = reports.lower_bound(head.slot);
            if ((head.flags & FLAG_END) != 0) {
                return 0;
            }
            if (head.slot >= next && report == reports.end()) {
                break; // its flight is still to come
            }
            // Repeated slots have been answered; slots whose flight has passed were flown without this process.
            if (head.slot >= next && report->first == head.slot) {
                const auto begin = now_ns();
                Plan plan = plan_slot(View { head.slot + 1, field->user_header().limits, field->payload(),
                                             state->payload(), report->second });
                plan.plan_ns = now_ns() - begin;
                next = head.slot + 1;
                auto sample = plans.loan_slice_uninit(1).value(); // one for each UAV
                sample.user_header_mut() = SlotHeader { head.mission, next, 0, 0, now_ns() };
                send(sample.write_from_fn([&](auto) { return plan; })).value();
                planned.notify().value();
                reports.erase(reports.begin(), std::next(report)); // no earlier one is asked for
            }
            state = queues.receive().value();
        }
        const auto wake = [](auto) { return CallbackProgression::Continue; };
        ran = waitset.wait_and_process_once_with_timeout(wake, bb::Duration::from_millis(100)).value();
        if (now_ns() - connected_ns >= 100'000'000) { // a restarted reader gets the last plans
            connected_ns = now_ns();
            plans.update_connections().value();
            planned.notify().value();
        }
    }
    return 0;
}

} // namespace skysink
