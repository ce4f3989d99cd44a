// SPDX-License-Identifier: Apache-2.0
#include "host/exec/progress_marks.h"

#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "host/model/slot_view.h"
#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;
using config::ProgressSource;
using namespace std::chrono_literals;

namespace {

/// Looks when the test says so.
class HandPoller final : public Poller {
  public:
    bool start(std::function<More()> l) override {
        ++num_starts;
        look_ = std::move(l);
        return starts;
    }
    bool wake() override {
        ++num_wakes;
        return !stopped;
    }

    bool starts = true;
    bool stopped = false;
    int num_starts = 0;
    int num_wakes = 0;
    bool look() { return sees() != More::kNone; }
    More sees() { return look_(); }
    std::function<More()> look_;
};

/// What the driver of these tests has been asked for, and what it answers.
struct Driver {
    FakeDriver base;
    int compute_major = 9;
    int ptx_version = 90;
    int has_64_bit_writes = 1;
    CUresult overlap_result = CUDA_SUCCESS;
    CUresult write_result = CUDA_SUCCESS;
    CUresult create_result = CUDA_SUCCESS;
    CUresult record_result = CUDA_SUCCESS;
    CUresult lost = CUDA_SUCCESS;  ///< answer to every query, if not that
    unsigned num_attributes = 0;   ///< of the last kernel
    int num_launches = 0;
    std::vector<std::uint64_t> writes;  ///< address, value, address, value, ...
    std::map<CUevent, int> recorded;    ///< how often
    std::map<CUevent, bool> complete;
    std::vector<CUevent> order;  ///< of the records
    std::uintptr_t num_events = 0;
    int num_queries = 0;
    CUcontext current = nullptr;  ///< in the poller's thread
    CUstreamCaptureMode mode = CU_STREAM_CAPTURE_MODE_GLOBAL;
    bool asked_unsafely = false;  ///< in another capture mode, or without the context
    std::function<void()> on_query;

    Driver();
    ~Driver() { the = nullptr; }
    static Driver* the;
};
Driver* Driver::the = nullptr;

CUresult record_event(CUevent event, CUstream) {
    Driver& d = *Driver::the;
    if (d.record_result != CUDA_SUCCESS) return d.record_result;
    ++d.recorded[event];
    d.complete[event] = false;
    d.order.push_back(event);
    return CUDA_SUCCESS;
}

CUresult batch(CUstream, unsigned count, CUstreamBatchMemOpParams* ops, unsigned flags) {
    Driver& d = *Driver::the;
    if (d.write_result != CUDA_SUCCESS) return d.write_result;
    CHECK(flags == 0);
    for (unsigned i = 0; i < count; ++i) {
        CHECK(ops[i].operation == CU_STREAM_MEM_OP_WRITE_VALUE_64);
        d.writes.push_back(ops[i].writeValue.address);
        d.writes.push_back(ops[i].writeValue.value64);
    }
    return CUDA_SUCCESS;
}

Driver::Driver() {
    the = this;
    DriverApi& api = base.api;
    api.cuDeviceGetAttribute = [](int* value, CUdevice_attribute which, CUdevice) {
        *value = which == CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR ? the->compute_major
                 : which == CU_DEVICE_ATTRIBUTE_CAN_USE_64_BIT_STREAM_MEM_OPS
                     ? the->has_64_bit_writes
                     : 100;
        return CUDA_SUCCESS;
    };
    api.cuFuncGetAttribute = [](int* value, CUfunction_attribute which, CUfunction) {
        CHECK(which == CU_FUNC_ATTRIBUTE_PTX_VERSION);
        *value = the->ptx_version;
        return CUDA_SUCCESS;
    };
    api.cuLaunchKernelEx = [](const CUlaunchConfig* c, CUfunction, void** p, void**) {
        ++the->num_launches;
        the->num_attributes = c->numAttrs;
        if (c->numAttrs > 1) {
            CHECK(c->attrs[1].id == CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION);
            CHECK(c->attrs[1].value.programmaticStreamSerializationAllowed == 1);
            if (the->overlap_result != CUDA_SUCCESS) return the->overlap_result;
        }
        the->base.marks.push_back({*static_cast<ug_mark_line**>(p[0]),
                                   *static_cast<std::uint64_t*>(p[1]),
                                   static_cast<std::uint16_t>(*static_cast<std::uint64_t*>(p[2])),
                                   c->hStream, c->attrs[0].value.priority});
        return CUDA_SUCCESS;
    };
    api.cuStreamBatchMemOp_v2 = api.cuStreamBatchMemOp_v2_ptsz = batch;
    api.cuEventCreate = [](CUevent* event, unsigned flags) {
        CHECK(flags == CU_EVENT_DISABLE_TIMING);
        CHECK(the->mode == CU_STREAM_CAPTURE_MODE_RELAXED);
        *event = reinterpret_cast<CUevent>(++the->num_events);
        return the->create_result;
    };
    api.cuEventRecord = api.cuEventRecord_ptsz = record_event;
    api.cuEventQuery = [](CUevent event) {
        ++the->num_queries;
        if (the->mode != CU_STREAM_CAPTURE_MODE_RELAXED || the->current != the->base.context)
            the->asked_unsafely = true;
        if (the->on_query) the->on_query();
        if (the->lost != CUDA_SUCCESS) return the->lost;
        return the->complete.at(event) ? CUDA_SUCCESS : CUDA_ERROR_NOT_READY;
    };
    api.cuCtxSetCurrent = [](CUcontext context) {
        the->current = context;
        return CUDA_SUCCESS;
    };
    api.cuThreadExchangeStreamCaptureMode = [](CUstreamCaptureMode* exchanged) {
        std::swap(*exchanged, the->mode);
        return CUDA_SUCCESS;
    };
}

constexpr int kTask = 3;
const CUstream kStream = reinterpret_cast<CUstream>(0xa0);

struct Fixture {
    Driver driver;
    HandPoller poller;
    std::unique_ptr<ProgressMarks> marks;
    const MarkContext* context = nullptr;
    std::uint32_t sequence = 0;

