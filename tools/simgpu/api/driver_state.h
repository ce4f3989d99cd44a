// SPDX-License-Identifier: Apache-2.0
//
// What the driver API's functions share: the objects behind the handles, the one Driver, the
// calling thread's current context. Every exported function is defined with SIMGPU_API in the file
// of its topic; inside the library they may call each other (they are bound to themselves at link
// time).
#pragma once

#include "tools/simgpu/api/entry_names.h"

#include <cuda.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "tools/simgpu/api/handle_table.h"
#include "tools/simgpu/engine/cost_table.h"
#include "tools/simgpu/engine/gpu_thread.h"
#include "tools/simgpu/engine/kernel_log.h"
#include "tools/simgpu/engine/native_kernels.h"
#include "tools/simgpu/image/image.h"
#include "tools/simgpu/memory/mem_pool.h"
#include "tools/simgpu/memory/memory_map.h"

#define SIMGPU_API extern "C" __attribute__((visibility("default")))

namespace urgengo::simgpu {

inline constexpr int kLeastPriority = 0;
inline constexpr int kGreatestPriority = -5;

struct Context;
struct Capture;
struct Graph;
struct GraphExec;
struct GraphNode;
class KernelFailures;

struct Stream {
    Context* context;
    unsigned flags;
    std::shared_ptr<StreamQueue> queue;
    std::atomic<int> priority;
    std::mutex attributes_mutex;
    std::map<CUstreamAttrID, CUstreamAttrValue> attributes;  ///< those that are only kept

    std::atomic<bool> capturing{false};
    std::shared_ptr<Capture> capture;       ///< this and the next are behind capture.cpp's lock
    std::vector<CUgraphNode> capture_tail;  ///< what the next node depends on
};

struct Event {
    Context* context;
    unsigned flags;
    std::mutex mutex;
    Fence fence;  ///< of the last record; no queue: never recorded
    std::shared_ptr<std::atomic<std::int64_t>> time;  ///< when that completed, ns

    std::shared_ptr<Capture> capture;   ///< of the last record, if it was in one; capture.cpp's
    std::vector<CUgraphNode> captured;  ///< what a stream that waits for it depends on
};

/// A CUfunction; also a CUkernel, which may be passed wherever a CUfunction may.
struct Function {
    std::shared_ptr<const std::string> name;
    Context* context = nullptr;  ///< null for a kernel: it runs in the stream's context
    CUmodule module = nullptr;
    CUlibrary library = nullptr;
    std::shared_ptr<const Image> image;     ///< null if it is a cost table
    const KernelImage* in_image = nullptr;  ///< null if the image does not say
    KernelCost cost;
    const NativeKernel* native = nullptr;
    KernelFailures* failures = nullptr;  ///< usually none are asked for
    std::atomic<int> max_dynamic_shared_bytes{48 << 10};

    int blocks_per_sm(unsigned threads_per_block) const;
    /// @returns the size, and where in a buffer, of each parameter; empty if that is not known
    std::vector<std::size_t> param_sizes() const;
    std::vector<std::size_t> param_offsets() const;
};

struct Module {
    Context* context;
    std::shared_ptr<const CostTable> costs;  ///< null if the image brings none
    std::shared_ptr<const Image> image;      ///< null if it is a cost table
    std::mutex mutex;
    std::unordered_map<std::string, CUfunction> functions;
};

struct Library {
    std::shared_ptr<const CostTable> costs;
    std::shared_ptr<const Image> image;
    std::mutex mutex;
    std::unordered_map<std::string, CUkernel> kernels;
    std::map<std::pair<CUkernel, Context*>, CUfunction> functions;
};

struct MipmappedArray {
    Context* context;
    CUdeviceptr memory;
    std::vector<CUdeviceptr> levels;
};

/// Never deleted: a thread may have a destroyed context as its current one.
struct Context {
    std::uint64_t id;
    int device;
    Context* primary = nullptr;      ///< of a green context
    unsigned num_sms = 0;            ///< that it says it has
    std::atomic<unsigned> usage{1};  ///< cuCtxAttach, cuCtxDetach; of no meaning for a primary one
    std::atomic<unsigned> flags;
    /// Set when a kernel failed so that nothing works in the context any more: what all calls
    /// return.
    std::atomic<CUresult> broken{CUDA_SUCCESS};
    std::atomic<bool> destroyed{false};
    std::shared_ptr<Stream> legacy;
    std::mutex mutex;
    std::unordered_map<std::uint64_t, std::shared_ptr<Stream>> per_thread;  ///< by thread number
    std::map<CUlimit, std::size_t> limits{{CU_LIMIT_STACK_SIZE, 1024},
                                          {CU_LIMIT_PRINTF_FIFO_SIZE, 1 << 20},
                                          {CU_LIMIT_MALLOC_HEAP_SIZE, 8 << 20}};
    std::vector<std::shared_ptr<StreamQueue>> queues;  ///< of all streams that may have work

