// SPDX-License-Identifier: Apache-2.0
//
// The own time of kernels: streams contend on a simulated GPU whose truth is known.
#include "tools/trace/kernel_times.h"

#include <cmath>
#include <deque>
#include <random>

#include "tests/support/catch.h"

namespace urgengo::trace {
namespace {

constexpr std::int64_t kUs = 1000;

/// A kernel that waits on its stream: not before `ready_ns`.
struct Work {
    std::int64_t ready_ns = 0;
    std::int64_t own_ns = 0;
    double utilization = 0.5;
};

/// Runs streams on one GPU: each in order, all at once, and while their kernels together want more
/// than the GPU all are slowed down alike.
class SharedGpu {
  public:
    explicit SharedGpu(const std::vector<std::vector<Work>>& streams) {
        intervals.resize(streams.size());
        for (const auto& stream : streams) {
            for (const Work& work : stream) {
                TraceRecord& record = records_.emplace_back();
                record.launch.utilization = static_cast<std::uint16_t>(work.utilization * 65535);
            }
        }
        run(streams);
    }

    std::vector<std::vector<GpuInterval>> intervals;  ///< shape [stream][kernel]

  private:
    void run(const std::vector<std::vector<Work>>& streams) {
        const std::size_t n = streams.size();
        std::vector<std::size_t> next(n, 0);
        std::vector<double> left(n, 0), begin(n, 0);
        std::vector<bool> runs(n, false);
        std::vector<std::size_t> first_record(n, 0);
        for (std::size_t s = 1; s < n; ++s) {
            first_record[s] = first_record[s - 1] + streams[s - 1].size();
        }
        double now = 0;
        for (;;) {
            double demand = 0, until = 1e18;
            bool any = false;
            for (std::size_t s = 0; s < n; ++s) {
                if (next[s] == streams[s].size()) continue;
                any = true;
                const Work& work = streams[s][next[s]];
                if (!runs[s] && static_cast<double>(work.ready_ns) <= now) {
                    runs[s] = true, left[s] = static_cast<double>(work.own_ns), begin[s] = now;
                }
                if (runs[s]) demand += work.utilization;
            }
            if (!any) return;
            const double rate = demand > 1 ? 1 / demand : 1;
            for (std::size_t s = 0; s < n; ++s) {
                if (next[s] == streams[s].size()) continue;
                const double at = runs[s] ? now + left[s] / rate
                                          : static_cast<double>(streams[s][next[s]].ready_ns);
                until = std::min(until, at);
            }
            for (std::size_t s = 0; s < n; ++s) {
                if (!runs[s]) continue;
                left[s] -= (until - now) * rate;
                if (left[s] > 1e-3) continue;
                const TraceRecord* record = &records_[first_record[s] + next[s]];
                intervals[s].push_back({record, true, std::llround(begin[s]), std::llround(until)});
                runs[s] = false;
                ++next[s];
            }
            now = until;
        }
    }

    std::deque<TraceRecord> records_;
};

std::vector<KernelSample> samples_of(const SharedGpu& gpu, std::size_t stream) {
    const Contention contention(gpu.intervals);
    std::vector<KernelSample> samples;
    for (const GpuInterval& interval : gpu.intervals[stream]) {
        samples.push_back({interval.length_ns(), contention.of(stream, interval), false});
    }
    return samples;
}

/// Every `period`, a kernel with some noise, beside other streams' kernels at random times.
struct Mix {
    std::int64_t own_ns = 400 * kUs;
    double utilization = 0.8;
    std::int64_t period_ns = 1000 * kUs;
    double load = 0.4;  ///< of each of two others

