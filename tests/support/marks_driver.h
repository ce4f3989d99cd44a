// SPDX-License-Identifier: Apache-2.0
//
// A driver that takes marks, and looks when the test says so.
#pragma once

#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "host/exec/progress_marks.h"
#include "host/model/slot_view.h"
#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"
#include "tests/support/runtime_fixture.h"

namespace urgengo::testing::marks {

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;
using config::ProgressSource;
using namespace std::chrono_literals;

/// Looks when the test says so.
class HandPoller final : public Poller {
  public:
    bool start(std::function<More()> l, std::function<void()>) override {
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
    inline static Driver* the = nullptr;
};
inline CUresult record_event(CUevent event, CUstream) {
    Driver& d = *Driver::the;
    if (d.record_result != CUDA_SUCCESS) return d.record_result;
    ++d.recorded[event];
    d.complete[event] = false;
    d.order.push_back(event);
    return CUDA_SUCCESS;
}

inline CUresult batch(CUstream, unsigned count, CUstreamBatchMemOpParams* ops, unsigned flags) {
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

inline Driver::Driver() {
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
                                   c->hStream, c->attrs[0].value.priority, c->blockDimX});
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

inline constexpr int kTask = 3;
inline const CUstream kStream = reinterpret_cast<CUstream>(0xa0);

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

}  // namespace urgengo::testing::marks
