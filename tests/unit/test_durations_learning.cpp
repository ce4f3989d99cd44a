// SPDX-License-Identifier: Apache-2.0
//
// What durations become by learning, instance after instance (host/model/durations.h).
#include <random>
#include <vector>

#include "host/model/durations.h"
#include "host/model/pace.h"
#include "host/model/position.h"
#include "tests/support/catch.h"
#include "tests/support/virtual_stream.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::Durations;
using model::nanoseconds;
using testing::launch_instance;
using testing::VirtualInstance;
using testing::VirtualStream;

namespace {

constexpr nanoseconds kUnknown{20'000};

nanoseconds scaled(nanoseconds t, double factor) {
    return nanoseconds(static_cast<std::int64_t>(static_cast<double>(t.count()) * factor));
}

// A task with kernels of 5 to 100 us, or so, that runs instance after instance, and learns.
struct Learner {
    explicit Learner(std::uint32_t seed, std::size_t kernels = 60, double longest_ns = 100'000)
        : random(seed) {
        std::uniform_real_distribution<double> ns(5'000, longest_ns);
        for (std::size_t i = 0; i < kernels; ++i)
            truth.push_back(nanoseconds(static_cast<std::int64_t>(ns(random))));
    }

    /// Profiles every kernel, off by up to `error`, each by its own; and all by `bias`.
    void profile(double error, double bias = 1) {
        std::uniform_real_distribution<double> off(1 - error, 1 + error);
        std::vector<Durations::Planned> planned;
        for (std::size_t i = 0; i < truth.size(); ++i)
            planned.push_back({i + 1, scaled(truth[i], off(random) * bias)});
        durations = Durations(planned);
    }

    /// Runs an instance, each kernel `noise` off its mean, and learns from all its marks.
    /// @returns the share of samples within one kernel of the truth
    double run(double noise = 0.05, double slowdown = 1, bool shared = false) {
        std::uniform_real_distribution<double> off(1 - noise, 1 + noise);
        VirtualInstance instance;
        for (std::size_t i = 0; i < truth.size(); ++i) {
            instance.truth.push_back(scaled(truth[i], off(random) * slowdown));
            instance.estimates.push_back(
                durations.find(static_cast<std::uint32_t>(i), i + 1).value_or(kUnknown));
        }
        if (dithers)
            instance.every =
                nanoseconds(std::uniform_int_distribution<std::int64_t>(100'000, 300'000)(random));
        instance.instance = ++number;
        const std::size_t first_mark = stream.marks.size();
        const nanoseconds begin = end + 2ms;
        end = launch_instance(stream, instance, begin, random);

        model::Pace pace;
        int samples = 0, within_one = 0;
        std::size_t learned = first_mark;
        std::uniform_int_distribution<std::int64_t> step_ns(1'000, 60'000);
        for (nanoseconds now = begin; now < end; now += nanoseconds(step_ns(random))) {
            stream.move_to(now);
            learn_up_to_seen(learned, shared);
            const std::size_t at = stream.truth(now);
            if (at >= stream.launches.size() || stream.launches[at].call > now) continue;
            pace.saw(stream.log, stream.seen(), shared);
            const auto p = model::locate(stream.log, stream.seen(), {pace.value(shared)}, now);
            REQUIRE(p);
            ++samples;
            within_one += std::abs(std::int64_t{p->launch} - static_cast<std::int64_t>(at)) <= 1;
        }
        stream.move_to(end);
        learn_up_to_seen(learned, shared);
        durations.end_instance(static_cast<std::uint32_t>(truth.size()));
        return static_cast<double>(within_one) / samples;
    }

    void learn_up_to_seen(std::size_t& learned, bool shared) {
        const std::uint32_t seen = stream.seen().sequence;
        for (; learned < seen; ++learned) {
            const auto span =
                model::span_between(stream.log, stamped(learned), stamped(learned + 1),
                                    VirtualStream::kMarkCost, shared);
            if (!span) continue;
            num_own += span->is_own();
            ++num_spans;
            durations.observe(stream.log, *span);
        }
    }
    model::StampedMark stamped(std::size_t sequence) const {
        if (sequence == 0) return {};
        const auto& m = stream.marks[sequence - 1];
        return {m.sequence, stream.timer.stamp(m.run), m.run, 2us};
    }

    /// Mean relative error of the estimates, kernel by kernel.
    double error() const {
        double sum = 0;
        for (std::size_t i = 0; i < truth.size(); ++i) {
            const auto e = durations.find(static_cast<std::uint32_t>(i), i + 1).value_or(kUnknown);
            sum += std::abs(static_cast<double>((e - truth[i]).count()) /
                            static_cast<double>(truth[i].count()));
        }
        return sum / static_cast<double>(truth.size());
    }
    /// Relative error of the whole.
    double total_error() const {
        nanoseconds sum{0};
        for (nanoseconds t : truth) sum += t;
        return std::abs(static_cast<double>((durations.remaining_from(0) - sum).count())) /
               static_cast<double>(sum.count());
    }

    std::mt19937 random;
    std::vector<nanoseconds> truth;
    Durations durations;
    VirtualStream stream;
    nanoseconds end{0};
    std::uint16_t number = 0;
    bool dithers = false;  // marks fall between other launches in other instances
    int num_own = 0, num_spans = 0;
};

}  // namespace

TEST_CASE("Durations approach each kernel's own, beginning with a profile that is 30 % off",
          "[model][durations]") {
    for (std::uint32_t seed = 0; seed < 4; ++seed) {
        INFO("seed " << seed);
        Learner l(seed);
        l.profile(0.3);
        const double before = l.error();
        l.dithers = true;
        for (int i = 0; i < 60; ++i) l.run();
        CHECK(l.error() < 0.8 * before);
        CHECK(l.total_error() < 0.03);
        CHECK(l.num_own > l.num_spans * 9 / 10);
    }
}

TEST_CASE("Durations make positions right where all estimates are off by the same",
          "[model][durations]") {
    for (double bias : {0.5, 0.7, 1.3, 2.0}) {
        INFO("profile " << bias << " times the truth");
        Learner l(7);
        l.profile(0.1, bias);
        for (int i = 0; i < 6; ++i) l.run();
        double within_one = 0;
        for (int i = 0; i < 20; ++i) within_one += l.run() / 20;
        CHECK(within_one >= 0.95);
        CHECK(l.total_error() < 0.1);
    }
}

TEST_CASE("Durations keep positions within one kernel in 95 % for small kernels 30 % off",
          "[model][durations]") {
    for (std::uint32_t seed = 0; seed < 4; ++seed) {
        INFO("seed " << seed);
        Learner l(seed, 300, 30'000);
        l.profile(0.3);
        l.dithers = true;
        double within_one = 0;
        for (int i = 0; i < 20; ++i) within_one += l.run() / 20;
        CHECK(within_one >= 0.95);
    }
}

TEST_CASE("Durations begin with an empty profile and work after a few instances",
          "[model][durations]") {
    for (std::uint32_t seed = 0; seed < 4; ++seed) {
        INFO("seed " << seed);
        Learner l(seed);
        for (int i = 0; i < 5; ++i) l.run();
        CHECK(l.total_error() < 0.1);
        for (int i = 0; i < 25; ++i) l.run();
        double within_one = 0;
        for (int i = 0; i < 10; ++i) within_one += l.run() / 10;
        CHECK(within_one >= 0.9);
    }
}

TEST_CASE("Durations are not pulled up by others on the GPU", "[model][durations]") {
    Learner l(3);
    l.profile(0);
    for (int i = 0; i < 20; ++i) l.run(0.05, i % 2 == 0 ? 1 : 1.8, i % 2 != 0);
    CHECK(l.total_error() < 0.05);
    CHECK(l.durations.profile_fit().fits);
}
