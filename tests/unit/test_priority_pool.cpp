// SPDX-License-Identifier: Apache-2.0
#include "host/exec/priority_pool.h"

#include <set>

#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;

namespace {

constexpr int kMost = 256;
constexpr int kPriority = -3;
constexpr int kGone = 100'000;  ///< a stream that has been destroyed

int g_num_made = 0;
bool g_idle = true;

CUstream program_stream(int i) {
    return reinterpret_cast<CUstream>(0x10000 + 0x10 * static_cast<std::uintptr_t>(i));
}

struct Fixture {
    FakeDriver driver;
    PriorityPool pool{driver.api};
    MarkContext context, other;

    Fixture() {
        g_num_made = 0;
        g_idle = true;
        context.id = 1;
        other.id = 2;
        driver.api.cuStreamCreateWithPriority = [](CUstream* stream, unsigned, int) {
            *stream = reinterpret_cast<CUstream>(0x900000 + 0x10 * std::uintptr_t(++g_num_made));
            return CUDA_SUCCESS;
        };
        driver.api.cuStreamGetPriority = [](CUstream stream, int*) {
            return stream == program_stream(kGone) ? CUDA_ERROR_INVALID_HANDLE : CUDA_SUCCESS;
        };
        driver.api.cuEventCreate = [](CUevent* event, unsigned) {
            *event = reinterpret_cast<CUevent>(0x20);
            return CUDA_SUCCESS;
        };
        driver.api.cuEventRecord = [](CUevent, CUstream) { return CUDA_SUCCESS; };
        driver.api.cuStreamWaitEvent = [](CUstream, CUevent, unsigned) { return CUDA_SUCCESS; };
        driver.api.cuStreamQuery = [](CUstream) {
            return g_idle ? CUDA_SUCCESS : CUDA_ERROR_NOT_READY;
        };
    }
    const PriorityPool::Lane* fork(const MarkContext& its, int stream, int priority = kPriority) {
        return pool.fork(its, priority, program_stream(stream), StreamFlavor::kLegacy);
    }
    void destroy(int stream) { pool.forget({program_stream(stream), nullptr}); }
};

}  // namespace

TEST_CASE("Lane of a stream that has gone is another's when nothing is on it", "[unit][pool]") {
    Fixture f;
    const auto* const first = f.fork(f.context, 0);
    REQUIRE(first != nullptr);
    CHECK(f.fork(f.context, 0) == first);
    CHECK(f.fork(f.context, 1) != first);
    f.destroy(0);
    g_idle = false;
    CHECK(f.fork(f.context, 2) != first);
    g_idle = true;
    CHECK(f.fork(f.context, 3, kPriority + 1) != first);
    CHECK(f.fork(f.other, 4) != first);
    CHECK(f.fork(f.context, 5) == first);
    CHECK(f.fork(f.context, 6) != first);
}

TEST_CASE("Stream that is no more gets no lane, which could have its handle", "[unit][pool]") {
    Fixture f;
    CHECK(f.fork(f.context, kGone) == nullptr);
    CHECK(g_num_made == 0);
}

TEST_CASE("Streams have lanes when any number of others have come and gone", "[unit][pool]") {
    Fixture f;
    for (int i = 0; i < 3 * kMost; ++i) {
        CHECK(f.fork(f.context, i) != nullptr);
        f.destroy(i);
    }
    CHECK(g_num_made == 1);
}

TEST_CASE("Streams have lanes when those before them went with their context", "[unit][pool]") {
    Fixture f;
    for (int i = 0; i < kMost; ++i) CHECK(f.fork(f.other, i) != nullptr);
    CHECK(f.fork(f.context, kMost) == nullptr);  // so many at a time
    CHECK(f.fork(f.other, 0) != nullptr);
    f.pool.context_ended(f.other.id);
    std::set<const PriorityPool::Lane*> lanes;
    for (int i = 0; i < kMost; ++i) lanes.insert(f.fork(f.context, i));
    CHECK(lanes.size() == kMost);
    CHECK(lanes.count(nullptr) == 0);
    CHECK(g_num_made == 2 * kMost);
}