    void prepare(ProgressSource source) {
        marks = std::make_unique<ProgressMarks>(driver.base.api, source, &poller);
        context = marks->prepare();
        REQUIRE(context != nullptr);
    }
    CUresult emit(bool may_overlap = true) {
        const std::uint32_t next = sequence + 1;
        const CUresult result = marks->emit(
            *context,
            {kTask, ug_mark_word0(7, 9, next), next, kStream, StreamFlavor::kLegacy, may_overlap});
        if (result == CUDA_SUCCESS) sequence = next;
        return result;
    }
    ug_mark_line& line() { return context->lines[kTask]; }
    std::uint32_t done() { return model::read_marks_done(line(), sequence, 12345); }
    void complete(std::size_t record) { driver.complete[driver.order.at(record)] = true; }
};

/// Events of one line, looked at when the test says so, in virtual time.
struct EventFixture {
    Driver driver;
    HandPoller poller;
    HookedClock clock;
    EventMarks& marks = *new EventMarks(driver.base.api, poller);  // never destroyed
    std::vector<ug_mark_line> lines{abi::kMaxTasks};
    EventContext& context;
    std::uint32_t sequence = 0;

    EventFixture() : context(*marks.add(driver.base.context, 0, lines.data())) {}
    CUresult record(bool is_watched = true) {
        ++sequence;
        return marks.record(context, {.task = kTask,
                                      .word0 = ug_mark_word0(0, 0, sequence),
                                      .sequence = sequence,
                                      .stream = kStream,
                                      .time = clock.now(),
                                      .is_watched = is_watched});
    }
    More look() { return marks.poll(clock); }
    ug_mark_line& line() { return lines[kTask]; }
    std::chrono::nanoseconds stamp() {
        return std::chrono::nanoseconds(static_cast<std::int64_t>(line().word[1] >> 16));
    }
};

}  // namespace

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
    f.resolved.config.scheduler.progress_source = ProgressSource::kMemop;
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