    /// Whose the memory, the modules and the events are: a green context's are the primary one's.
    const Context* owner() const { return primary != nullptr ? primary : this; }
    Context* owner() { return primary != nullptr ? primary : this; }
};

/// The process-wide state. Created by the first call, never destroyed.
struct Driver {
    Driver();

    int version;  ///< as cuDriverGetVersion gives it
    Part part;
    CostTable file_costs;  ///< SIMGPU_COSTS
    KernelLog kernel_log;
    bool wants_zero_cost = false;  ///< SIMGPU_ZERO_COST; in force from cuInit on: zero_cost.h
    GpuThread* gpu = nullptr;      ///< set by cuInit, unless zero cost is asked for
    std::atomic<bool> initialised{false};
    std::atomic<std::uint64_t> next_id{1};

    HandleTable<CUcontext, Context> contexts;
    HandleTable<CUstream, Stream> streams;
    HandleTable<CUevent, Event> events;
    HandleTable<CUmodule, Module> modules;
    HandleTable<CUfunction, Function> functions;  ///< kernels too, by the same address
    HandleTable<CUlibrary, Library> libraries;
    HandleTable<CUmipmappedArray, MipmappedArray> mipmapped_arrays;
    HandleTable<CUgraph, Graph> graphs;
    HandleTable<CUgraphNode, GraphNode> graph_nodes;
    HandleTable<CUgraphExec, GraphExec> graph_execs;
    bool launch_blocking = false;  ///< CUDA_LAUNCH_BLOCKING
    MemoryMap memory;
    HandleTable<CUmemoryPool, MemPool> pools;
    /// Of each device.
    std::array<CUmemoryPool, Part::kMostInMachine> default_pools{};
    std::array<std::atomic<CUmemoryPool>, Part::kMostInMachine> current_pools{};
};

Driver& driver();

/// @returns CUDA_ERROR_NOT_INITIALIZED before cuInit, and in a forked child
CUresult require_init();

/// @returns CUDA_ERROR_INVALID_DEVICE too, if there is no such device
CUresult require_device(CUdevice device);

/// Finds the calling thread's current context.
/// @returns why nothing can be done in it, if so: destroyed, or broken
CUresult current_context(Context*& context);

/// Finds the stream behind a handle: NULL and CU_STREAM_LEGACY are the current context's legacy
/// stream, CU_STREAM_PER_THREAD the calling thread's own.
CUresult resolve_stream(CUstream handle, std::shared_ptr<Stream>& stream);

/// As resolve_stream(), for what is to be queued there.
/// @returns why that cannot be, if a capture forbids it
CUresult resolve_stream_for_work(CUstream handle, std::shared_ptr<Stream>& stream);

std::shared_ptr<Stream> make_stream(Context& context, StreamQueue::Kind kind, unsigned flags,
                                    int priority);

std::shared_ptr<Context> make_context(unsigned flags, CUdevice device);

/// Waits for the context's work, then takes away all that belongs to it.
void tear_down(Context& context);

/// Submits to the stream, or, while it captures, adds a node to the graph.
/// @returns the fence that passes when the work has completed; one that has passed for a node
Fence submit(Stream& stream, Work work, std::vector<Fence> fences = {});

/// Submits to a stream, or to one that is the library's own.
Fence submit_to(const std::shared_ptr<StreamQueue>& queue, Work work, std::vector<Fence> fences);

/// What the driver does at every synchronisation: pools give back what they need not keep.
void trim_pools();

/// Waits until all that was submitted to the context's streams has completed.
void synchronize(Context& context);

int clamp_priority(int priority);

/// What NULL means in a function of the per-thread default stream's flavour.
inline CUstream per_thread_if_null(CUstream stream) {
    return stream == nullptr ? CU_STREAM_PER_THREAD : stream;
}

/// One line on stderr, for what a return code cannot say.
void complain(const std::string& message);

}  // namespace urgengo::simgpu
