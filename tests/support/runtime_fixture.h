// SPDX-License-Identifier: Apache-2.0
//
// The runtime in virtual time, against a driver that executes marks when the test says so: two
// chains, two threads.
#pragma once

#include <sys/prctl.h>

#include <cstring>
#include <memory>
#include <string>

#include "host/runtime/as_planned.h"
#include "host/runtime/runtime.h"
#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"

namespace urgengo::testing {

using namespace std::chrono_literals;
using runtime::Grant;
using runtime::Launch;
using runtime::Runtime;
using runtime::ThreadState;

inline const CUfunction kConv = reinterpret_cast<CUfunction>(0x10);
inline const CUstream kStreamA = reinterpret_cast<CUstream>(0xa0);
inline const CUstream kStreamB = reinterpret_cast<CUstream>(0xb0);

inline config::TaskProfile profile_of(const std::string& name, int kernels,
                                      std::chrono::nanoseconds each, double utilization) {
    config::TaskProfile p;
    p.name = name;
    p.cpu_time = 1ms;
    p.kernels.assign(static_cast<std::size_t>(kernels), {"conv", 100, 256, each, utilization});
    return p;
}

// Two chains: `tight` (20 ms) and `loose` (100 ms), each with one task of 20 kernels of 100 us.
struct RuntimeFixture {
    FakeDriver driver;
    HookedClock clock;
    config::ResolvedConfig resolved;
    ThreadState thread_a, thread_b;
    std::unique_ptr<Runtime> runtime;
    bool may_skip = true;  ///< launches go unasked where they may

    explicit RuntimeFixture(double utilization = 1.0) {
        driver.names[kConv] = "conv";
        config::Profile profile;
        for (auto [name, deadline] : {std::pair{"tight", 20ms}, std::pair{"loose", 100ms}}) {
            config::Chain chain;
            chain.name = name;
            chain.period = 200ms;
            chain.deadline = deadline;
            chain.tasks = {{"detect", std::string("th_") + name}};
            resolved.config.chains.push_back(chain);
            profile.chains.push_back({name, {profile_of("detect", 20, 100us, utilization)}});
        }
        resolved.profile = profile;
        resolved.config.scheduler.progress.mark_every = 200us;  // two kernels
        resolved.config.scheduler.run_ahead.alone = 0us;        // as among others
    }

    Runtime& rt() {
        if (!runtime) runtime = std::make_unique<Runtime>(resolved, driver.api, clock);
        return *runtime;
    }
    /// @param age  how long ago its frame has arrived
    void begin(ThreadState& thread, const char* chain, std::chrono::nanoseconds age = {}) {
        const auto instance = rt().frames().arrival(nullptr, chain, clock.now() - age);
        REQUIRE(instance != 0);
        REQUIRE_FALSE(rt().frames().task_begin(thread, instance, "detect"));
    }
    Grant launch(ThreadState& thread, CUstream stream = kStreamA) {
        const Launch l{kConv, 100, 256, stream};
        const Grant g = rt().launches().before(thread, l);
        if (g.task) rt().launches().after(thread, l, g, true);
        return g;
    }
    /// As the interposer does it.
    /// @returns whether it was not asked about
    bool launch_as_interposed(ThreadState& thread, const Launch& launch) {
        if (may_skip && rt().planned().goes(thread, launch)) {
            runtime::went_as_planned(thread.line);
            return true;
        }
        const Grant grant = rt().launches().before(thread, launch);
        if (grant.task) rt().launches().after(thread, launch, grant, true);
        return false;
    }
    /// The profile says that each chain is one segment, which a stream's wait closes.
    void close_segments() {
        for (auto& chain : resolved.profile->chains)
            chain.tasks[0].segments = {{1ms, 20, 20, 20, "stream"}};
    }
    /// Thread a begins to wait for its stream.
    void wait_a() { begin_wait(thread_a, kStreamA); }
    runtime::Wait begin_wait(ThreadState& thread, CUstream stream,
                             abi::TraceWait function = abi::TraceWait::kStream) {
        runtime::Wait wait;
        wait.function = function;
        wait.stream = stream;
        rt().waits().before(thread, wait);
        return wait;
    }
    /// A wait from begin to end.
    void wait(ThreadState& thread, CUstream stream,
              abi::TraceWait function = abi::TraceWait::kStream) {
        rt().waits().after(thread, begin_wait(thread, stream, function), true);
    }
    const observe::ChainStatistics& stats(int chain) { return *rt().report().statistics()[chain]; }
};

/// The calling thread has this name for as long as the object lives.
class ThreadName {
  public:
    explicit ThreadName(const char* name) {
        prctl(PR_GET_NAME, old_);
        prctl(PR_SET_NAME, name);
    }
    ~ThreadName() { prctl(PR_SET_NAME, old_); }
    ThreadName(const ThreadName&) = delete;
    ThreadName& operator=(const ThreadName&) = delete;

  private:
    char old_[16] = {};
};

}  // namespace urgengo::testing
