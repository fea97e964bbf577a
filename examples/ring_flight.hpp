// Connects an external vehicle in C++ to Skysink's ring: orders, reports, and what a restart needs.
// Where the vehicle is, and what its radio carries, is left to the vehicle; docs/src/vehicle.md describes a slot.
#pragma once

#include <array>

#include "ring.hpp"

namespace skysink {

// A slot ends at the waypoint if it ends this near to it [m]; farther away the vehicle is en route.
constexpr double REACHED_M = 2.0;

// A position farther outside the area than this is not believed [m].
constexpr double ASTRAY_M = 1e5;

// What a vehicle is to do in a slot.
struct Order {
    // The slot, from 1.
    uint64_t slot;
    // The mission: area, reach, range, length of a slot.
    const Limits& limits;
    // The sensor nodes, by id.
    iox2::bb::ImmutableSlice<SensorNode> nodes;
    // Where it was at the end of the slot before [m].
    std::array<double, 3> position_m;
    // Where it is to be at the end of the slot [m]; the position if it is to stay.
    std::array<double, 3> waypoint_m;
    // When the slot ends in a paced run [ns], on the monotonic clock; 0 without a pace.
    uint64_t ends_ns;
};

// A report from a position that serves nobody.
inline FlightReport report_at(const std::array<double, 3>& at_m) {
    FlightReport report {};
    report.x_m = at_m[0];
    report.y_m = at_m[1];
    report.z_m = at_m[2];
    report.energy_j = report.heading_deg = INFINITY;
    return report;
}

// What a vehicle does.
struct Vehicle {
    // Flies a slot, and reports where the vehicle is at its end: `report_at`, and what else it knows.
    std::function<FlightReport(const Order&)> fly;
    // Whole bits that the link to a sensor node carries in the slot, from where it is at the end of it.
    std::function<uint64_t(const Order&, const FlightReport&, const SensorNode&, double distance_m)> measure_bits;
};

// A plan that a vehicle may follow is finite, in the area and in reach. The zones of a scenario are not on the topics.
inline HoldReason check(const Plan* plan, const Limits& limits, const FlightReport& from) {
    if (plan == nullptr) {
        return HoldReason::NoPlan;
    }
    const double away_m = std::hypot(plan->x_m - from.x_m, plan->y_m - from.y_m);
    const bool is_inside = plan->x_m >= 0.0 && plan->x_m <= limits.width_m && plan->y_m >= 0.0
                           && plan->y_m <= limits.height_m && std::isfinite(plan->z_m);
    return is_inside && away_m <= limits.reach_m * (1.0 + 1e-9) ? HoldReason::None : HoldReason::Waypoint;
}

// Whether a vehicle can be where it says; not if a number is none.
inline bool is_possible(const FlightReport& report, const Limits& limits) {
    const auto is_near = [](double at_m, double size_m) { return at_m >= -ASTRAY_M && at_m <= size_m + ASTRAY_M; };
    double sum = report.time_s;
    for (const double number : report.velocity_mps) {
        sum += number;
    }
    for (const double number : report.covariance_m2) {
        sum += number;
    }
    return is_near(report.x_m, limits.width_m) && is_near(report.y_m, limits.height_m) && is_near(report.z_m, 0.0)
           && std::isfinite(sum) && !std::isnan(report.heading_deg) && !std::isnan(report.energy_j);
}

// Flies a slot by its plan, `nullptr` if there is none in time, and completes the report: mode, links and refusals.
inline FlightReport fly_slot(const Vehicle& vehicle, Order order, const Plan* plan, const FlightReport& before) {
    const HoldReason hold = check(plan, order.limits, before);
    const bool is_followed = hold == HoldReason::None;
    if (is_followed) {
        const double z_m = order.limits.climb_m > 0.0 ? plan->z_m : before.z_m;
        order.waypoint_m = { plan->x_m, plan->y_m, z_m };
    }
    FlightReport report = vehicle.fly(order);
    report.time_s = static_cast<double>(order.slot) * order.limits.slot_s;
    report.hold = static_cast<uint32_t>(hold);
    report.mode = static_cast<uint32_t>(Mode::Hold);
    report.refused = hold == HoldReason::Waypoint ? 1 : 0;
    if (!is_followed) {
        return report;
    }
    for (uint32_t index = 0; index < std::min<uint32_t>(plan->served, MAX_SERVED); ++index) {
        const uint32_t id = plan->ids[index];
        const bool exists = id < order.nodes.number_of_elements();
        const Position at { report.x_m, report.y_m };
        if (!exists || !within({ order.nodes[id].x_m, order.nodes[id].y_m }, at, order.limits.comm_radius_m)) {
            report.refused += 1;
            continue;
        }
        LinkReport& link = report.links[report.served++];
        link.sensor = id;
        link.line_of_sight = 1;
        link.distance_m = std::sqrt(distance_m2({ order.nodes[id].x_m, order.nodes[id].y_m }, at));
        link.elevation_deg = std::atan2(report.z_m, link.distance_m) * 180.0 / 3.14159265358979323846;
        link.capacity_bits = vehicle.measure_bits(order, report, order.nodes[id], link.distance_m);
        link.rate_bps = static_cast<double>(link.capacity_bits) / order.limits.comm_s;
    }
    const auto planned = static_cast<Mode>(plan->mode);
    const double left_m = std::hypot(std::hypot(order.waypoint_m[0] - report.x_m, order.waypoint_m[1] - report.y_m),
                                     order.waypoint_m[2] - report.z_m);
    const Mode moved = planned == Mode::Transit || planned == Mode::Return ? planned
                       : report.served > 0                                 ? Mode::Serve
                                                                           : Mode::Fly;
    report.mode = static_cast<uint32_t>(left_m <= REACHED_M ? moved : Mode::EnRoute);
    return report;
}

// The reports of the last slots, in a file of the ring's folder: a restarted vehicle sends them again, and flies on.
class SavedReports {
  public:
    explicit SavedReports(const std::string& folder) : m_file { folder + "/vehicle.flights" } {
        std::ifstream in { m_file, std::ios::binary };
        for (Saved saved; in.read(reinterpret_cast<char*>(&saved), sizeof saved);) {
            reports.insert({ saved.slot, saved.report });
        }
    }

