// SPDX-License-Identifier: Apache-2.0
#include "host/exec/program_streams.h"

#include <map>

#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;

namespace {

const CUstream kA = reinterpret_cast<CUstream>(0xa0), kB = reinterpret_cast<CUstream>(0xb0);
constexpr auto kLegacy = StreamFlavor::kLegacy, kPerThread = StreamFlavor::kPerThread;
constexpr int kOwn = -1, kLent = -5;

/// Streams with priorities, one of which may capture, and lanes of ours.
struct Fixture {
    FakeDriver driver;
    GovernorFixture governed{{20ms}};
    std::map<CUstream, int> priorities{{kA, kOwn}, {kB, kOwn}};
    std::uintptr_t num_lanes = 0;
    bool refuses_priorities = false, context_is_gone = false;
    MarkContext context;
    ProgramStreams streams{driver.api, governed.governor.tasks()};

    Fixture() {
        current = this;
        context.id = 0x42;
        auto& api = driver.api;
        api.cuStreamGetAttribute = [](CUstream s, CUstreamAttrID, CUstreamAttrValue* v) {
            v->priority = current->priorities[s];
            return CUDA_SUCCESS;
        };
        api.cuStreamSetAttribute = [](CUstream s, CUstreamAttrID, const CUstreamAttrValue* v) {
            if (current->refuses_priorities) return CUDA_ERROR_UNKNOWN;
            current->priorities[s] = v->priority;
            return CUDA_SUCCESS;
        };
        api.cuStreamGetPriority = [](CUstream s, int* p) {
            *p = current->priorities[s];
            return CUDA_SUCCESS;
        };
        api.cuStreamCreateWithPriority = [](CUstream* stream, unsigned, int) {
            *stream = reinterpret_cast<CUstream>(0x9000 + 0x10 * ++current->num_lanes);
            return CUDA_SUCCESS;
        };
        api.cuEventCreate = [](CUevent* event, unsigned) {
            *event = reinterpret_cast<CUevent>(0x20);
            return CUDA_SUCCESS;
        };
        api.cuEventRecord = [](CUevent, CUstream) { return CUDA_SUCCESS; };
        api.cuEventRecord_ptsz = api.cuEventRecord;
        api.cuStreamWaitEvent = [](CUstream, CUevent, unsigned) { return CUDA_SUCCESS; };
        api.cuStreamQuery = [](CUstream) { return CUDA_SUCCESS; };
        api.cuCtxGetId = [](CUcontext c, unsigned long long* id) {
            *id = reinterpret_cast<unsigned long long>(c);
            return current->context_is_gone ? CUDA_ERROR_CONTEXT_IS_DESTROYED : CUDA_SUCCESS;
        };
    }
    ~Fixture() { current = nullptr; }

    /// A loan that the driver does not let be given back: the program's questions are answered for
    /// it.
    void lend_for_good(CUstream stream) {
        REQUIRE(streams.priorities().lend(stream, kLegacy, kLent));
        refuses_priorities = true;
        streams.priorities().give_back(stream, kLegacy);
        refuses_priorities = false;
        REQUIRE(is_lent(stream));
        REQUIRE(own(stream) == kOwn);
    }
    int own(CUstream stream) { return streams.priorities().own(stream, kLegacy); }
    bool is_lent(CUstream stream) { return priorities[stream] == kLent; }
    std::uint32_t changes() const { return governed.governor.tasks().changes(); }

    inline static Fixture* current = nullptr;
};

}  // namespace

