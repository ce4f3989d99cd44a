// SPDX-License-Identifier: Apache-2.0
//
// A run of a workload in virtual time: chains' threads (chain_model.h) on the models of CPU and
// GPU, with a subject that decides. Deterministic by seed, which also gives the arrivals and CPU
// segments of a run of urgengo-chains with the same seed.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "tools/chains/report.h"
#include "tools/chains/scenario.h"
#include "tools/chains/workload.h"
#include "tools/sim/bystander_model.h"
#include "tools/sim/chain_model.h"
#include "tools/sim/cpu_model.h"
#include "tools/sim/gpu_model.h"
#include "tools/sim/parking_calls.h"
#include "tools/sim/stall_model.h"
#include "tools/sim/subject.h"

namespace urgengo::sim {

struct WorldSettings {
    chains::Scenario scenario{};
    double seconds = 10;  ///< that frames arrive for
    double warmup = 0;    ///< of those: what arrives before does not count
    std::uint32_t seed = 1;
    GpuShape gpu{};
    CpuShape cpu{};
    /// Of the chains, in their order; of the last ones none need be given.
    std::vector<ChainTraits> traits{};
    /// By chain; empty: as urgengo-chains plans them.
    std::vector<std::vector<chains::PlannedFrame>> frames{};
    BystanderSettings bystander{};
    nanoseconds parking_every{0};  ///< of parking calls (parking_calls.h); 0: there are none
    StallSettings stalls{};
    int connections = 0;  ///< instead of the subject's; 0: those
    /// Called now and then with how much of `seconds` has passed. @returns whether to go on
    std::function<bool(double)> progress = [](double) { return true; };
};

class World final : public ChainSurroundings, public MarkPort, public GatePort {
  public:
    /// @param workload, subject  outlive it
    World(const chains::Workload& workload, Subject& subject, const WorldSettings& settings);

    /// Until all frames that arrive have ended, or it is told to stop.
    /// @returns as urgengo-chains has it; program, date and parameters are the caller's
    chains::RunReport run();

    // For the chains' threads:
    void compute(int thread, nanoseconds work) override { cpu_.compute(thread, work); }
    void compute_launch(int thread, nanoseconds work) override { cpu_.launch(thread, work); }
    void wake_at(int thread, nanoseconds when, bool is_late) override;
    void launch(int thread, int branch, const KernelWork& work) override;
    void join(int thread, int branch, int other) override;
    bool wait(int thread) override;
    void wait_for_mark(int thread, std::int64_t tag) override;
    bool take(int thread, int lock) override;
    void release(int lock) override;
    // For the subject:
    void mark(int chain, int branch, nanoseconds time, std::int64_t tag) override;
    void gate(int chain, int branch, int word, std::uint32_t number, nanoseconds time) override;
    void open(int word, std::uint32_t number, nanoseconds late) override;
    void wake_subject(nanoseconds when, int what, bool is_late) override;
    int num_connections() const override { return settings_.gpu.num_connections; }
    const GpuShape& gpu_shape() const override { return settings_.gpu; }

  private:
    /// Of the program, and who waits for it, the longest waiting first.
    struct Lock {
        bool is_taken = false;
        std::deque<int> waiting{};
    };
    void add_chain(const chains::Chain& chain);
    void add_branches();
    int stream(int thread, int branch) const;
    int thread_of(int stream) const { return threads_[static_cast<std::size_t>(stream)]; }
    const ChainTraits& traits(int thread) const;
    void go_on(int thread);
    chains::RunReport report() const;
    nanoseconds next() const;
    void run_threads();
    void mark_ended(const EndedKernel& mark);
    bool has_waited_for(const EndedKernel& ended);

    const chains::Workload& workload_;
    Subject& subject_;
    WorldSettings settings_;
    GpuModel gpu_;
    CpuModel cpu_;
    EventQueue sleepers_;
    EventQueue calls_;  ///< of the subject
    std::vector<std::unique_ptr<ChainModel>> chains_;
    std::unique_ptr<BystanderModel> bystander_;
    std::unique_ptr<ParkingCalls> parking_;
    StallModel stalls_;
    std::map<int, Lock> locks_;
    std::vector<int> threads_;                  ///< by stream; the first of each has its number
    std::vector<std::vector<int>> branches_;    ///< by chain: its other streams
    std::vector<bool> waits_;                   ///< by thread: spins for its stream,
    std::vector<std::int64_t> waits_for_mark_;  ///< or for this mark; 0: for none
    std::vector<int> waited_;                   ///< threads whose wait is over
    std::vector<int> seeing_;                   ///< and whose mark has ended
    nanoseconds now_{0};
};

}  // namespace urgengo::sim