TEST_CASE("Events are published in order, with the host's time, once they are complete",
          "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    CHECK(f.poller.num_starts == 1);
    CHECK(f.line().clock == UG_MARK_CLOCK_HOST);
    CHECK_FALSE(f.poller.look());
    CHECK(f.driver.num_queries == 0);
    for (int i = 0; i < 3; ++i) CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.poller.num_wakes == 3);
    CHECK(f.driver.num_launches == 0);
    CHECK(f.poller.look());
    CHECK(f.done() == 0);
    f.complete(1);  // of another stream, say: it does not vouch for the first
    CHECK(f.poller.look());
    CHECK(f.done() == 0);
    f.complete(0);
    const auto before = static_cast<std::uint64_t>(monotonic_now().count());
    CHECK(f.poller.look());
    CHECK(f.done() == 2);
    const std::uint64_t age = ((f.line().word[1] >> 16) - before) & 0xffff'ffff'ffff;
    CHECK(age < 10'000'000'000);
    CHECK(f.line().word[0] == ug_mark_word0(7, 9, 2));
    CHECK(f.driver.current == f.driver.base.context);
    f.complete(2);
    CHECK_FALSE(f.poller.look());
    CHECK(f.done() == 3);
    CHECK(f.driver.current == nullptr);  // nothing is held on to
    CHECK_FALSE(f.driver.asked_unsafely);
    CHECK(f.driver.mode == CU_STREAM_CAPTURE_MODE_GLOBAL);
}

TEST_CASE("An event's time lies between the looks that it came between", "[exec][marks][event]") {
    EventFixture f;
    SECTION("of three, the last came after three quarters of the time") {
        for (int i = 0; i < 4; ++i) f.record();
        CHECK(f.look() == More::kSoon);
        CHECK(f.line().looked_ns == static_cast<std::uint64_t>(f.clock.now().count()));
        const auto first_look = f.clock.now();
        f.clock.advance(40us);
        for (std::size_t i = 0; i < 3; ++i) f.driver.complete[f.driver.order[i]] = true;
        CHECK(f.look() == More::kSoon);
        CHECK(f.line().word[0] == ug_mark_word0(0, 0, 3));
        CHECK(f.stamp() == first_look + 30us);
        CHECK(f.line().looked_ns == static_cast<std::uint64_t>(f.clock.now().count()));
    }
    SECTION("not before it was recorded") {
        f.record();
        f.driver.complete[f.driver.order[0]] = true;
        f.clock.advance(40us);
        CHECK(f.look() == More::kNone);
        f.clock.advance(10ms);
        const auto recorded = f.clock.now();
        f.record();
        f.clock.advance(30us);
        f.driver.complete[f.driver.order[1]] = true;
        CHECK(f.look() == More::kNone);
        CHECK(f.stamp() == recorded + 15us);
    }
}

TEST_CASE("Poller that loses its turn behind a question says when it asked",
          "[exec][marks][event]") {
    EventFixture f;
    f.record();
    const auto asked = f.clock.now();
    f.driver.on_query = [&] { f.clock.advance(4ms); };
    CHECK(f.look() == More::kSoon);
    CHECK(f.line().looked_ns == static_cast<std::uint64_t>(asked.count()));
    f.driver.on_query = nullptr;
    f.driver.complete[f.driver.order[0]] = true;
    f.clock.advance(2us);
    CHECK(f.look() == More::kNone);
    CHECK(f.stamp() == f.clock.now() - 100us);  // not too long ago: who knows
}

TEST_CASE("Poller is told whether anybody wants to know soon", "[exec][marks][event]") {
    EventFixture f;
    CHECK(f.look() == More::kNone);
    f.record(false);
    CHECK(f.look() == More::kLater);
    f.record(true);
    CHECK(f.look() == More::kSoon);
    f.record(false);  // the newest counts
    CHECK(f.look() == More::kLater);
    f.marks.watch();  // somebody has come, and waits for what is there
    CHECK(f.look() == More::kSoon);
    for (const CUevent event : f.driver.order) f.driver.complete[event] = true;
    CHECK(f.look() == More::kNone);
}

TEST_CASE("Full ring of events takes no mark, and is used again when it has emptied",
          "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    for (std::uint32_t i = 0; i < EventContext::kRing; ++i) REQUIRE(f.emit() == CUDA_SUCCESS);
    CHECK(f.emit() == CUDA_ERROR_NOT_READY);
    CHECK(f.driver.order.size() == EventContext::kRing);
    CHECK(f.driver.num_events == EventContext::kRing);
    f.complete(0);
    CHECK(f.poller.look());
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.order.back() == f.driver.order.front());
    for (std::size_t i = 1; i < f.driver.order.size(); ++i) f.complete(i);
    CHECK_FALSE(f.poller.look());
    CHECK(f.done() == EventContext::kRing + 1);
    CHECK(f.driver.num_launches == 0);
}