TEST_CASE("A capture gets the stream's own priority, and launches are asked about again",
          "[exec][streams]") {
    const bool may_begin = GENERATE(false, true);
    Fixture f;
    REQUIRE(f.streams.priorities().lend(kA, kLegacy, kLent));
    REQUIRE(f.streams.priorities().lend(kB, kLegacy, kLent));
    CHECK_FALSE(f.streams.captures().any());
    const std::uint32_t before = f.changes();
    may_begin ? f.streams.capture_may_begin(kA, kLegacy) : f.streams.capture_begins(kA, kLegacy);
    CHECK_FALSE(f.is_lent(kA));
    CHECK(f.is_lent(kB));
    CHECK(f.changes() > before);
    f.driver.capturing = kA;
    CHECK(f.streams.is_capturing(kA, kLegacy));
    CHECK_FALSE(f.streams.is_capturing(kB, kLegacy));
    f.streams.capture_ended(kA, kLegacy);
    CHECK_FALSE(f.streams.captures().any());
    const int asked = f.driver.num_capture_queries;
    CHECK_FALSE(f.streams.is_capturing(kA, kLegacy));
    CHECK(f.driver.num_capture_queries == asked);  // there is nothing to ask
}

TEST_CASE("Captures that begin twice on a stream end twice, but those not seen to end once",
          "[exec][streams]") {
    Fixture f;
    f.streams.capture_begins(kA, kLegacy);
    f.streams.capture_begins(kA, kLegacy);  // is refused, and ends at once
    f.streams.capture_ended(kA, kLegacy);
    CHECK(f.streams.captures().any());
    f.streams.capture_ended(kA, kLegacy);
    CHECK_FALSE(f.streams.captures().any());

    f.streams.capture_may_begin(kA, kLegacy);
    REQUIRE(f.streams.priorities().lend(kA, kLegacy, kLent));
    f.streams.capture_may_begin(kA, kLegacy);
    CHECK_FALSE(f.is_lent(kA));  // each may be the one that copies it
    f.streams.capture_ended(kA, kLegacy);
    CHECK_FALSE(f.streams.captures().any());
}

TEST_CASE("A stream that is destroyed leaves nothing to another of its handle", "[exec][streams]") {
    Fixture f;
    f.lend_for_good(kA);
    f.lend_for_good(kB);
    const PriorityPool::Lane* const lane = f.streams.pool().fork(f.context, kLent, kA, kLegacy);
    REQUIRE(lane);
    CHECK_FALSE(f.streams.destroyed(kA));
    CHECK(f.own(kA) == kLent);  // what the driver says
    CHECK(f.own(kB) == kOwn);
    // Its lane is another stream's.
    CHECK(f.streams.pool().fork(f.context, kLent, kB, kLegacy) == lane);
    CHECK(f.num_lanes == 1);

    f.streams.capture_begins(kA, kLegacy);
    CHECK_FALSE(f.streams.destroyed(kB));
    CHECK(f.streams.destroyed(kA));
    CHECK(f.streams.captures().any());  // until the driver has destroyed it
    f.streams.capture_ended(kA, kLegacy);
    CHECK_FALSE(f.streams.captures().any());
}

TEST_CASE("A context that ends takes its streams' loans and captures with it", "[exec][streams]") {
    Fixture f;
    f.lend_for_good(kA);
    f.streams.capture_begins(kB, kLegacy);
    f.streams.context_ends();
    CHECK(f.own(kA) == kLent);  // what the driver says, whatever the handle means now
    f.streams.context_ended();
    CHECK(f.streams.captures().any());  // it was another one
    f.context_is_gone = true;
    f.streams.context_ended();
    CHECK_FALSE(f.streams.captures().any());
}

TEST_CASE("A thread that ends takes its own stream's capture and lanes with it",
          "[exec][streams]") {
    Fixture f;
    f.streams.capture_begins(kA, kLegacy);
    f.streams.capture_begins(nullptr, kPerThread);
    const PriorityPool::Lane* const lane =
        f.streams.pool().fork(f.context, kLent, nullptr, kPerThread);
    REQUIRE(lane);
    REQUIRE(f.streams.pool().fork(f.context, kLent, kB, kLegacy) != lane);
    f.streams.thread_ends();
    CHECK(f.streams.captures().any());
    f.streams.capture_ended(kA, kLegacy);
    CHECK_FALSE(f.streams.captures().any());
    CHECK(f.streams.pool().fork(f.context, kLent, kA, kLegacy) == lane);
}
