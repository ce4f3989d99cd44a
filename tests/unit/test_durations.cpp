// SPDX-License-Identifier: Apache-2.0
#include "host/model/durations.h"
#include "host/model/pace.h"

#include <memory>
#include <random>
#include <vector>

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

// A log with so many launches of 10 us, put down long before marks ran.
struct Spans {
    Durations durations;
    std::unique_ptr<model::LaunchLog> log = std::make_unique<model::LaunchLog>();
    std::uint32_t next_position = 0;

    model::MeasuredSpan launch(std::uint32_t n, nanoseconds measured, bool shared = false,
                               std::uint64_t kernel = 0) {
        const std::uint32_t first = log->count();
        for (std::uint32_t i = 0; i < n; ++i) {
            const std::uint64_t k = kernel ? kernel : next_position + 1;
            log->launched(durations.find(next_position, k).value_or(10us),
                          {0ns, 0ns, k, next_position, 1});
            ++next_position;
        }
        return {first, log->count(), measured, shared, false};
    }
    void instance(std::uint32_t n, nanoseconds measured, bool shared = false,
                  std::uint64_t kernel = 0) {
        next_position = 0;
        durations.observe(*log, launch(n, measured, shared, kernel));
        durations.end_instance(n);
    }
    nanoseconds at(std::uint32_t position, std::uint64_t kernel) const {
        return durations.find(position, kernel).value_or(-1ns);
    }
};

Durations planned(std::uint32_t n, nanoseconds each) {
    std::vector<Durations::Planned> plan;
    for (std::uint32_t i = 0; i < n; ++i) plan.push_back({i + 1, each});
    return Durations(plan);
}

}  // namespace