TEST_CASE("Kernels mark instead, once and for all, when events cannot be had",
          "[exec][marks][event]") {
    Fixture f;
    SECTION("no thread") {
        f.poller.starts = false;
    }
    SECTION("no events") {
        f.driver.create_result = CUDA_ERROR_OUT_OF_MEMORY;
    }
    SECTION("a record is refused") {
        f.driver.record_result = CUDA_ERROR_INVALID_HANDLE;
    }
    SECTION("the driver cannot ask") {
        f.driver.base.api.cuEventQuery = nullptr;
    }
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    f.driver.record_result = CUDA_SUCCESS;
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.order.empty());
    CHECK(f.line().clock == UG_MARK_CLOCK_GPU);
    f.driver.base.execute_marks(2);
    CHECK(f.done() == 2);
    if (f.poller.look_ && f.poller.starts) CHECK_FALSE(f.poller.look());
    CHECK(f.driver.num_queries == 0);
}

TEST_CASE("Events of a lost context are asked for once", "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    f.driver.lost = CUDA_ERROR_ILLEGAL_ADDRESS;
    CHECK_FALSE(f.poller.look());
    CHECK_FALSE(f.poller.look());
    CHECK(f.driver.num_queries == 1);
    CHECK(f.done() == 0);
    CHECK(f.emit() == CUDA_SUCCESS);  // as far as this driver knows
    CHECK(f.driver.num_launches == 1);
}

TEST_CASE("Kernels mark instead when the poller has stopped", "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    f.poller.stopped = true;
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.num_launches == 1);
    f.driver.base.execute_marks(1);
    CHECK(f.done() == 2);
}

TEST_CASE("Events are not touched when their context goes", "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.poller.look());
    CHECK(f.driver.num_queries == 1);
    bool goes = true;
    SECTION("by its handle") {
        f.marks->context_ends({f.driver.base.context, -1});
    }
    SECTION("with its device") {
        f.marks->context_ends({nullptr, 0});
    }
    SECTION("perhaps") {
        f.marks->context_ends({});
    }
    SECTION("not: another goes") {
        goes = false;
        f.marks->context_ends({reinterpret_cast<CUcontext>(0x43), -1});
        f.marks->context_ends({nullptr, 1});
    }
    CHECK(f.poller.look() == !goes);
    CHECK(f.driver.num_queries == (goes ? 1 : 2));
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.num_launches == (goes ? 1 : 0));
}

TEST_CASE("Poller's current context is set anew when another has come by its handle",
          "[exec][marks][event]") {
    Fixture f;
    static unsigned long long id = 0;
    f.driver.base.api.cuCtxGetId = [](CUcontext, unsigned long long* found) {
        *found = id;
        return CUDA_SUCCESS;
    };
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.poller.look());
    CHECK(f.driver.current == f.driver.base.context);
    f.marks->context_ends({});
    f.driver.current = reinterpret_cast<CUcontext>(0xdead);
    const MarkContext* gone = f.context;
    ++id;
    f.context = f.marks->prepare();
    REQUIRE(f.context != gone);
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.poller.look());
    CHECK_FALSE(f.driver.asked_unsafely);
    CHECK(f.driver.num_launches == 0);
    f.marks->context_ends({});
    CHECK_FALSE(f.poller.look());
    CHECK(f.driver.current == nullptr);  // a thread of ours keeps none that has gone
}

TEST_CASE("Poller's thread looks while there is something to see, sleeps and is woken",
          "[exec][event]") {
    // Never destroyed, as in a program.
    struct Shared {
        std::atomic<int> work{0};
        std::atomic<int> looks{0};
        PollerThread poller;
    };
    Shared& shared = *new Shared;
    REQUIRE(shared.poller.start([&shared] {
        ++shared.looks;
        int work = shared.work;
        if (work > 0) shared.work = work - 1;
        return work > 1 ? More::kSoon : More::kNone;
    }));
    const auto reaches = [&](const auto& state) {
        const auto until = monotonic_now() + 10s;
        while (!state() && monotonic_now() < until) std::this_thread::yield();
        return state();
    };
    for (int round = 0; round < 50; ++round) {
        shared.work = 3;
        shared.poller.wake();
        REQUIRE(reaches([&] { return shared.work == 0; }));
        if (round % 10 != 0) continue;
        // With nothing to see it stops looking.
        int looks = -1;
        REQUIRE(reaches([&] {
            const int last = looks;
            looks = shared.looks;
            SteadyClock().sleep_for(5ms);
            return last == shared.looks;
        }));
    }
}
