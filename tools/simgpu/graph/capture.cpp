// SPDX-License-Identifier: Apache-2.0
//
// The captures that are under way.
#include "tools/simgpu/graph/capture.h"

#include <algorithm>

#include "tools/simgpu/graph/graph.h"

namespace urgengo::simgpu {
namespace {

std::mutex g_mutex;  ///< guards all that follows, and the capture fields of streams and events
std::vector<std::shared_ptr<Capture>> g_captures;
std::atomic<int> g_num_captures{0};
thread_local CUstreamCaptureMode t_mode = CU_STREAM_CAPTURE_MODE_GLOBAL;

bool none_under_way() {
    return g_num_captures.load(std::memory_order_acquire) == 0;
}

void join(const std::shared_ptr<Stream>& stream, const std::shared_ptr<Capture>& capture) {
    stream->capture = capture;
    stream->capture_tail.clear();
    stream->capturing = true;
    capture->streams.push_back(stream);
}

void add_to_tail(Stream& stream, const std::vector<CUgraphNode>& nodes) {
    auto& tail = stream.capture_tail;
    for (CUgraphNode node : nodes) {
        if (std::find(tail.begin(), tail.end(), node) == tail.end()) tail.push_back(node);
    }
}

/// All its streams are as if they had never captured.
void finish(const std::shared_ptr<Capture>& capture) {
    for (const auto& weak : capture->streams) {
        const auto stream = weak.lock();
        if (!stream || stream->capture != capture) continue;
        stream->capture = nullptr;
        stream->capture_tail.clear();
        stream->capturing = false;
    }
    std::erase(g_captures, capture);
    g_num_captures = static_cast<int>(g_captures.size());
}

void abandon(const std::shared_ptr<Capture>& capture) {
    capture->invalidated = true;
    if (!capture->is_programs) destroy_graph(capture->graph);
    finish(capture);
}

template <typename Which>
void abandon_if(Which&& which) {
    if (none_under_way()) return;
    std::lock_guard lock(g_mutex);
    const auto all = g_captures;
    for (const auto& capture : all) {
        if (which(*capture)) abandon(capture);
    }
}

/// Made in a thread that captures its own stream.
struct EndsWithThread {
    ~EndsWithThread() {
        abandon_if([me = std::this_thread::get_id()](const Capture& c) {
            return c.is_per_thread && c.thread == me;
        });
    }
};

bool is_per_thread(const std::shared_ptr<Stream>& stream) {
    std::lock_guard lock(stream->context->mutex);
    const auto& all = stream->context->per_thread;
    return std::any_of(all.begin(), all.end(),
                       [&stream](const auto& entry) { return entry.second == stream; });
}

/// @returns whether the origin's tail comes after every node
bool all_joined(const Graph& graph, const std::vector<CUgraphNode>& tail) {
    std::vector<CUgraphNode> leaves;
    for (const auto& node : graph.nodes)
        leaves.push_back(reinterpret_cast<CUgraphNode>(node.get()));
    for (const auto& node : graph.nodes) {
        for (CUgraphNode dependency : node->dependencies) std::erase(leaves, dependency);
    }
    return std::all_of(leaves.begin(), leaves.end(), [&tail](CUgraphNode leaf) {
        return std::find(tail.begin(), tail.end(), leaf) != tail.end();
    });
}

/// @returns the captures by streams that the legacy stream synchronises with
std::vector<std::shared_ptr<Capture>> captures_waited_for(const Stream& legacy) {
    std::vector<std::shared_ptr<Capture>> found;
    for (const auto& capture : g_captures) {
        const bool waits_for_it = std::any_of(
            capture->streams.begin(), capture->streams.end(), [&legacy](const auto& weak) {
                const auto stream = weak.lock();
                return stream && stream->context == legacy.context &&
                       stream->queue->kind == StreamQueue::Kind::kBlocking;
            });
        if (waits_for_it) found.push_back(capture);
    }
    return found;
}

bool prohibits(const Capture& capture) {
    if (t_mode == CU_STREAM_CAPTURE_MODE_RELAXED) return false;
    if (capture.thread == std::this_thread::get_id()) {
        return capture.mode != CU_STREAM_CAPTURE_MODE_RELAXED;
    }
    return t_mode == CU_STREAM_CAPTURE_MODE_GLOBAL && capture.mode == CU_STREAM_CAPTURE_MODE_GLOBAL;
}

}  // namespace

CUresult begin_capture(const std::shared_ptr<Stream>& stream, CUstreamCaptureMode mode,
                       CUgraph into, std::vector<CUgraphNode> after) {
    if (mode < CU_STREAM_CAPTURE_MODE_GLOBAL || mode > CU_STREAM_CAPTURE_MODE_RELAXED) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    if (stream->queue->kind == StreamQueue::Kind::kLegacy) {
        return CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED;
    }
    const bool of_thread = is_per_thread(stream);
    if (of_thread) thread_local EndsWithThread ends_with_thread;
    std::lock_guard lock(g_mutex);
    if (stream->capture) return CUDA_ERROR_ILLEGAL_STATE;
    auto capture = std::make_shared<Capture>(Capture{.id = driver().next_id++,
                                                     .mode = mode,
                                                     .thread = std::this_thread::get_id(),
                                                     .graph = into ? into : make_graph(),
                                                     .is_programs = into != nullptr,
                                                     .is_per_thread = of_thread,
                                                     .context = stream->context,
                                                     .origin = stream.get(),
                                                     .streams = {}});
    join(stream, capture);
    stream->capture_tail = std::move(after);
    g_captures.push_back(std::move(capture));
    ++g_num_captures;
    return CUDA_SUCCESS;
}

CUresult end_capture(Stream& stream, CUgraph* graph) {
    std::lock_guard lock(g_mutex);
    const auto capture = stream.capture;
    if (!capture) return CUDA_ERROR_ILLEGAL_STATE;
    if (capture->origin != &stream) return CUDA_ERROR_STREAM_CAPTURE_UNMATCHED;
    const bool wrong_thread = capture->mode != CU_STREAM_CAPTURE_MODE_RELAXED &&
                              capture->thread != std::this_thread::get_id();
    if (wrong_thread) return CUDA_ERROR_STREAM_CAPTURE_WRONG_THREAD;
    CUresult result = CUDA_SUCCESS;
    if (capture->invalidated) {
        result = CUDA_ERROR_STREAM_CAPTURE_INVALIDATED;
    } else if (!all_joined(*driver().graphs.find(capture->graph), stream.capture_tail)) {
        result = CUDA_ERROR_STREAM_CAPTURE_UNJOINED;
    }
    *graph = result == CUDA_SUCCESS ? capture->graph : nullptr;
    if (result != CUDA_SUCCESS && !capture->is_programs) destroy_graph(capture->graph);
    finish(capture);
    return result;
}

CUresult capture_info(Stream& stream, CaptureInfo& info) {
    info = {};
    if (none_under_way()) return CUDA_SUCCESS;
    std::lock_guard lock(g_mutex);
    if (stream.queue->kind == StreamQueue::Kind::kLegacy) {
        // Asking, unlike working, does not end the capture.
        return captures_waited_for(stream).empty() ? CUDA_SUCCESS
                                                   : CUDA_ERROR_STREAM_CAPTURE_IMPLICIT;
    }
    if (!stream.capture) return CUDA_SUCCESS;
    info.status = stream.capture->invalidated ? CU_STREAM_CAPTURE_STATUS_INVALIDATED
                                              : CU_STREAM_CAPTURE_STATUS_ACTIVE;
    info.id = stream.capture->id;
    info.graph = stream.capture->graph;
    info.dependencies = &stream.capture_tail;
    return CUDA_SUCCESS;
}

void abandon_capture(Stream& stream) {
    if (none_under_way()) return;
    std::lock_guard lock(g_mutex);
    const auto capture = stream.capture;
    if (!capture) return;
    capture->invalidated = true;
    if (capture->origin == &stream) abandon(capture);
}

void abandon_captures(const Context& context) {
    abandon_if([&context](const Capture& c) { return c.context == &context; });
}

CUresult check_capture(Stream& stream) {
    if (none_under_way()) return CUDA_SUCCESS;
    std::lock_guard lock(g_mutex);
    if (stream.capture) {
        return stream.capture->invalidated ? CUDA_ERROR_STREAM_CAPTURE_INVALIDATED : CUDA_SUCCESS;
    }
    if (stream.queue->kind != StreamQueue::Kind::kLegacy) return CUDA_SUCCESS;
    const auto waited_for = captures_waited_for(stream);
    for (const auto& capture : waited_for) capture->invalidated = true;
    return waited_for.empty() ? CUDA_SUCCESS : CUDA_ERROR_STREAM_CAPTURE_IMPLICIT;
}

CUresult require_safe_call() {
    if (none_under_way()) return CUDA_SUCCESS;
    std::lock_guard lock(g_mutex);
    CUresult result = CUDA_SUCCESS;
    for (const auto& capture : g_captures) {
        if (!prohibits(*capture)) continue;
        capture->invalidated = true;
        result = CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED;
    }
    return result;
}

CUresult require_no_capture(const Context& context) {
    if (none_under_way()) return CUDA_SUCCESS;
    std::lock_guard lock(g_mutex);
    CUresult result = CUDA_SUCCESS;
    for (const auto& capture : g_captures) {
        if (capture->context != &context) continue;
        capture->invalidated = true;
        result = CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED;
    }
    return result;
}

CUresult refuse_if_capturing(Stream& stream) {
    if (none_under_way()) return CUDA_SUCCESS;
    std::lock_guard lock(g_mutex);
    if (!stream.capture) return CUDA_SUCCESS;
    stream.capture->invalidated = true;
    return CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED;
}

bool is_capturing(const Stream& stream) {
    return stream.capturing.load(std::memory_order_acquire);
}

void capture_work(Stream& stream, Work work, std::shared_ptr<KernelCall> kernel) {
    GraphNode node;
    node.type = type_of(work);
    node.work = std::move(work);
    node.kernel = std::move(kernel);
    capture_node(stream, std::move(node));
}

void capture_node(Stream& stream, GraphNode node) {
    std::lock_guard lock(g_mutex);
    if (!stream.capture) return;  // another thread ended it meanwhile
    const CUgraph handle = stream.capture->graph;
    const auto graph = driver().graphs.find(handle);
    if (!graph) return;
    node.dependencies = stream.capture_tail;
    stream.capture_tail = {add_node(*graph, handle, std::move(node))};
}

void capture_event_record(Stream& stream, Event& event) {
    std::lock_guard lock(g_mutex);
    event.capture = stream.capture;
    event.captured = stream.capture_tail;
}

CUresult capture_event_wait(const std::shared_ptr<Stream>& stream, Event& event, bool& handled) {
    std::lock_guard lock(g_mutex);
    handled = stream->capture != nullptr || event.capture != nullptr;
    if (!handled) return CUDA_SUCCESS;
    const auto& theirs = event.capture;
    if (!theirs) {
        // Recorded outside: the graph would depend on something that is not in it.
        {
            std::lock_guard event_lock(event.mutex);
            if (!event.fence.queue) return CUDA_SUCCESS;  // never recorded: nothing to wait for
        }
        stream->capture->invalidated = true;
        return CUDA_ERROR_STREAM_CAPTURE_ISOLATION;
    }
    const bool over = std::find(g_captures.begin(), g_captures.end(), theirs) == g_captures.end();
    if (over) return CUDA_ERROR_CAPTURED_EVENT;
    if (theirs->invalidated) return CUDA_ERROR_STREAM_CAPTURE_INVALIDATED;
    if (stream->capture && stream->capture != theirs) {
        stream->capture->invalidated = true;
        theirs->invalidated = true;
        return CUDA_ERROR_STREAM_CAPTURE_MERGE;
    }
    if (stream->queue->kind == StreamQueue::Kind::kLegacy) {
        theirs->invalidated = true;
        return CUDA_ERROR_STREAM_CAPTURE_IMPLICIT;
    }
    if (!stream->capture) join(stream, theirs);
    add_to_tail(*stream, event.captured);
    return CUDA_SUCCESS;
}

CUresult require_not_captured(Event& event) {
    std::lock_guard lock(g_mutex);
    if (!event.capture) return CUDA_SUCCESS;
    event.capture->invalidated = true;
    return CUDA_ERROR_CAPTURED_EVENT;
}

void exchange_capture_mode(CUstreamCaptureMode& mode) {
    std::swap(t_mode, mode);
}

}  // namespace urgengo::simgpu