TEST_CASE("Durations share a span out in proportion to the estimates", "[model][durations]") {
    Spans s;
    s.durations = Durations(std::vector<Durations::Planned>{{1, 10us}, {2, 30us}});
    s.instance(2, 44us);
    // By a tenth more each; a profile counts as one sample.
    CHECK(s.at(0, 1) == 10'500ns);
    CHECK(s.at(1, 2) == 31'500ns);
    CHECK(s.durations.remaining_from(0) == 42us);
    CHECK(s.durations.remaining_from(1) == 31'500ns);
    CHECK(s.durations.remaining_from(2) == 0ns);
}

TEST_CASE("Durations know nothing before they are told", "[model][durations]") {
    Spans s;
    CHECK_FALSE(s.durations.find(0, 1));
    CHECK(s.durations.remaining_from(0) == 0ns);
    s.instance(2, 50us);
    CHECK(s.at(0, 1) == 25us);
    CHECK(s.durations.num_launches() == 2);
    // By kernel and size where another position has it.
    CHECK(s.at(17, 2) == 25us);
    CHECK_FALSE(s.durations.find(17, 3));
}

TEST_CASE("Durations move by a bounded factor an instance", "[model][durations]") {
    Spans s;
    s.durations = planned(2, 10us);
    s.instance(2, 2s);
    CHECK(s.at(0, 1) == 12'500ns);
    s.instance(2, 1us);
    CHECK(s.at(0, 1) == 10us);
    // Many spans of the same kernel in one instance move it no further than one.
    s.next_position = 0;
    for (int i = 0; i < 50; ++i) {
        s.next_position = 0;
        s.durations.observe(*s.log, s.launch(2, 2s));
    }
    CHECK(s.at(0, 1) == 12'500ns);
}

TEST_CASE("Durations learn once from a span that has a kernel many times", "[model][durations]") {
    Spans s;
    for (int i = 0; i < 20; ++i) s.instance(10, 100us, false, 5);
    s.instance(10, 180us, false, 5);
    CHECK(s.at(17, 5) == 11us);  // an eighth of the way
}

TEST_CASE("Durations recover from a first instance that was ten times too long",
          "[model][durations]") {
    Spans s;
    s.instance(4, 400us);
    CHECK(s.at(0, 1) == 100us);
    for (int i = 0; i < 8; ++i) s.instance(4, 40us);
    CHECK(s.at(0, 1) < 15us);
}

TEST_CASE("Durations correct a profile that is off by two within a few instances",
          "[model][durations]") {
    Spans s;
    s.durations = planned(4, 10us);
    for (int i = 0; i < 4; ++i) s.instance(4, 80us);
    CHECK(s.at(0, 1) > 18us);
    CHECK(s.at(0, 1) <= 20us);
}

TEST_CASE("Durations take time shared with others for an upper bound", "[model][durations]") {
    Spans s;
    s.durations = planned(2, 10us);
    s.instance(2, 70us, true);
    CHECK(s.at(0, 1) == 10us);
    s.instance(2, 18us, true);  // within the margin: noise
    CHECK(s.at(0, 1) == 10us);
    s.instance(2, 12us, true);
    CHECK(s.at(0, 1) == 9'500ns);
    // Where nothing is known it is better than nothing, until there is more.
    Spans unknown;
    unknown.instance(1, 70us, true);
    CHECK(unknown.at(0, 1) == 70us);
    unknown.instance(1, 30us);
    CHECK(unknown.at(0, 1) == 30us);
    CHECK(unknown.at(17, 1) == 30us);
}

TEST_CASE("Durations do not count time in which the GPU waited for a launch",
          "[model][durations]") {
    VirtualStream stream;
    stream.launch(1ms, 100us, 100us, 0);
    stream.mark(1001us);
    for (std::uint32_t i = 1; i < 4; ++i) stream.launch(1010us, 100us, 100us, i);
    stream.mark(1010us);  // launched in time
    stream.launch(1010us, 100us, 100us, 4);
    stream.launch(3ms, 100us, 100us, 5);
    stream.mark(3ms);  // the last launch came late
    stream.launch(5ms, 100us, 100us, 6);
    stream.launch(5001us, 100us, 100us, 7);
    stream.mark(5002us);  // the first launch came late: the span begins with it
    stream.launch(6ms, 10us, 10us, 8);
    stream.mark(6ms);  // too short for that
    stream.move_to(10ms);
    const auto span = [&](std::size_t to, bool shared = false) {
        const auto stamped = [&](std::size_t i) {
            const auto& m = stream.marks[i];
            return model::StampedMark{m.sequence, stream.timer.stamp(m.run), m.run, 2us};
        };
        return model::span_between(stream.log, stamped(to - 1), stamped(to),
                                   VirtualStream::kMarkCost, shared);
    };
    const auto near = [](nanoseconds a, nanoseconds b) { return std::chrono::abs(a - b) < 100ns; };
    REQUIRE(span(1));
    CHECK(span(1)->is_own());
    CHECK(span(1)->first == 1);
    CHECK(span(1)->end == 4);
    CHECK(near(span(1)->measured, 300us));
    CHECK_FALSE(span(1, true)->is_own());
    CHECK(span(2)->late);
    CHECK(span(3)->is_own());
    CHECK(near(span(3)->measured, 200us));
    CHECK(span(4)->late);
    CHECK(span(4)->measured > 10us);
}

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

TEST_CASE("Durations tell when the profile no longer fits", "[model][durations]") {
    Spans s;
    s.durations = planned(4, 10us);
    for (std::uint32_t i = 1; i < Durations::kMisfitInstances; ++i) s.instance(4, 64us);
    CHECK(s.durations.profile_fit().fits);
    CHECK(s.durations.profile_fit().instances == Durations::kMisfitInstances - 1);
    s.instance(4, 64us);
    CHECK_FALSE(s.durations.profile_fit().fits);
    CHECK(s.durations.profile_fit().ratio == Approx(1.6));
    s.instance(4, 400us, true);  // shared time says nothing of it
    CHECK(s.durations.profile_fit().ratio == Approx(1.6));
    s.instance(4, 45us);
    CHECK(s.durations.profile_fit().fits);
    CHECK(s.durations.profile_fit().instances == 0);
    // Now too long, now too short is noise.
    for (int i = 0; i < 40; ++i) s.instance(4, i % 2 == 0 ? 80us : 20us);
    CHECK(s.durations.profile_fit().fits);
    for (int i = 0; i < 8; ++i) s.instance(4, 20us);
    CHECK_FALSE(s.durations.profile_fit().fits);
}

TEST_CASE("Durations let another kernel have a position after it stood there three times",
          "[model][durations]") {
    Spans s;
    s.durations = planned(1, 10us);
    s.instance(1, 50us, false, 99);
    s.instance(1, 50us, false, 99);
    CHECK(s.at(0, 1) == 10us);
    s.instance(1, 50us, false, 99);
    CHECK_FALSE(s.durations.find(0, 1));
    CHECK(s.at(0, 99) == 50us);
}

TEST_CASE("Durations keep their storage when kernels never end", "[model][durations]") {
    Spans s;
    for (std::uint64_t kernel = 1; kernel < 5'000; ++kernel) s.instance(1, 50us, false, kernel);
    CHECK_FALSE(s.durations.find(7, 4'999));
    CHECK(s.at(7, 384) == 50us);
    CHECK_FALSE(s.durations.find(7, 385));  // three quarters full
    s.durations.end_instance(0xffff'ffffu);
    CHECK(s.durations.num_launches() == Durations::kMaxPositions);
}

TEST_CASE("kernel_id tells kernels and sizes apart", "[model][durations]") {
    CHECK(model::kernel_id({5, 6, 7}) == model::kernel_id({5, 6, 7}));
    CHECK(model::kernel_id({5, 6, 7}) != model::kernel_id({5, 7, 6}));
    CHECK(model::kernel_id({5, 6, 7}) != model::kernel_id({6, 6, 7}));
    CHECK(model::kernel_id({}) != 0);
}
