// SPDX-License-Identifier: Apache-2.0
#include "host/model/instance_tracker.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::InstanceTracker;
using model::KernelKey;
using model::TaskPlan;
using Step = InstanceTracker::Step;

namespace {

KernelKey key(const char* name, std::uint64_t grid = 10) {
    return {fnv1a64(name), grid, 128};
}

// Three segments: 3 launches that begin with "a", 2 (1 to 3) with "b", 4 with "c".
TaskPlan three_segments() {
    config::TaskProfile p;
    for (const char* name : {"a", "x", "x", "b", "x", "c", "x", "x", "x"})
        p.kernels.push_back({name, 10, 128, 10us, 0.5});
    p.segments = {{1ms, 3, 3, 3, "stream"}, {1ms, 2, 1, 3, "copy"}, {1ms, 4, 4, 4, "stream"}};
    return TaskPlan(p);
}

struct Walk {
    TaskPlan plan = three_segments();
    InstanceTracker tracker{plan};

    /// A segment of `launches` that begins with `first`. @returns what its first launch was
    Step segment(const char* first, int launches) {
        const Step step = tracker.launch(key(first));
        for (int i = 1; i < launches; ++i) CHECK(tracker.launch(key("x")) == Step::kContinue);
        return step;
    }
};

}  // namespace

TEST_CASE("Tracker begins and ends instances where the plan does", "[model][instances]") {
    Walk w;
    for (int frame = 0; frame < 3; ++frame) {
        CHECK(w.segment("a", 3) == Step::kBegin);
        CHECK_FALSE(w.tracker.closed("stream"));
        CHECK(w.tracker.position() == 3);
        CHECK(w.tracker.segment() == 1);
        CHECK(w.segment("b", 2) == Step::kContinue);
        CHECK_FALSE(w.tracker.closed("copy"));
        CHECK(w.segment("c", 4) == Step::kContinue);
        CHECK(w.tracker.in_instance());
        CHECK(w.tracker.closed("stream"));
        CHECK(w.tracker.fits());
        CHECK_FALSE(w.tracker.in_instance());
    }
}

TEST_CASE("Tracker takes a count that the profile has seen", "[model][instances]") {
    Walk w;
    w.segment("a", 3);
    w.tracker.closed("stream");
    w.segment("b", 1);
    w.tracker.closed("copy");
    CHECK(w.tracker.position() == 5);
    w.segment("c", 4);
    CHECK(w.tracker.closed("stream"));
    CHECK(w.tracker.fits());
}

TEST_CASE("Tracker ignores waits when nothing was launched before them", "[model][instances]") {
    Walk w;
    CHECK_FALSE(w.tracker.closed("stream"));
    w.segment("a", 3);
    w.tracker.closed("stream");
    CHECK_FALSE(w.tracker.closed("stream"));
    CHECK(w.tracker.position() == 3);
}

TEST_CASE("Tracker goes on with a segment when a wait of another kind comes too early",
          "[model][instances]") {
    Walk w;
    w.segment("a", 2);
    CHECK_FALSE(w.tracker.closed("event"));
    CHECK(w.tracker.position() == 2);
    w.tracker.launch(key("x"));
    w.tracker.closed("stream");
    CHECK(w.tracker.position() == 3);
}

TEST_CASE("Tracker ends an instance at its closing wait when the count does not fit",
          "[model][instances]") {
    Walk w;
    w.segment("a", 3);
    w.tracker.closed("stream");
    w.segment("b", 2);
    w.tracker.closed("copy");
    w.segment("c", 7);
    CHECK(w.tracker.closed("stream"));
    CHECK_FALSE(w.tracker.fits());
    CHECK(w.segment("a", 3) == Step::kBegin);  // the next one is not shifted
    CHECK(w.tracker.fits());
    w.tracker.closed("stream");
    CHECK(w.tracker.position() == 3);
}

TEST_CASE("Tracker walks over segments that one wait closed together", "[model][instances]") {
    Walk w;
    w.segment("a", 5);  // and b
    CHECK_FALSE(w.tracker.closed("copy"));
    CHECK(w.tracker.position() == 5);
    w.segment("c", 4);
    CHECK(w.tracker.closed("stream"));
    CHECK_FALSE(w.tracker.fits());
}

TEST_CASE("Tracker sees a new instance when the last one skipped its end", "[model][instances]") {
    Walk w;
    w.segment("a", 3);
    w.tracker.closed("stream");
    CHECK(w.segment("a", 3) == Step::kEndAndBegin);
    w.tracker.closed("stream");
    w.segment("b", 2);
    w.tracker.closed("copy");
    w.segment("c", 4);
    CHECK(w.tracker.closed("stream"));
}

TEST_CASE("Tracker finds its place when a segment is skipped or it starts in the middle",
          "[model][instances]") {
    Walk w;
    w.segment("a", 3);
    w.tracker.closed("stream");
    CHECK(w.segment("c", 4) == Step::kContinue);
    CHECK(w.tracker.closed("stream"));
    CHECK_FALSE(w.tracker.fits());
    CHECK(w.segment("c", 4) == Step::kBegin);
    CHECK_FALSE(w.tracker.fits());
    CHECK(w.tracker.closed("stream"));
}

TEST_CASE("Tracker fits when the task is known by a later kernel than its first",
          "[model][instances]") {
    Walk w;
    for (int frame = 0; frame < 2; ++frame) {
        CHECK(w.tracker.launch(key("x")) == Step::kBegin);  // the second of the plan
        CHECK(w.tracker.position() == 2);
        w.tracker.launch(key("x"));
        CHECK_FALSE(w.tracker.closed("stream"));
        CHECK(w.tracker.position() == 3);
        w.segment("b", 2);
        w.tracker.closed("copy");
        w.segment("c", 4);
        CHECK(w.tracker.closed("stream"));
        CHECK(w.tracker.fits());
    }
}

TEST_CASE("Tracker prefers the segment that it expects when sizes vary", "[model][instances]") {
    config::TaskProfile p;
    for (std::uint64_t grid : {10, 20, 30}) p.kernels.push_back({"k", grid, 128, 10us, 0.5});
    p.segments = {{1ms, 1, 1, 1, "stream"}, {1ms, 1, 1, 1, "stream"}, {1ms, 1, 1, 1, "stream"}};
    const TaskPlan plan(p);
    InstanceTracker tracker(plan);
    for (int frame = 0; frame < 2; ++frame) {
        for (std::uint64_t grid : {11, 21, 31}) {  // no size as in the profile
            tracker.launch(key("k", grid));
            CHECK(tracker.closed("stream") == (grid == 31));
        }
        CHECK(tracker.fits());
    }
    tracker.launch(key("k", 10));
    tracker.closed("stream");
    CHECK(tracker.launch(key("k", 10)) == Step::kEndAndBegin);  // exactly the first
}

TEST_CASE("Tracker takes what is launched up to a wait for an instance when there is no plan",
          "[model][instances]") {
    const TaskPlan plan;
    InstanceTracker tracker(plan);
    CHECK(tracker.launch(key("a")) == Step::kBegin);
    CHECK(tracker.launch(key("a")) == Step::kContinue);
    CHECK(tracker.position() == 2);
    CHECK(tracker.closed("stream"));
    CHECK(tracker.launch(key("a")) == Step::kBegin);
}
