// SPDX-License-Identifier: Apache-2.0
#include "host/exec/progress_marks.h"

#include "tests/support/marks_driver.h"

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;
using namespace urgengo::testing::marks;
using config::ProgressSource;
using namespace std::chrono_literals;

TEST_CASE("Mark kernel overlaps what is before it only where its code waits for that",
          "[exec][marks]") {
    Fixture f;
    bool may_overlap = true;
    unsigned attributes = 1;
    SECTION("compute capability 9.0") {
        attributes = 2;
    }
    SECTION("older GPU") {
        f.driver.compute_major = 8;
    }
    SECTION("newer GPU, code from PTX for an older one") {
        f.driver.ptx_version = 75;
    }
    SECTION("the driver cannot say") {
        f.driver.base.api.cuFuncGetAttribute = nullptr;
    }
    SECTION("what is before overlaps itself") {
        may_overlap = false;
    }
    f.prepare(ProgressSource::kAuto);
    CHECK(f.emit(may_overlap) == CUDA_SUCCESS);
    CHECK(f.driver.num_attributes == attributes);
    CHECK(f.driver.base.marks.at(0).priority == -5);
    CHECK(f.poller.num_starts == 0);
    // Those that time kernels are launched plainly everywhere.
    CHECK(f.marks->launch_at(*f.context, f.context->d_lines, 0, 1, kStream,
                             StreamFlavor::kLegacy) == CUDA_SUCCESS);
    CHECK(f.driver.num_attributes == 1);
}

TEST_CASE("Mark kernel is launched plainly from then on when the driver refuses the overlap",
          "[exec][marks]") {
    Fixture f;
    f.driver.overlap_result = CUDA_ERROR_NOT_SUPPORTED;
    f.prepare(ProgressSource::kKernel);
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.num_launches == 2);
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.num_launches == 3);
    CHECK(f.driver.base.marks.size() == 2);
    // Another error is what it is.
    Fixture other;
    other.driver.overlap_result = CUDA_ERROR_LAUNCH_FAILED;
    other.prepare(ProgressSource::kKernel);
    CHECK(other.emit() == CUDA_ERROR_LAUNCH_FAILED);
    CHECK(other.driver.num_launches == 1);
}

TEST_CASE("Stream writes put the two tagged words into the line, without a time",
          "[exec][marks][memop]") {
    Fixture f;
    f.prepare(ProgressSource::kMemop);
    CHECK(f.emit() == CUDA_SUCCESS);
    REQUIRE(f.driver.writes.size() == 4);
    CHECK(f.driver.num_launches == 0);
    const auto line = reinterpret_cast<std::uint64_t>(&f.line());
    CHECK(f.driver.writes == std::vector<std::uint64_t>{line, ug_mark_word0(7, 9, 1), line + 8, 1});
    // A reader between the two sees that they are of different marks.
    f.line().word[0] = f.driver.writes[1];
    CHECK(model::read_marks_done(f.line(), 1, 12345) == 12345);
    f.line().word[1] = f.driver.writes[3];
    CHECK(f.done() == 1);
    CHECK(f.line().word[1] >> 16 == UG_MARK_NO_TIME);
}

TEST_CASE("Lines say what they said when their context has ended", "[exec][marks]") {
    Fixture f;
    f.prepare(ProgressSource::kKernel);
    f.sequence = 39999;
    CHECK(f.emit() == CUDA_SUCCESS);
    f.driver.base.execute_marks(1);
    f.driver.base.api.cuCtxGetId = [](CUcontext, unsigned long long*) {
        return CUDA_ERROR_CONTEXT_IS_DESTROYED;
    };
    int num_ended = 0;
    f.marks->context_ended({}, [&](unsigned long long) { ++num_ended; });
    CHECK(num_ended == 1);
    CHECK(f.done() == 40000);  // zeroes would be mark 65536
}

TEST_CASE("Contexts that come and go take no more memory", "[exec][marks]") {
    static unsigned long long id = 0;
    id = 0;
    Fixture f;
    f.driver.base.api.cuCtxGetId = [](CUcontext, unsigned long long* found) {
        *found = id;
        return CUDA_SUCCESS;
    };
    std::set<const MarkContext*> contexts;
    std::set<const ug_mark_line*> lines;
    f.prepare(ProgressSource::kKernel);
    for (int i = 0; i < 300; ++i) {
        const MarkContext* context = f.marks->prepare();
        REQUIRE(context != nullptr);
        REQUIRE(context->id == id);
        CHECK(contexts.empty() == (i == 0));
        contexts.insert(context);
        lines.insert(context->lines);
        ++id;  // the handle is another context's
        f.marks->context_ended({}, [](unsigned long long) {});
    }
    CHECK(contexts.size() == 300);  // what is known of one is never used for another
    CHECK(lines.size() < 100);
}

TEST_CASE("Runtime paces a task by what stream writes say", "[runtime][marks][memop]") {
    static std::vector<std::pair<std::uint64_t*, std::uint64_t>> under_way;
    under_way.clear();
    RuntimeFixture f;
    f.resolved.config.scheduler.progress.source = ProgressSource::kMemop;
    f.driver.api.cuStreamBatchMemOp_v2 = f.driver.api.cuStreamBatchMemOp_v2_ptsz =
        [](CUstream, unsigned count, CUstreamBatchMemOpParams* ops, unsigned) {
            for (unsigned i = 0; i < count; ++i)
                under_way.emplace_back(reinterpret_cast<std::uint64_t*>(ops[i].writeValue.address),
                                       ops[i].writeValue.value64);
            return CUDA_SUCCESS;
        };
    f.clock.on_sleep = [] {  // the GPU has done all that was asked of it
        for (const auto& [address, value] : under_way) *address = value;
        under_way.clear();
    };
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a);  // 2 ms, run-ahead 1 ms
    CHECK(f.clock.num_sleeps > 0);
    CHECK(f.clock.num_sleeps < 5);  // without progress it sleeps until it is overdue
    CHECK(f.driver.marks.empty());
}

TEST_CASE("Kernels mark instead, once and for all, when stream writes are refused",
          "[exec][marks][memop]") {
    Fixture f;
    SECTION("a write is") {
        f.driver.write_result = CUDA_ERROR_NOT_SUPPORTED;
    }
    SECTION("those of 64 bits are not there") {
        f.driver.has_64_bit_writes = 0;
    }
    SECTION("the driver has none") {
        f.driver.base.api.cuStreamBatchMemOp_v2_ptsz = nullptr;
    }
    f.prepare(ProgressSource::kMemop);
    CHECK(f.emit() == CUDA_SUCCESS);
    f.driver.write_result = CUDA_SUCCESS;
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.writes.empty());
    CHECK(f.driver.base.marks.size() == 2);
    f.driver.base.execute_marks(2);
    CHECK(f.done() == 2);
}
