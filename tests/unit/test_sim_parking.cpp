// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for all GPU work, in virtual time: no gate is closed while one is under way.
#include <string>
#include <utility>
#include <vector>

#include "host/config/task_count.h"
#include "tests/support/catch.h"
#include "tests/support/gate_ways.h"
#include "tools/chains/spec.h"
#include "tools/sim/governed_subject.h"
#include "tools/sim/profiled.h"
#include "tools/sim/workloads.h"
#include "tools/sim/world.h"

using namespace urgengo;
using namespace urgengo::sim;
using namespace std::chrono_literals;
using config::DeviceDispatch;
using config::Dispatch;
using testing::GateWay;
using testing::kGateWays;
using testing::scheduler_of;

namespace {

constexpr GateWay kThread{"thread", Dispatch::kThread};

config::Config config_of(const GateWay& way, const chains::Workload& workload,
                         const WorldSettings& settings) {
    return configured(workload, settings.scenario, scheduler_of(way));
}

/// Sees what a subject does with gates, as streams see it.
class Watched final : public GovernedSubject, GatePort {
  public:
    Watched(const config::Config& config, const config::Profile& profile)
        : GovernedSubject(config, profile), words_(config::num_tasks(config.chains)) {}

    int parks = 0;
    int closed_while_parked = 0;       ///< gates
    int left_closed = 0;               ///< as a park began, or ended
    int parks_with_gates_between = 0;  ///< since the one before
    nanoseconds longest{0};

    void connect_gates(GatePort& port) override {
        port_ = &port;
        GovernedSubject::connect_gates(*this);
    }
    void park_begins(nanoseconds now) override {
        ++parks;
        parks_with_gates_between += std::exchange(closed_since_, 0) > 0;
        GovernedSubject::park_begins(now);
        begin_ = now;
        is_parked_ = true;
        left_closed += num_closed();
    }
    void park_ends(nanoseconds now) override {
        left_closed += num_closed();
        is_parked_ = false;
        longest = std::max(longest, now - begin_);
        GovernedSubject::park_ends(now);
    }

    void gate(int chain, int branch, int word, std::uint32_t number, nanoseconds time) override {
        if (is_gate(word)) {
            words_[static_cast<std::size_t>(word)].closed = number;
            ++closed_since_;
            closed_while_parked += is_parked_;
        }
        port_->gate(chain, branch, word, number, time);
    }
    void open(int word, std::uint32_t number, nanoseconds late) override {
        if (is_gate(word)) words_[static_cast<std::size_t>(word)].opened = number;
        port_->open(word, number, late);
    }
    void wake_subject(nanoseconds when, int what, bool is_late) override {
        port_->wake_subject(when, what, is_late);
    }
    int num_connections() const override { return GovernedSubject::num_connections(); }

  private:
    struct Word {
        std::uint32_t closed = 0, opened = 0;
    };
    /// Else it is what a mark that ranks lets go of.
    bool is_gate(int word) const { return static_cast<std::size_t>(word) < words_.size(); }
    int num_closed() const {
        int closed = 0;
        for (const Word& word : words_) closed += word.closed != word.opened;
        return closed;
    }

    std::vector<Word> words_;
    GatePort* port_ = nullptr;
    bool is_parked_ = false;
    nanoseconds begin_{0};
    int closed_since_ = 0;
};

WorldSettings parking_every(nanoseconds every) {
    WorldSettings settings;
    settings.seconds = 4;
    settings.scenario.f_a = 0.9;
    settings.scenario.tight = chains::tight_chains(0.4);
    settings.parking_every = every;
    return settings;
}

struct Found {
    chains::RunReport report;
    std::size_t ended = 0, frames = 0;

    explicit Found(chains::RunReport its) : report(std::move(its)) {
        for (const chains::ChainReport& chain : report.chains)
            for (const chains::InstanceRecord& record : chain.records)
                ended += record.outcome != chains::Outcome::kNotRun, ++frames;
    }
    double miss_pct() const { return 100 * report.overall_miss_ratio(); }
};

}  // namespace

TEST_CASE("While a call waits for all GPU work every gate is open, and afterwards some close again",
          "[unit][sim]") {
    const chains::Workload workload = h200_ten_chains();
    const WorldSettings settings = parking_every(50ms);
    Watched by_thread(config_of(kThread, workload, settings), profiled(workload));
    const Found thread(World(workload, by_thread, settings).run());
    const double bare = 100 * World(workload, *make_bare(), settings).run().overall_miss_ratio();
    for (const GateWay& way : kGateWays) {
        INFO(way.name);
        Watched subject(config_of(way, workload, settings), profiled(workload));
        const Found found(World(workload, subject, settings).run());
        CHECK(subject.left_closed == 0);
        CHECK(subject.closed_while_parked == 0);
        CHECK(subject.parks >= 50);
        CHECK(subject.parks_with_gates_between > subject.parks / 2);
        // A call takes what is on the GPU and behind gates as it begins, and that is bounded.
        CHECK(subject.longest < 50ms);
        const GateCounts counts = *subject.gate_counts();
        CHECK(counts.parks == static_cast<std::uint64_t>(subject.parks));
        CHECK(counts.longest_park == subject.longest);
        CHECK(counts.opened_by_parks > 50);
        CHECK(counts.held_by_parks > 50);
        CHECK(counts.closed > 1'000);
        CHECK(found.ended == found.frames);
        INFO(found.miss_pct() << " %, threads " << thread.miss_pct() << ", bare " << bare);
        // Marks that rank keep their streams, and cost some misses without any call, too.
        if (way.device != DeviceDispatch::kPiggyback)
            CHECK(found.miss_pct() < thread.miss_pct() + 4);
        CHECK(found.miss_pct() < bare / 3);
    }
}

TEST_CASE("Calls that wait for all GPU work change nothing where no gate is closed",
          "[unit][sim]") {
    const chains::Workload workload = h200_ten_chains();
    std::vector<double> misses;
    for (const nanoseconds every : {0ms, 20ms}) {
        const WorldSettings settings = parking_every(every);
        Watched subject(config_of(kThread, workload, settings), profiled(workload));
        misses.push_back(World(workload, subject, settings).run().overall_miss_ratio());
        CHECK((subject.parks > 0) == (every > 0ms));
    }
    CHECK(misses[0] == misses[1]);
}

TEST_CASE("A call that waits for all GPU work takes as long as that work", "[unit][sim]") {
    // One chain's kernel of 2 ms; calls begin on an idle GPU, and half-way through.
    chains::Workload workload = h200_ten_chains();
    workload.chains.resize(1);
    chains::Task& task = workload.chains[0].tasks[0];
    workload.chains[0].tasks.resize(1);
    task.kernels.resize(1);
    task.kernels[0].grid = workload.num_sms;
    task.kernels[0].est_us = 2000;
    task.isolated_ms = 2;
    WorldSettings settings = parking_every(10ms);
    settings.seconds = 0.1;
    settings.frames = {{{.arrival = 19ms, .cpu = {0ns}, .size = {1}}}};
    Watched subject(config_of(kGateWays[0], workload, settings), profiled(workload));
    World(workload, subject, settings).run();
    CHECK(subject.parks == 9);
    CHECK(subject.longest > 900us);
    CHECK(subject.longest < 1200us);
    const GateCounts counts = *subject.gate_counts();
    CHECK(counts.parked < subject.longest + 8 * 10us);
}
