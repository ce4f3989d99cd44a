// SPDX-License-Identifier: Apache-2.0
//
// What holds for any instances: random ones. A failure prints the seed. (Of workloads in virtual
// time: test_sim_properties.cpp.)
#include <algorithm>
#include <random>
#include <vector>

#include "host/sched/policies/feasible.h"
#include "tests/support/catch.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using model::SlotView;
using std::chrono::nanoseconds;

namespace {

class Random {
  public:
    explicit Random(unsigned seed) : engine_(seed) {}
    int from(int least, int most) { return std::uniform_int_distribution(least, most)(engine_); }
    nanoseconds ms(int least, int most) {
        return std::chrono::microseconds(from(least * 1000, most * 1000));
    }
    bool one_in(int n) { return from(1, n) == 1; }

  private:
    std::mt19937 engine_;
};

/// An instance of what may be anything, of the slot `index`.
SlotView any_view(Random& random, int index) {
    SlotView v = job(index, random.ms(1, 150), random.ms(0, 30), random.ms(20, 500));
    v.later.gpu = random.one_in(2) ? nanoseconds{0} : v.remaining.gpu / random.from(1, 4);
    v.later.cpu = random.ms(0, 10);
    v.release = random.one_in(2) ? nanoseconds{0} : random.ms(0, 30);
    v.remaining.cpu = v.later.cpu + v.release;
    v.laxity = v.deadline - v.remaining.gpu - v.remaining.cpu;
    v.chain.criticality = random.from(1, 3);
    return v;
}

constexpr nanoseconds kShareSlack{5ms};

}  // namespace

TEST_CASE("Less critical instances never have a more critical one given up", "[sched][property]") {
    for (unsigned seed = 1; seed <= 3000; ++seed) {
        Random random(seed);
        std::vector<SlotView> all;
        for (int i = random.from(1, 12); i > 0; --i) all.push_back(any_view(random, i));
        const sched::TaskSet given_up = sched::make_plan(0ns, all, 0, kShareSlack).given_up;
        for (int least = 2; least <= 3; ++least) {
            std::vector<SlotView> critical;
            sched::TaskSet slots;
            for (const SlotView& v : all) {
                if (v.chain.criticality < least) continue;
                critical.push_back(v);
                slots.insert(v.task);
            }
            INFO("seed " << seed << ", criticality " << least);
            CHECK((given_up & slots) == sched::make_plan(0ns, critical, 0, kShareSlack).given_up);
        }
    }
}

TEST_CASE("What is kept can be met when it is served in its order", "[sched][property]") {
    for (unsigned seed = 1; seed <= 3000; ++seed) {
        Random random(seed);
        std::vector<SlotView> all;
        for (int i = random.from(1, 12); i > 0; --i) all.push_back(any_view(random, i));
        const sched::TaskSet given_up = sched::make_plan(0ns, all, 0, kShareSlack).given_up;
        std::vector<SlotView> kept;
        for (const SlotView& v : all)
            if (v.laxity.count() >= 0 && !given_up.contains(v.task)) kept.push_back(v);
        INFO("seed " << seed);
        CHECK(sched::make_plan(0ns, kept, 0, kShareSlack).given_up.is_empty());
    }
}

TEST_CASE("Who may share when all are in time may share when only those before it are",
          "[sched][property]") {
    for (unsigned seed = 1; seed <= 3000; ++seed) {
        Random random(seed);
        std::vector<SlotView> all;
        for (int i = random.from(1, 12); i > 0; --i) all.push_back(any_view(random, i));
        const nanoseconds spare = random.ms(0, 20);
        const sched::Plan plan = sched::make_plan(0ns, all, 0, spare);
        INFO("seed " << seed);
        CHECK((plan.may_share & plan.given_up).is_empty());
        for (const SlotView& v : all) {
            const bool is_kept = v.laxity.count() >= 0 && v.remaining.gpu.count() > 0 &&
                                 !plan.given_up.contains(v.task);
            if (is_kept && plan.slack >= spare) CHECK(plan.may_share.contains(v.task));
            if (v.laxity.count() >= 0 && !is_kept) CHECK_FALSE(plan.may_share.contains(v.task));
        }
    }
}
