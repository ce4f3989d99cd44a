// SPDX-License-Identifier: Apache-2.0
//
// A driver for unit tests in virtual time: one context, marks that execute when the test says so.
// One at a time: the driver's functions carry no state of their own.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <vector>

#include "host/base/clock.h"
#include "host/exec/driver_api.h"
#include "urgengo/abi/device_mailbox.h"

namespace urgengo::testing {

struct GraphNode {
    CUfunction function;
    unsigned grid, block;
};

struct PendingMark {
    ug_mark_line* line;
    std::uint64_t word0;
    std::uint16_t tag;
    CUstream stream;
    int priority;
    unsigned threads;

    /// @returns whether it is of a branch of a fork, and vouches for that alone
    bool is_of_branch() const {
        return reinterpret_cast<std::uintptr_t>(line) % sizeof(ug_mark_line) != 0;
    }
};

class FakeDriver {
  public:
    FakeDriver() {
        current_ = this;
        api.cuCtxGetCurrent = [](CUcontext* c) {
            *c = current_->context;
            return CUDA_SUCCESS;
        };
        api.cuCtxGetId = [](CUcontext c, unsigned long long* id) {
            *id = reinterpret_cast<unsigned long long>(c);
            return CUDA_SUCCESS;
        };
        api.cuCtxGetDevice = [](CUdevice* d) {
            *d = current_->device;
            return CUDA_SUCCESS;
        };
        api.cuDeviceGetAttribute = [](int* value, CUdevice_attribute a, CUdevice) {
            *value = a == CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT ? 10 : 1000;
            return CUDA_SUCCESS;
        };
        api.cuCtxGetStreamPriorityRange = [](int* least, int* greatest) {
            *least = 0;
            *greatest = -5;
            return CUDA_SUCCESS;
        };
        api.cuMemHostRegister_v2 = [](void*, size_t, unsigned) { return current_->set_up_result; };
        api.cuMemHostGetDevicePointer_v2 = [](CUdeviceptr* d, void* h, unsigned) {
            *d = reinterpret_cast<CUdeviceptr>(h);
            return CUDA_SUCCESS;
        };
        api.cuModuleLoadData = [](CUmodule*, const void*) { return CUDA_SUCCESS; };
        api.cuModuleGetFunction = [](CUfunction* f, CUmodule, const char*) {
            *f = reinterpret_cast<CUfunction>(0x1000);
            return CUDA_SUCCESS;
        };
        api.cuFuncGetName = [](const char** name, CUfunction f) {
            ++current_->num_name_queries;
            if (current_->on_name_query) current_->on_name_query();
            *name = current_->names[f];
            return CUDA_SUCCESS;
        };
        api.cuStreamIsCapturing = [](CUstream s, CUstreamCaptureStatus* status) {
            ++current_->num_capture_queries;
            *status = s == current_->capturing ? CU_STREAM_CAPTURE_STATUS_ACTIVE
                                               : CU_STREAM_CAPTURE_STATUS_NONE;
            return CUDA_SUCCESS;
        };
        api.cuStreamGetPriority = [](CUstream, int* priority) {
            *priority = current_->own_priority;
            return CUDA_SUCCESS;
        };
        api.cuStreamQuery = [](CUstream) {
            ++current_->num_queries;
            return current_->is_over() ? CUDA_SUCCESS : CUDA_ERROR_NOT_READY;
        };
        api.cuStreamQuery_ptsz = api.cuStreamQuery;
        api.cuGraphGetNodes = [](CUgraph, CUgraphNode* found, size_t* count) {
            ++current_->num_graph_queries;
            for (std::size_t i = 0; found && i < current_->nodes.size(); ++i)
                found[i] = reinterpret_cast<CUgraphNode>(&current_->nodes[i]);
            *count = current_->nodes.size();
            return CUDA_SUCCESS;
        };
        api.cuGraphNodeGetType = [](CUgraphNode, CUgraphNodeType* type) {
            *type = CU_GRAPH_NODE_TYPE_KERNEL;
            return CUDA_SUCCESS;
        };
        api.cuGraphKernelNodeGetParams_v2 = [](CUgraphNode n, CUDA_KERNEL_NODE_PARAMS* p) {
            const auto& node = *reinterpret_cast<const GraphNode*>(n);
            *p = {};
            p->func = node.function;
            p->gridDimX = node.grid, p->gridDimY = p->gridDimZ = 1;
            p->blockDimX = node.block, p->blockDimY = p->blockDimZ = 1;
            return CUDA_SUCCESS;
        };
        api.cuLaunchKernelEx = [](const CUlaunchConfig* c, CUfunction, void** p, void**) {
            if (current_->launch_result != CUDA_SUCCESS) return current_->launch_result;
            current_->marks.push_back(
                {*static_cast<ug_mark_line**>(p[0]), *static_cast<std::uint64_t*>(p[1]),
                 static_cast<std::uint16_t>(*static_cast<std::uint64_t*>(p[2])), c->hStream,
                 c->attrs[0].value.priority, c->blockDimX});
            return CUDA_SUCCESS;
        };
        api.cuLaunchKernelEx_ptsz = api.cuLaunchKernelEx;
    }
    ~FakeDriver() { current_ = nullptr; }

    /// The GPU reaches the oldest `count` marks.
    void execute_marks(std::size_t count) {
        for (; count > 0 && !marks.empty(); --count) {
            const PendingMark m = marks.front();
            marks.pop_front();
            m.line->word[0] = m.word0;
            m.line->word[1] = ug_mark_word1(gpu_time_ns, m.tag);
        }
    }

    exec::DriverApi api;
    CUcontext context = reinterpret_cast<CUcontext>(0x42);
    CUstream capturing = nullptr;
    CUdevice device = 0;
    CUresult set_up_result = CUDA_SUCCESS;
    CUresult launch_result = CUDA_SUCCESS;
    std::map<CUfunction, const char*> names;
    int num_name_queries = 0;
    std::function<void()> on_name_query;  ///< in the middle of one
    int own_priority = 0;                 ///< of every stream
    int num_queries = 0;
    int num_capture_queries = 0;
    std::function<bool()> is_over = [] { return false; };  ///< what is asked about
    std::vector<GraphNode> nodes;                          ///< of every graph
    int num_graph_queries = 0;
    std::deque<PendingMark> marks;    ///< launched, not executed
    std::uint64_t gpu_time_ns = 777;  ///< what marks write; 0: no time

  private:
    inline static FakeDriver* current_ = nullptr;
};

/// A virtual clock that lets the test do something whenever a held thread sleeps.
class HookedClock final : public Clock {
  public:
    nanoseconds now() override { return now_; }
    void sleep_for(nanoseconds duration) override {
        now_ += duration;
        ++num_sleeps;
        if (on_sleep) on_sleep();
    }
    void advance(nanoseconds duration) { now_ += duration; }
    /// The thread computes, unless it is told to sleep.
    ThreadUse thread_use() override { return {now_ - slept_, sleeps_}; }
    /// The thread sleeps, neither held nor in a call of the driver's.
    void sleep_outside(nanoseconds duration) {
        now_ += duration;
        slept_ += duration;
        ++sleeps_;
    }
    /// Another one has its core.
    void lose_core(nanoseconds duration) {
        now_ += duration;
        slept_ += duration;
    }

    std::function<void()> on_sleep;
    int num_sleeps = 0;

  private:
    nanoseconds now_{1'000'000'000};
    nanoseconds slept_{0};
    std::int64_t sleeps_ = 0;
};

}  // namespace urgengo::testing