    // Saves a report, before it is sent. The file is replaced as a whole.
    void save(uint64_t slot, const FlightReport& report) {
        reports.insert({ slot, report });
        if (reports.size() > KEPT) {
            reports.erase(reports.begin());
        }
        const std::string next = m_file + ".next";
        std::ofstream out { next, std::ios::binary | std::ios::trunc };
        for (const auto& [saved_slot, saved] : reports) {
            const Saved row { saved_slot, saved };
            out.write(reinterpret_cast<const char*>(&row), sizeof row);
        }
        out.close();
        if (!out || std::rename(next.c_str(), m_file.c_str()) != 0) {
            throw std::runtime_error("cannot write " + m_file);
        }
    }

    // By slot.
    std::map<uint64_t, FlightReport> reports;

  private:
    // The topic `flight` gives as many to a process that joins.
    static constexpr size_t KEPT = 3;

    struct Saved {
        uint64_t slot;
        FlightReport report;
    };

    std::string m_file;
};

// Whether the slots of a ring begin by the clock.
inline bool is_paced(const std::string& folder) {
    std::ifstream terms { folder + "/ring.toml" };
    for (std::string line; std::getline(terms, line);) {
        if (line.rfind("pace = ", 0) == 0) {
            return line.find("\"max\"") == std::string::npos;
        }
    }
    return false;
}

// Flies the plans of the ring in the folder SKYSINK_RING with one vehicle, until the mission ends or a signal arrives.
// Errors of iceoryx2 end the process.
inline int fly_slots(const Vehicle& vehicle) {
    using namespace iox2;
    const std::string folder = join();
    if (folder.empty()) {
        return REFUSED;
    }
    const auto node = NodeBuilder().create<ServiceType::Ipc>().value();
    const auto topic = [&](const char* name) { return node.service_builder(ServiceName::create(name).value()); };
    const auto events = [&](const char* name) { return topic(name).event().open().value(); };
    auto sensor_topic =
        topic("skysink/sensors").publish_subscribe<bb::Slice<SensorNode>>().user_header<SensorsHeader>().open().value();
    auto plan_topic =
        topic("skysink/plan").publish_subscribe<bb::Slice<Plan>>().user_header<SlotHeader>().open().value();
    auto tick_topic = topic("skysink/tick").publish_subscribe<Tick>().user_header<SlotHeader>().open().value();
    auto flight_topic =
        topic("skysink/flight").publish_subscribe<bb::Slice<FlightReport>>().user_header<SlotHeader>().open().value();
    auto commit_topic = topic("skysink/commit").publish_subscribe<Commit>().user_header<SlotHeader>().open().value();
    auto flights = flight_topic.publisher_builder().create().value();
    auto sensors = sensor_topic.subscriber_builder().create().value();
    auto plans = plan_topic.subscriber_builder().create().value();
    auto ticks = tick_topic.subscriber_builder().create().value();
    auto commits = commit_topic.subscriber_builder().create().value();
    auto flown = events("skysink/flight").notifier_builder().create().value();
    auto sensed = events("skysink/sensors").listener_builder().create().value();
    auto planned = events("skysink/plan").listener_builder().create().value();
    auto ticked = events("skysink/tick").listener_builder().create().value();
    auto committed = events("skysink/commit").listener_builder().create().value();
    auto waitset = WaitSetBuilder().create<ServiceType::Ipc>().value();
    const auto sensed_guard = waitset.attach_notification(sensed).value();
    const auto planned_guard = waitset.attach_notification(planned).value();
    const auto ticked_guard = waitset.attach_notification(ticked).value();
    const auto committed_guard = waitset.attach_notification(committed).value();

    const bool has_pace = is_paced(folder);
    SavedReports saved { folder };
    auto field = sensors.receive().value();
    std::map<uint64_t, Plan> received; // by slot
    uint64_t begun = 0;                // the slot that the clock has begun
    uint64_t ends_ns = 0;
    uint64_t connected_ns = 0;
    bool is_started = false;
    const auto send_report = [&](uint64_t slot, const FlightReport& report) {
        auto sample = flights.loan_slice_uninit(1).value(); // one for each UAV
        sample.user_header_mut() = SlotHeader { field->user_header().head.mission, slot, 0, 0, now_ns() };
        send(sample.write_from_fn([&](auto) { return report; })).value();
        flown.notify().value();
    };
    auto ran = WaitSetRunResult::AllEventsHandled;
    while (ran == WaitSetRunResult::AllEventsHandled) {
        // Events only wake the process, and may be lost: take all events, then all samples, after every wake-up.
        for (auto* listener : { &sensed, &planned, &ticked, &committed }) {
            while (listener->try_wait([](auto) {}).value() != 0) {
            }
        }
        if (!field.has_value()) {
            field = sensors.receive().value();
        }
        for (auto plan = plans.receive().value(); plan.has_value(); plan = plans.receive().value()) {
            if (plan->payload().number_of_elements() == 1) {
                received.insert({ plan->user_header().slot, plan->payload()[0] });
            }
        }
        for (auto tick = ticks.receive().value(); tick.has_value(); tick = ticks.receive().value()) {
            begun = std::max(begun, tick->user_header().slot);
            ends_ns = tick->user_header().sent_ns + tick->payload().period_ns;
        }
        for (auto commit = commits.receive().value(); commit.has_value(); commit = commits.receive().value()) {
            if ((commit->user_header().flags & FLAG_END) != 0) {
                return 0;
            }
        }
        if (field.has_value() && !is_started) { // slot 0, or the last flights before a restart
            is_started = true;
            const auto& start_m = field->user_header().limits.start_m;
            if (saved.reports.empty()) {
                saved.save(0, report_at({ start_m[0], start_m[1], start_m[2] }));
            }
            for (const auto& [slot, report] : saved.reports) {
                send_report(slot, report);
            }
        }
        while (is_started && saved.reports.rbegin()->first < field->user_header().limits.slots) {
            const auto& [last, before] = *saved.reports.rbegin();
            const uint64_t slot = last + 1;
            received.erase(received.begin(), received.lower_bound(slot));
            const auto plan = received.find(slot);
            const bool is_there = plan != received.end();
            if (has_pace ? begun < slot : !is_there) {
                break; // its beginning, or its plan, is still to come
            }
            const std::array<double, 3> at_m { before.x_m, before.y_m, before.z_m };
            const Order order { slot, field->user_header().limits, field->payload(), at_m, at_m, ends_ns };
            const auto report = fly_slot(vehicle, order, is_there ? &plan->second : nullptr, before);
            if (!is_possible(report, order.limits)) {
                std::cerr << "vehicle: slot " << slot << ": position = (" << report.x_m << ", " << report.y_m << ", "
                          << report.z_m << "): expected finite numbers, and at most 100 km from the area\n";
                return REFUSED;
            }
            saved.save(slot, report); // before it is sent: no slot is flown twice
            send_report(slot, report);
        }
        const auto wake = [](auto) { return CallbackProgression::Continue; };
        ran = waitset.wait_and_process_once_with_timeout(wake, bb::Duration::from_millis(100)).value();
        if (now_ns() - connected_ns >= 100'000'000) { // a restarted reader gets the last flights
            connected_ns = now_ns();
            flights.update_connections().value();
            flown.notify().value();
        }
    }
    return 0;
}

} // namespace skysink
