// SPDX-License-Identifier: Apache-2.0
//
// How long a launch is in our own hands, inside a real program, whose caches hold other things than
// a benchmark's. Built only with -DURGENGO_MEASURE_OWN_TIME=ON (x86-64); else there is nothing
// here. At exit the times go into the file of URGENGO_STATS with ".own_time.json" behind its name.
#pragma once

#ifdef URGENGO_MEASURE_OWN_TIME
#include <x86intrin.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <string>

#include "host/base/atomic_file.h"
#endif

namespace urgengo::interposer {

#ifdef URGENGO_MEASURE_OWN_TIME

class OwnTime {
  public:
    OwnTime() { t_in_driver = 0; }
    ~OwnTime() {
        const std::uint64_t ticks = __rdtsc() - begin_ - t_in_driver;
        bump(bins_[std::min<std::uint64_t>(ticks / kTicksPerBin, kBins - 1)], 1);
        bump(own_ticks_, ticks);
        bump(driver_ticks_, t_in_driver);
    }
    OwnTime(const OwnTime&) = delete;
    OwnTime& operator=(const OwnTime&) = delete;

    template <typename Call>
    static auto in_driver(Call&& call) {
        const std::uint64_t begin = __rdtsc();
        const auto result = call();
        t_in_driver += __rdtsc() - begin;
        return result;
    }

    static void write(const std::string& stats) {
        if (stats.empty()) return;
        const double ns_per_tick =
            std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - loaded_)
                .count() /
            static_cast<double>(__rdtsc() - loaded_ticks_);
        std::uint64_t launches = 0;
        for (const auto& bin : bins_) launches += bin;
        const auto at = [&](double share) {
            std::uint64_t below = 0;
            for (std::size_t i = 0; i < kBins; ++i)
                if ((below += bins_[i]) >= share * static_cast<double>(launches))
                    return (static_cast<double>(i) + 0.5) * kTicksPerBin * ns_per_tick;
            return 0.0;
        };
        const auto mean = [&](std::uint64_t ticks) {
            return static_cast<double>(ticks) * ns_per_tick /
                   static_cast<double>(std::max<std::uint64_t>(launches, 1));
        };
        const std::string json =
            "{\"launches\": " + std::to_string(launches) +
            ", \"own_ns\": {\"median\": " + std::to_string(at(0.5)) +
            ", \"p90\": " + std::to_string(at(0.9)) + ", \"p99\": " + std::to_string(at(0.99)) +
            ", \"mean\": " + std::to_string(mean(own_ticks_)) +
            "}, \"driver_ns\": {\"mean\": " + std::to_string(mean(driver_ticks_)) + "}}\n";
        (void)write_file_atomically(stats + ".own_time.json", json);
    }

  private:
    static constexpr std::size_t kBins = 4096;
    static constexpr std::uint64_t kTicksPerBin = 8;

    // One thread at a time launches in what is measured; two would lose a count now and then.
    static void bump(std::atomic<std::uint64_t>& count, std::uint64_t by) {
        count.store(count.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
    }

    inline static thread_local std::uint64_t t_in_driver = 0;
    inline static std::array<std::atomic<std::uint64_t>, kBins> bins_{};
    inline static std::atomic<std::uint64_t> own_ticks_{0}, driver_ticks_{0};
    inline static const std::uint64_t loaded_ticks_ = __rdtsc();
    inline static const auto loaded_ = std::chrono::steady_clock::now();

    const std::uint64_t begin_ = __rdtsc();
};

#else

class OwnTime {
  public:
    OwnTime() {}
    template <typename Call>
    static auto in_driver(Call&& call) {
        return call();
    }
    static void write(const auto&) {}
};

#endif

}  // namespace urgengo::interposer
