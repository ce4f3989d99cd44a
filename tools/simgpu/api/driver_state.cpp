// SPDX-License-Identifier: Apache-2.0
//
// The Driver, and the ways from a handle to what is behind it.
#include "tools/simgpu/api/driver_state.h"

#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "tools/simgpu/api/context_stack.h"
#include "tools/simgpu/api/driver_version.h"
#include "tools/simgpu/api/environment.h"
#include "tools/simgpu/engine/zero_cost.h"
#include "tools/simgpu/graph/capture.h"

namespace urgengo::simgpu {
namespace {

std::atomic<bool> g_forked{false};

/// Per-thread default streams are kept by number: thread ids are reused, these are not.
std::uint64_t thread_number() {
    static std::atomic<std::uint64_t> last{0};
    thread_local const std::uint64_t number = ++last;
    return number;
}

CostTable read_costs_file() {
    const char* path = std::getenv("SIMGPU_COSTS");
    if (path == nullptr || *path == '\0') return {};
    std::ifstream file(path);
    if (!file) {
        complain(fmt::format("SIMGPU_COSTS: cannot read '{}'; using the default costs", path));
        return {};
    }
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    auto table = CostTable::parse(text, path);
    if (!table) {
        complain(fmt::format("SIMGPU_COSTS: {}; using the default costs", table.error()));
        return {};
    }
    return std::move(*table);
}

}  // namespace

Driver::Driver() {
    std::vector<std::string> problems;
    version = read_driver_version(problems);
    part = read_part(problems);
    if (part.integrated) memory.share_with_host();
    wants_zero_cost = read_choice("SIMGPU_ZERO_COST", {"0", "1"}, 0, problems) == 1;
    // As the driver reads it: any value but 0.
    const char* const blocking = std::getenv("CUDA_LAUNCH_BLOCKING");
    launch_blocking = blocking != nullptr && std::atoi(blocking) != 0;
    for (const std::string& problem : problems) complain(problem);
    file_costs = read_costs_file();
    for (int device = 0; device < part.num_in_machine; ++device) {
        const auto i = static_cast<std::size_t>(device);
        default_pools[i] =
            pools.add(std::make_shared<MemPool>(memory, device, part.memory_bytes, 0));
        current_pools[i] = default_pools[i];
    }
    // The engine's thread does not exist in a forked child: calls there fail as the driver's do,
    // instead of waiting for it.
    pthread_atfork(nullptr, nullptr, [] {
        g_forked = true;
        set_zero_cost(false);
    });
}

Driver& driver() {
    static Driver* const instance = new Driver;
    return *instance;
}

CUresult require_init() {
    const bool usable = driver().initialised.load(std::memory_order_acquire) && !g_forked;
    return usable ? CUDA_SUCCESS : CUDA_ERROR_NOT_INITIALIZED;
}

CUresult require_device(CUdevice device) {
    if (CUresult error = require_init()) return error;
    const bool is_there = device >= 0 && device < driver().part.num_in_machine;
    return is_there ? CUDA_SUCCESS : CUDA_ERROR_INVALID_DEVICE;
}

CUresult current_context(Context*& context) {
    if (CUresult error = require_init()) return error;
    context = ContextStack::of_this_thread().top();
    if (context == nullptr) return CUDA_ERROR_INVALID_CONTEXT;
    return context->destroyed ? CUDA_ERROR_CONTEXT_IS_DESTROYED : context->broken.load();
}

CUresult resolve_stream(CUstream handle, std::shared_ptr<Stream>& stream) {
    const bool is_default =
        handle == nullptr || handle == CU_STREAM_LEGACY || handle == CU_STREAM_PER_THREAD;
    if (!is_default) {
        if (CUresult error = require_init()) return error;
        stream = driver().streams.find(handle);
        return stream ? stream->context->broken.load() : CUDA_ERROR_INVALID_HANDLE;
    }
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (handle != CU_STREAM_PER_THREAD) {
        stream = context->legacy;
        return CUDA_SUCCESS;
    }
    const std::uint64_t number = thread_number();
    {
        std::lock_guard lock(context->mutex);
        const auto it = context->per_thread.find(number);
        if (it != context->per_thread.end()) {
            stream = it->second;
            return CUDA_SUCCESS;
        }
    }
    // No other thread has this number, so none makes the same stream meanwhile.
    stream = make_stream(*context, StreamQueue::Kind::kBlocking, CU_STREAM_DEFAULT, 0);
    std::lock_guard lock(context->mutex);
    context->per_thread.emplace(number, stream);
    return CUDA_SUCCESS;
}

std::shared_ptr<Stream> make_stream(Context& context, StreamQueue::Kind kind, unsigned flags,
                                    int priority) {
    auto stream = std::make_shared<Stream>();
    stream->context = &context;
    stream->flags = flags;
    stream->queue =
        std::make_shared<StreamQueue>(driver().next_id++, kind, context.id, context.device);
    stream->priority = clamp_priority(priority);

    std::lock_guard lock(context.mutex);
    // Streams that were destroyed while they had work stay listed until it is done.
    auto& queues = context.queues;
    queues.erase(std::remove_if(queues.begin(), queues.end(),
                                [](const auto& queue) { return queue.use_count() == 1; }),
                 queues.end());
    queues.push_back(stream->queue);
    return stream;
}

CUresult resolve_stream_for_work(CUstream handle, std::shared_ptr<Stream>& stream) {
    if (CUresult error = resolve_stream(handle, stream)) return error;
    return check_capture(*stream);
}

Fence submit(Stream& stream, Work work, std::vector<Fence> fences) {
    if (is_capturing(stream)) {
        capture_work(stream, std::move(work));
        return {};
    }
    return submit_to(stream.queue, std::move(work), std::move(fences));
}

Fence submit_to(const std::shared_ptr<StreamQueue>& queue, Work work, std::vector<Fence> fences) {
    if (zero_cost()) return run_at_no_cost(work);
    return driver().gpu->submit(queue, std::move(work), std::move(fences));
}

void synchronize(Context& context) {
    if (zero_cost()) return;
    std::vector<std::shared_ptr<StreamQueue>> queues;
    const auto take_queues = [&queues](Context& from) {
        std::lock_guard lock(from.mutex);
        queues.insert(queues.end(), from.queues.begin(), from.queues.end());
    };
    take_queues(context);
    // A wait for the primary context waits for the green ones too (cuda.h).
    driver().contexts.for_each([&](Context& other) {
        if (other.primary == &context) take_queues(other);
    });
    std::vector<Fence> fences;
    for (const auto& queue : queues) fences.push_back(driver().gpu->tail(queue));
    for (const Fence& fence : fences) fence.wait();
    trim_pools();
}

void trim_pools() {
    driver().pools.for_each([](MemPool& pool) { pool.trim(); });
}

int clamp_priority(int priority) {
    return std::clamp(priority, kGreatestPriority, kLeastPriority);
}

int Function::blocks_per_sm(unsigned threads_per_block) const {
    if (cost.blocks_per_sm > 0) return cost.blocks_per_sm;
    const Part& part = driver().part;
    const int by_threads = part.threads_per_sm / static_cast<int>(std::max(threads_per_block, 1U));
    return std::clamp(by_threads, 1, part.blocks_per_sm);
}

std::vector<std::size_t> Function::param_sizes() const {
    if (native != nullptr) return {native->param_bytes.begin(), native->param_bytes.end()};
    return in_image != nullptr ? in_image->param_bytes : cost.param_bytes;
}

std::vector<std::size_t> Function::param_offsets() const {
    const bool said = native == nullptr && in_image != nullptr;
    return said ? in_image->param_offsets : layout_params(param_sizes());
}

void complain(const std::string& message) {
    std::fprintf(stderr, "simgpu: %s\n", message.c_str());
}

}  // namespace urgengo::simgpu