    std::vector<std::vector<Work>> streams(std::uint32_t seed) const {
        std::mt19937 random(seed);
        std::normal_distribution<double> noise(1, 0.01);
        std::vector<std::vector<Work>> all(3);
        constexpr int kCount = 200;
        for (int i = 0; i < kCount; ++i) {
            all[0].push_back(
                {i * period_ns,
                 static_cast<std::int64_t>(static_cast<double>(own_ns) * noise(random)),
                 utilization});
        }
        for (std::size_t s = 1; s < 3; ++s) {
            std::exponential_distribution<double> pause(1);
            double at = 0;
            while (at < static_cast<double>(kCount * period_ns)) {
                const double length = 300e3 * (0.5 + pause(random));
                all[s].push_back(
                    {static_cast<std::int64_t>(at), static_cast<std::int64_t>(length), 0.7});
                at += length / std::max(load, 1e-3) * (0.2 + 0.8 * pause(random));
            }
        }
        return all;
    }
};

TEST_CASE("Contention is others' utilisation over the time on the GPU", "[unit][trace]") {
    TraceRecord half{}, full{};
    half.launch.utilization = 32768;
    full.launch.utilization = 65535;
    const auto on_gpu = [](const TraceRecord& record, std::int64_t begin, std::int64_t end) {
        return GpuInterval{&record, true, begin, end};
    };
    const std::vector<std::vector<GpuInterval>> intervals = {
        {on_gpu(full, 100, 200), on_gpu(full, 150, 250), on_gpu(full, 1000, 1100)},
        {on_gpu(half, 0, 120), on_gpu(half, 190, 300), {&full, false}},
    };
    const Contention contention(intervals);
    CHECK(contention.of(0, intervals[0][0]) == Approx(0.15).margin(1e-4));  // not its own 50 ns
    CHECK(contention.of(0, intervals[0][1]) == Approx(0.30).margin(1e-4));
    CHECK(contention.of(0, intervals[0][2]) == Approx(0).margin(1e-9));
    CHECK(contention.of(1, intervals[1][0]) == Approx(20.0 / 120).margin(1e-4));
}

TEST_CASE("Own time is within a few percent when some launches ran alone", "[unit][trace]") {
    for (const std::uint32_t seed : {1u, 2u, 3u, 4u, 5u}) {
        for (const double load : {0.0, 0.1, 0.2, 0.3}) {
            Mix mix;
            mix.load = load;
            const auto samples = samples_of(SharedGpu(mix.streams(seed)), 0);
            const OwnTime own = own_time(samples);
            CAPTURE(seed, load, own.clean);
            REQUIRE(own.clean >= kMinCleanSamples);
            CHECK(own.samples == own.clean);
            CHECK(static_cast<double>(own.ns) == Approx(400e3).epsilon(0.03));
        }
    }
}

TEST_CASE("Own time is the plain median's only where nobody contends", "[unit][trace]") {
    // What the estimator is for: the median of all launches is far off.
    Mix mix;
    mix.load = 0.3;
    auto samples = samples_of(SharedGpu(mix.streams(1)), 0);
    const std::int64_t ns = own_time(samples).ns;
    std::sort(samples.begin(), samples.end(),
              [](const auto& a, const auto& b) { return a.length_ns < b.length_ns; });
    CHECK(static_cast<double>(samples[samples.size() / 2].length_ns) > 1.2 * 400e3);
    CHECK(static_cast<double>(ns) < 1.03 * 400e3);
}

TEST_CASE("Own time is never too short when no launch ran alone", "[unit][trace]") {
    for (const std::uint32_t seed : {1u, 2u, 3u, 4u, 5u}) {
        Mix mix;
        mix.load = 0.1;
        auto streams = mix.streams(seed);
        // One more that never pauses.
        streams.push_back({});
        for (int i = 0; i < 2000; ++i) streams[3].push_back({0, 250 * kUs, 0.3});
        const OwnTime own = own_time(samples_of(SharedGpu(streams), 0));
        CAPTURE(seed, own.ns);
        CHECK(own.clean < kMinCleanSamples);
        CHECK(static_cast<double>(own.ns) > 0.97 * 400e3);
        // Its share of the truth: 0.8 beside 0.3 is at most 1.1 times the GPU.
        CHECK(static_cast<double>(own.ns) < 1.15 * 400e3);
    }
}

TEST_CASE("Own time prefers launches with marks of their own", "[unit][trace]") {
    std::vector<KernelSample> samples(10, {500, 0, true});
    CHECK(own_time(samples).ns == 500);
    samples.insert(samples.end(), 3, {100, 0, false});
    CHECK(own_time(samples).ns == 100);
    CHECK(own_time(samples).samples == 3);
}

TEST_CASE("Own time of few launches is of what there is", "[unit][trace]") {
    CHECK(own_time({}).samples == 0);
    CHECK(own_time({{100, 0, false}}).ns == 100);
    const OwnTime own = own_time({{100, 0, false}, {200, 0.5, false}, {900, 0.9, false}});
    CHECK(own.ns == 200);
    CHECK(own.samples == 3);
    CHECK(own.clean == 1);
}

}  // namespace
}  // namespace urgengo::trace
