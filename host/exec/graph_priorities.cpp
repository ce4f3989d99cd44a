// SPDX-License-Identifier: Apache-2.0
#include "host/exec/graph_priorities.h"

#include <cstdint>
#include <vector>

namespace urgengo::exec {
namespace {

constexpr int kMaxDepth = 8;  // of graphs in graphs

/// What of a graph runs no kernel of the program's, and hides none.
bool has_no_kernels(CUgraphNodeType type) {
    switch (type) {
        case CU_GRAPH_NODE_TYPE_MEMCPY:
        case CU_GRAPH_NODE_TYPE_MEMSET:
        case CU_GRAPH_NODE_TYPE_HOST:
        case CU_GRAPH_NODE_TYPE_EMPTY:
        case CU_GRAPH_NODE_TYPE_WAIT_EVENT:
        case CU_GRAPH_NODE_TYPE_EVENT_RECORD:
        case CU_GRAPH_NODE_TYPE_EXT_SEMAS_SIGNAL:
        case CU_GRAPH_NODE_TYPE_EXT_SEMAS_WAIT:
        case CU_GRAPH_NODE_TYPE_MEM_ALLOC:
        case CU_GRAPH_NODE_TYPE_MEM_FREE:
        case CU_GRAPH_NODE_TYPE_BATCH_MEM_OP:
            return true;
        default:
            return false;
    }
}

}  // namespace

bool GraphPriorities::look_into(CUgraph graph, std::optional<int>& found, int depth) const {
    std::size_t count = 0;
    if (driver_.cuGraphGetNodes(graph, nullptr, &count) != CUDA_SUCCESS) return false;
    std::vector<CUgraphNode> nodes(count);
    if (count > 0 && driver_.cuGraphGetNodes(graph, nodes.data(), &count) != CUDA_SUCCESS)
        return false;
    if (count != nodes.size()) return false;  // it changes meanwhile
    for (const CUgraphNode node : nodes) {
        CUgraphNodeType type{};
        if (driver_.cuGraphNodeGetType(node, &type) != CUDA_SUCCESS) return false;
        if (has_no_kernels(type)) continue;
        if (type == CU_GRAPH_NODE_TYPE_GRAPH) {
            CUgraph child = nullptr;
            if (depth >= kMaxDepth || !driver_.cuGraphChildGraphNodeGetGraph ||
                driver_.cuGraphChildGraphNodeGetGraph(node, &child) != CUDA_SUCCESS ||
                !look_into(child, found, depth + 1))
                return false;
            continue;
        }
        CUkernelNodeAttrValue value{};
        if (type != CU_GRAPH_NODE_TYPE_KERNEL ||
            driver_.cuGraphKernelNodeGetAttribute(node, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value) !=
                CUDA_SUCCESS ||
            (found && *found != value.priority))
            return false;
        found = value.priority;
    }
    return true;
}

std::optional<int> GraphPriorities::of_all_kernels(CUgraph graph) const {
    if (!driver_.cuGraphGetNodes || !driver_.cuGraphNodeGetType ||
        !driver_.cuGraphKernelNodeGetAttribute)
        return std::nullopt;
    std::optional<int> found;
    return look_into(graph, found, 0) ? found : std::nullopt;
}

std::size_t GraphPriorities::place_of(CUgraphExec executable, std::size_t probe) {
    constexpr std::uint64_t kOdd = 0x9e3779b97f4a7c15;  // 2^64 over the golden ratio
    const std::uint64_t hash = reinterpret_cast<std::uintptr_t>(executable) * kOdd;
    return static_cast<std::size_t>((hash >> 40) + probe) % kPlaces;
}

bool GraphPriorities::keep(CUgraphExec executable, int priority) {
    const std::lock_guard lock(mutex_);
    Place* free = nullptr;
    for (std::size_t probe = 0; probe < kProbes; ++probe) {
        Place& place = places_[place_of(executable, probe)];
        const CUgraphExec there = place.executable.load(std::memory_order_relaxed);
        if (there == executable) {
            place.priority.store(priority, std::memory_order_relaxed);
            return true;
        }
        if (!free && place.priority.load(std::memory_order_relaxed) == kNone) free = &place;
    }
    if (!free) return false;
    // In this order: a thread that looks for what was here finds nothing. None looks for the new
    // one before its program has got the handle.
    free->executable.store(executable, std::memory_order_relaxed);
    free->priority.store(priority, std::memory_order_release);
    return true;
}

void GraphPriorities::forget(CUgraphExec executable) {
    for (std::size_t probe = 0; probe < kProbes; ++probe) {
        Place& place = places_[place_of(executable, probe)];
        if (place.executable.load(std::memory_order_relaxed) != executable) continue;
        const std::lock_guard lock(mutex_);
        if (place.executable.load(std::memory_order_relaxed) == executable)
            place.priority.store(kNone, std::memory_order_relaxed);
    }
}

std::optional<int> GraphPriorities::find(CUgraphExec executable) const {
    for (std::size_t probe = 0; probe < kProbes; ++probe) {
        const Place& place = places_[place_of(executable, probe)];
        const CUgraphExec there = place.executable.load(std::memory_order_relaxed);
        if (there == executable) {
            const int priority = place.priority.load(std::memory_order_acquire);
            if (priority != kNone) return priority;
        }
        if (!there) break;  // no place is ever emptied again
    }
    return std::nullopt;
}

}  // namespace urgengo::exec
