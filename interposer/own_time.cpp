// SPDX-License-Identifier: Apache-2.0
#include "interposer/own_time.h"

#ifdef URGENGO_MEASURE_OWN_TIME
#include <chrono>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <vector>

#include "host/base/atomic_file.h"

namespace urgengo::own_time {
namespace {

constexpr std::array<const char*, kNumClasses> kNames = {"launch", "copy",   "sync",
                                                         "event",  "memory", "other"};

std::mutex g_mutex;
std::vector<Recorder*> g_recorders;  // never freed: threads may call until the process is gone
thread_local Recorder* t_recorder __attribute__((tls_model("initial-exec"))) = nullptr;

std::uint64_t less(std::uint64_t from, std::uint64_t what) {
    return from > what ? from - what : 0;
}

/// With its bins, so that runs can be merged (urgengo bench latency --merge).
nlohmann::ordered_json times_json(const Histogram& times, double unit) {
    std::vector<double> middles;
    std::vector<std::uint64_t> counts;
    times.each_bin([&](double middle, std::uint64_t count) {
        middles.push_back(middle * unit);
        counts.push_back(count);
    });
    return {{"count", times.count()},
            {"mean", times.mean() * unit},
            {"p50", times.percentile(0.5) * unit},
            {"p90", times.percentile(0.9) * unit},
            {"p99", times.percentile(0.99) * unit},
            {"p99.99", times.percentile(0.9999) * unit},
            {"max", static_cast<double>(times.max()) * unit},
            {"bin_middles", std::move(middles)},
            {"bin_counts", std::move(counts)}};
}

}  // namespace

std::uint64_t Recorder::read_ticks() {
    static const std::uint64_t least = [] {
        std::uint64_t shortest = UINT64_MAX;
        for (int i = 0; i < 1000; ++i) {
            const std::uint64_t begin = ticks();
            shortest = std::min(shortest, ticks() - begin);
        }
        return shortest;
    }();
    return least;
}

void Recorder::add(interposer::CallClass call, const Spent& spent, std::uint64_t ticks) {
    const std::uint64_t read = read_ticks();
    const std::uint64_t added =
        less(ticks, spent.in_driver + spent.held + read * (spent.reads + 1));
    CallTimes& times = times_.calls[static_cast<std::size_t>(call)];
    times.added.add(added);
    times.in_driver.add(spent.in_driver);
    if (spent.held) times.held.add(spent.held);
    frame_.added += added;
    frame_.launches += call == interposer::CallClass::kLaunch;
    frame_.spent.deciding += less(spent.deciding, read * spent.decisions);
    frame_.spent.in_our_driver += spent.in_our_driver;
    frame_.spent.held += spent.held;
    frame_.spent.polling += spent.polling;
    frame_.spent.decisions += spent.decisions;
}

void Recorder::add_frame(const Frame& frame, FrameTimes& frames) {
    if (!frame.arrived || frame.launches == 0) return;
    frames.added.add(frame.added);
    frames.deciding.add(frame.spent.deciding);
    frames.in_our_driver.add(frame.spent.in_our_driver);
    frames.held.add(frame.spent.held);
    frames.polling.add(frame.spent.polling);
    frames.launches.add(frame.launches);
    frames.decisions.add(frame.spent.decisions);
}

void Recorder::frame_begins() {
    add_frame(frame_, times_.frames);
    frame_ = {};
    frame_.arrived = true;
}

void Recorder::merge_into(Times& all) const {
    for (std::size_t i = 0; i < kNumClasses; ++i) {
        all.calls[i].added.merge(times_.calls[i].added);
        all.calls[i].held.merge(times_.calls[i].held);
        all.calls[i].in_driver.merge(times_.calls[i].in_driver);
    }
    for (const auto part :
         {&FrameTimes::added, &FrameTimes::deciding, &FrameTimes::in_our_driver, &FrameTimes::held,
          &FrameTimes::polling, &FrameTimes::launches, &FrameTimes::decisions})
        (all.frames.*part).merge(times_.frames.*part);
    add_frame(frame_, all.frames);
}

Recorder& recorder() {
    if (!t_recorder) {
        t_recorder = new Recorder;
        const std::lock_guard lock(g_mutex);
        g_recorders.push_back(t_recorder);
    }
    return *t_recorder;
}

std::string to_json(double ns_per_tick) {
    const auto all = std::make_unique<Times>();
    {
        const std::lock_guard lock(g_mutex);
        for (const Recorder* recorder : g_recorders) recorder->merge_into(*all);
    }
    const Histogram& launches = all->calls[0].added;
    nlohmann::ordered_json root = {
        {"launches", launches.count()},
        {"own_ns",
         {{"median", launches.percentile(0.5) * ns_per_tick},
          {"p90", launches.percentile(0.9) * ns_per_tick},
          {"p99", launches.percentile(0.99) * ns_per_tick},
          {"mean", launches.mean() * ns_per_tick}}},
        {"driver_ns", {{"mean", all->calls[0].in_driver.mean() * ns_per_tick}}},
        {"read_ns", static_cast<double>(Recorder::read_ticks()) * ns_per_tick}};
    for (std::size_t i = 0; i < kNumClasses; ++i)
        root["calls"][kNames[i]] = {
            {"added_ns", times_json(all->calls[i].added, ns_per_tick)},
            {"held_ns", times_json(all->calls[i].held, ns_per_tick)},
            {"driver_ns", times_json(all->calls[i].in_driver, ns_per_tick)}};
    const FrameTimes& frames = all->frames;
    root["instances"] = {{"count", frames.added.count()},
                         {"launches", times_json(frames.launches, 1)},
                         {"decisions", times_json(frames.decisions, 1)},
                         {"deciding_ns", times_json(frames.deciding, ns_per_tick)},
                         {"added_ns", times_json(frames.added, ns_per_tick)},
                         {"our_driver_ns", times_json(frames.in_our_driver, ns_per_tick)},
                         {"held_ns", times_json(frames.held, ns_per_tick)},
                         {"polling_ns", times_json(frames.polling, ns_per_tick)}};
    return root.dump(1) + "\n";
}

}  // namespace urgengo::own_time

namespace urgengo::interposer {
namespace {

const auto g_loaded = std::chrono::steady_clock::now();
const std::uint64_t g_loaded_ticks = own_time::ticks();

const exec::DriverApi* g_driver = nullptr;

template <auto Field, typename Function>
struct Measured;
template <auto Field, typename... Arguments>
struct Measured<Field, CUresult (*)(Arguments...)> {
    static CUresult call(Arguments... arguments) {
        const own_time::InOurDriver span;
        return (g_driver->*Field)(arguments...);
    }
};

}  // namespace

const exec::DriverApi& OwnTime::measured(const exec::DriverApi& driver) {
    static exec::DriverApi table;
    g_driver = &driver;
#define URGENGO_MEASURE(field, name, type) \
    if (driver.field) table.field = Measured<&exec::DriverApi::field, type>::call;
    URGENGO_DRIVER_API(URGENGO_MEASURE)
#undef URGENGO_MEASURE
    return table;
}

void OwnTime::write(const std::string& stats) {
    if (stats.empty()) return;
    const std::chrono::duration<double, std::nano> time =
        std::chrono::steady_clock::now() - g_loaded;
    const double ns_per_tick =
        time.count() / static_cast<double>(own_time::ticks() - g_loaded_ticks);
    (void)write_file_atomically(stats + ".own_time.json", own_time::to_json(ns_per_tick));
}

}  // namespace urgengo::interposer

#endif
