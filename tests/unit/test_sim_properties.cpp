// SPDX-License-Identifier: Apache-2.0
//
// What holds for any workload: random ones, governed in virtual time. A failure prints the seed.
#include <algorithm>
#include <random>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/simulated_chains.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using config::Policy;

namespace {

class Random {
  public:
    explicit Random(unsigned seed) : engine_(seed) {}
    int from(int least, int most) { return std::uniform_int_distribution(least, most)(engine_); }
    nanoseconds ms(int least, int most) {
        return std::chrono::microseconds(from(least * 1000, most * 1000));
    }
    double share() { return from(5, 100) / 100.0; }

  private:
    std::mt19937 engine_;
};

std::vector<SimulatedChain> random_chains(Random& random) {
    std::vector<SimulatedChain> chains(static_cast<std::size_t>(random.from(2, 8)));
    for (SimulatedChain& chain : chains) {
        chain.period = random.ms(40, 200);
        chain.deadline = random.ms(30, 150);
        chain.phase = random.ms(0, 100);
        chain.criticality = random.from(1, 3);
        for (int i = random.from(1, 3); i > 0; --i)
            chain.tasks.push_back({random.ms(0, 8), random.ms(1, 12),
                                   random.ms(1, 1) / random.from(1, 20), random.share()});
    }
    return chains;
}

constexpr Policy kPolicies[] = {Policy::kFeasible, Policy::kUrgency, Policy::kEdf, Policy::kSjf,
                                Policy::kHrrn,     Policy::kStatic,  Policy::kFifo};

/// Random chains, alone and with one more made of the first of them: none of them ends fewer
/// instances, nor is held longer in one than that allows.
template <typename MakeExtra>
void check_little_delay(nanoseconds longest, MakeExtra make_extra) {
    for (unsigned seed = 1; seed <= 40; ++seed) {
        Random random(seed);
        std::vector<SimulatedChain> chains = random_chains(random);
        SimulatedSettings settings;
        settings.duration = 1s;
        settings.scheduler.policy = kPolicies[seed % std::size(kPolicies)];
        const auto without = simulate(chains, settings);
        chains.push_back(make_extra(chains.front()));
        const auto with = simulate(chains, settings);
        for (std::size_t i = 0; i + 1 < chains.size(); ++i) {
            INFO("seed " << seed << ", chain " << i);
            CHECK(with[i].instances >= without[i].instances - 1);
            CHECK(with[i].longest_hold <= without[i].longest_hold + longest);
        }
    }
}

}  // namespace

TEST_CASE("A blocker whose GPU work never ends delays others by little", "[unit][sim][property]") {
    // It is waited for until it is overdue, once for each of its launches at most.
    // At one seed of 40 a chain waits 32 ms longer, as what is late has another turn.
    check_little_delay(35ms, [](SimulatedChain dead) {
        dead.deadline = 25ms;  // as urgent as any
        dead.is_dead = true;
        return dead;
    });
}

TEST_CASE("A chain without GPU work holds up nobody", "[unit][sim][property]") {
    // But plans are made anew when it comes and goes, and a launch may sleep for 2 ms: at one seed
    // of 40 that is another order.
    check_little_delay(3ms, [](const SimulatedChain&) {
        SimulatedChain cpu_only;
        cpu_only.period = 20ms;
        cpu_only.deadline = 25ms;
        cpu_only.tasks = {{15ms, 0ns}};
        cpu_only.criticality = 1000;
        return cpu_only;
    });
}

namespace {

/// Chains that need 1.17 times the GPU.
std::vector<SimulatedChain> overload() {
    std::vector<SimulatedChain> chains;
    for (int i = 0; i < 7; ++i) {
        SimulatedChain chain;
        chain.period = 120ms;
        chain.deadline = i % 2 == 0 ? 60ms : 100ms;
        chain.phase = i * 13ms;
        chain.tasks = {{3ms, 10ms}, {3ms, 10ms}};
        chain.on_late = config::OnLate::kExit;
        chains.push_back(chain);
    }
    return chains;
}

}  // namespace

TEST_CASE("Under overload a more critical chain misses little, and the others pay little more",
          "[unit][sim][property]") {
    const auto equal = simulate(overload(), {});
    REQUIRE(mean_miss_ratio(equal) > 0.2);
    for (std::size_t i = 0; i < equal.size(); ++i) {
        std::vector<SimulatedChain> chains = overload();
        chains[i].criticality = 2;
        const auto raised = simulate(chains, {});
        INFO("chain " << i);
        CHECK(raised[i].miss_ratio() <= std::min(0.3, equal[i].miss_ratio() + 0.1));
        CHECK(mean_miss_ratio(raised) < mean_miss_ratio(equal) + 0.15);
    }
}

TEST_CASE("Under overload by equal chains giving up some is as good as the order of deadlines",
          "[unit][sim][property]") {
    // And a third fewer are missed than by least laxity. (By chains that differ giving up beats
    // them all: test_sim_chains.cpp.)
    double feasible = 0, urgency = 0, edf = 0;
    for (const int apart : {5, 9, 13, 17, 23, 31}) {
        std::vector<SimulatedChain> chains = overload();
        for (std::size_t i = 0; i < chains.size(); ++i)
            chains[i].phase = static_cast<int>(i) * apart * 1ms;
        const auto misses = [&](Policy policy) {
            SimulatedSettings settings;
            settings.scheduler.policy = policy;
            return mean_miss_ratio(simulate(chains, settings)) / 6;
        };
        feasible += misses(Policy::kFeasible);
        urgency += misses(Policy::kUrgency);
        edf += misses(Policy::kEdf);
    }
    CHECK(feasible < edf + 0.05);
    CHECK(feasible < 0.75 * urgency);
}

TEST_CASE("A chain that demotes its late instances leaves the GPU to the others",
          "[unit][sim][property]") {
    std::vector<SimulatedChain> chains(2);
    chains[0] = {100ms, 25ms, 0ms, {{0ms, 60ms}}};  // cannot be met
    chains[1] = {100ms, 50ms, 10ms, {{0ms, 30ms}}};
    SimulatedSettings settings;
    settings.scheduler.policy = Policy::kFifo;  // by which late ones go on as before
    CHECK(simulate(chains, settings)[1].miss_ratio() == 1);
    chains[0].on_late = config::OnLate::kDemote;
    CHECK(simulate(chains, settings)[1].missed == 0);
}
