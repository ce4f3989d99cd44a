// SPDX-License-Identifier: Apache-2.0
//
// Adding nodes, and what kernel nodes are asked and told.
#include <algorithm>
#include <cstring>

#include "tools/simgpu/api/launch.h"
#include "tools/simgpu/api/launch_params.h"
#include "tools/simgpu/graph/graph.h"
#include "tools/simgpu/image/function.h"
#include "tools/simgpu/memory/copy.h"

using namespace urgengo::simgpu;

namespace {

CUresult check_dependencies(CUgraph graph, const CUgraphNode* nodes, std::size_t count) {
    if (count > 0 && nodes == nullptr) return CUDA_ERROR_INVALID_VALUE;
    for (std::size_t i = 0; i < count; ++i) {
        const auto node = driver().graph_nodes.find(nodes[i]);
        const bool twice = std::find(nodes, nodes + i, nodes[i]) != nodes + i;
        if (!node || node->graph != graph || twice) return CUDA_ERROR_INVALID_VALUE;
    }
    return CUDA_SUCCESS;
}

}  // namespace

namespace urgengo::simgpu {

CUresult add_node_checked(CUgraphNode* handle, CUgraph graph_handle,
                          const CUgraphNode* dependencies, std::size_t num_dependencies,
                          GraphNode node) {
    std::shared_ptr<Graph> graph;
    if (CUresult error = find_graph(graph_handle, graph)) return error;
    if (handle == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = check_dependencies(graph_handle, dependencies, num_dependencies)) {
        return error;
    }
    node.dependencies.assign(dependencies, dependencies + num_dependencies);
    *handle = add_node(*graph, graph_handle, std::move(node));
    return CUDA_SUCCESS;
}

CUDA_KERNEL_NODE_PARAMS_v2 widen(const CUDA_KERNEL_NODE_PARAMS_v1& params) {
    return {params.func,         params.gridDimX,  params.gridDimY,  params.gridDimZ,
            params.blockDimX,    params.blockDimY, params.blockDimZ, params.sharedMemBytes,
            params.kernelParams, params.extra,     nullptr,          nullptr};
}

std::shared_ptr<KernelCall> describe_launch(const CUlaunchConfig& config, CUfunction handle,
                                            void** pointers, void** extra, bool cooperative) {
    auto call = std::make_shared<KernelCall>();
    call->cooperative = cooperative;
    call->params = {.func = handle,
                    .gridDimX = config.gridDimX,
                    .gridDimY = config.gridDimY,
                    .gridDimZ = config.gridDimZ,
                    .blockDimX = config.blockDimX,
                    .blockDimY = config.blockDimY,
                    .blockDimZ = config.blockDimZ,
                    .sharedMemBytes = config.sharedMemBytes,
                    .kernelParams = nullptr,
                    .extra = nullptr,
                    .kern = nullptr,
                    .ctx = nullptr};
    const auto function = find_function(handle);
    LaunchParams params;
    if (!function || LaunchParams::read(pointers, extra, params) != CUDA_SUCCESS) return call;
    const auto sizes = function->param_sizes();
    const auto offsets = function->param_offsets();
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        std::vector<std::byte> value(sizes[i]);
        if (!params.copy(i, offsets[i], sizes[i], value.data())) return call;
        call->values.push_back(std::move(value));
    }
    for (auto& value : call->values) call->pointers.push_back(value.data());
    if (!call->pointers.empty()) call->params.kernelParams = call->pointers.data();
    return call;
}

CUresult prepare_kernel_node(const CUDA_KERNEL_NODE_PARAMS_v2& params, int priority, Work& work,
                             std::shared_ptr<KernelCall>& call) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    const CUfunction function =
        params.func != nullptr ? params.func : reinterpret_cast<CUfunction>(params.kern);
    const CUlaunchConfig config{params.gridDimX,
                                params.gridDimY,
                                params.gridDimZ,
                                params.blockDimX,
                                params.blockDimY,
                                params.blockDimZ,
                                params.sharedMemBytes,
                                nullptr,
                                nullptr,
                                0};
    const bool cooperative = call && call->cooperative;
    KernelWork kernel;
    if (CUresult error = prepare_kernel(config, function, params.kernelParams, params.extra,
                                        cooperative, context, priority, kernel)) {
        return error;
    }
    call = describe_launch(config, function, params.kernelParams, params.extra, cooperative);
    work = std::move(kernel);
    return CUDA_SUCCESS;
}

}  // namespace urgengo::simgpu

namespace {

CUresult add(CUgraphNode* node, CUgraph graph, const CUgraphNode* dependencies,
             std::size_t num_dependencies, CUgraphNodeType type, Work work,
             std::shared_ptr<KernelCall> kernel = nullptr) {
    GraphNode made;
    made.type = type;
    made.work = std::move(work);
    made.kernel = std::move(kernel);
    return add_node_checked(node, graph, dependencies, num_dependencies, std::move(made));
}

CUresult find_kernel_node(CUgraphNode handle, std::shared_ptr<GraphNode>& node) {
    if (CUresult error = require_init()) return error;
    node = driver().graph_nodes.find(handle);
    const bool is_kernel = node && node->type == CU_GRAPH_NODE_TYPE_KERNEL;
    return is_kernel ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

/// One end of a copy: where its first byte is, and how far apart rows and slices are.
struct CopyEnd {
    std::uintptr_t start;
    std::size_t pitch;
    std::size_t slice;
    bool on_device;
};

bool read_end(CUmemorytype type, const void* host, CUdeviceptr device, std::size_t x, std::size_t y,
              std::size_t z, std::size_t pitch, std::size_t height, std::size_t width,
              CopyEnd& end) {
    if (type == CU_MEMORYTYPE_ARRAY) return false;  // there are no arrays
    const auto base = type == CU_MEMORYTYPE_HOST ? reinterpret_cast<std::uintptr_t>(host)
                                                 : static_cast<std::uintptr_t>(device);
    const auto allocation = driver().memory.find(base);
    if (base == 0 || (type == CU_MEMORYTYPE_DEVICE && !allocation)) return false;
    end.pitch = pitch == 0 ? width : pitch;
    end.slice = end.pitch * std::max(height, std::size_t{1});
    end.start = base + x + y * end.pitch + z * end.slice;
    end.on_device = allocation && allocation->on_device();
    return true;
}

CUresult make_copy(const CUDA_MEMCPY3D& copy, CopyWork& work) {
    CopyEnd from{};
    CopyEnd to{};
    const bool possible =
        read_end(copy.srcMemoryType, copy.srcHost, copy.srcDevice, copy.srcXInBytes, copy.srcY,
                 copy.srcZ, copy.srcPitch, copy.srcHeight, copy.WidthInBytes, from) &&
        read_end(copy.dstMemoryType, copy.dstHost, copy.dstDevice, copy.dstXInBytes, copy.dstY,
                 copy.dstZ, copy.dstPitch, copy.dstHeight, copy.WidthInBytes, to);
    const std::size_t bytes = copy.WidthInBytes * copy.Height * copy.Depth;
    if (!possible || bytes == 0) return CUDA_ERROR_INVALID_VALUE;
    const Part& part = driver().part;
    const bool stays = from.on_device && to.on_device;
    const auto run = [from, to, width = copy.WidthInBytes, height = copy.Height,
                      depth = copy.Depth] {
        for (std::size_t z = 0; z < depth; ++z) {
            for (std::size_t y = 0; y < height; ++y) {
                std::memmove(
                    reinterpret_cast<void*>(to.start + z * to.slice + y * to.pitch),
                    reinterpret_cast<const void*>(from.start + z * from.slice + y * from.pitch),
                    width);
            }
        }
    };
    work = {.engine = stays            ? CopyEngine::kOnDevice
                      : from.on_device ? CopyEngine::kDeviceToHost
                                       : CopyEngine::kHostToDevice,
            .duration = part.copy_time(bytes, stays ? part.device_gbps : part.copy_gbps),
            .run = run,
            .writes = {to.start, (copy.Depth - 1) * to.slice + (copy.Height - 1) * to.pitch +
                                     copy.WidthInBytes}};
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuGraphAddKernelNode_v2(CUgraphNode* node, CUgraph graph,
                                            const CUgraphNode* dependencies,
                                            std::size_t num_dependencies,
                                            const CUDA_KERNEL_NODE_PARAMS_v2* params) {
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    Work work;
    std::shared_ptr<KernelCall> call;
    if (CUresult error = prepare_kernel_node(*params, kLeastPriority, work, call)) return error;
    return add(node, graph, dependencies, num_dependencies, CU_GRAPH_NODE_TYPE_KERNEL,
               std::move(work), std::move(call));
}

SIMGPU_API CUresult cuGraphAddKernelNode(CUgraphNode* node, CUgraph graph,
                                         const CUgraphNode* dependencies,
                                         std::size_t num_dependencies,
                                         const CUDA_KERNEL_NODE_PARAMS_v1* params) {
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const CUDA_KERNEL_NODE_PARAMS_v2 wide = widen(*params);
    return cuGraphAddKernelNode_v2(node, graph, dependencies, num_dependencies, &wide);
}

SIMGPU_API CUresult cuGraphAddMemcpyNode(CUgraphNode* node, CUgraph graph,
                                         const CUgraphNode* dependencies,
                                         std::size_t num_dependencies, const CUDA_MEMCPY3D* copy,
                                         CUcontext context) {
    if (copy == nullptr) return CUDA_ERROR_INVALID_VALUE;
    CopyWork work{};
    if (CUresult error = make_copy(*copy, work)) return error;
    return add(node, graph, dependencies, num_dependencies, CU_GRAPH_NODE_TYPE_MEMCPY,
               std::move(work));
}

SIMGPU_API CUresult cuGraphAddMemsetNode(CUgraphNode* node, CUgraph graph,
                                         const CUgraphNode* dependencies,
                                         std::size_t num_dependencies,
                                         const CUDA_MEMSET_NODE_PARAMS* params, CUcontext context) {
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    CopyWork work{};
    const std::size_t pitch =
        params->height == 1 ? params->width * params->elementSize : params->pitch;
    if (CUresult error = make_memset(params->dst, params->value, params->elementSize, params->width,
                                     params->height, pitch, work)) {
        return error;
    }
    return add(node, graph, dependencies, num_dependencies, CU_GRAPH_NODE_TYPE_MEMSET,
               std::move(work));
}

SIMGPU_API CUresult cuGraphAddHostNode(CUgraphNode* node, CUgraph graph,
                                       const CUgraphNode* dependencies,
                                       std::size_t num_dependencies,
                                       const CUDA_HOST_NODE_PARAMS* params) {
    if (params == nullptr || params->fn == nullptr) return CUDA_ERROR_INVALID_VALUE;
    return add(node, graph, dependencies, num_dependencies, CU_GRAPH_NODE_TYPE_HOST,
               HostCall{[call = params->fn, data = params->userData] { call(data); }});
}

SIMGPU_API CUresult cuGraphAddEmptyNode(CUgraphNode* node, CUgraph graph,
                                        const CUgraphNode* dependencies,
                                        std::size_t num_dependencies) {
    return add(node, graph, dependencies, num_dependencies, CU_GRAPH_NODE_TYPE_EMPTY, TimedWork{});
}

SIMGPU_API CUresult cuGraphKernelNodeGetParams_v2(CUgraphNode handle,
                                                  CUDA_KERNEL_NODE_PARAMS_v2* params) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_kernel_node(handle, node)) return error;
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *params = node->kernel->params;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphKernelNodeGetParams(CUgraphNode handle,
                                               CUDA_KERNEL_NODE_PARAMS_v1* params) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_kernel_node(handle, node)) return error;
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    std::memcpy(params, &node->kernel->params, sizeof *params);  // v2 begins with v1
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGraphKernelNodeSetParams_v2(CUgraphNode handle,
                                                  const CUDA_KERNEL_NODE_PARAMS_v2* params) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_kernel_node(handle, node)) return error;
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const int priority = std::get<KernelWork>(node->work).priority;
    return prepare_kernel_node(*params, priority, node->work, node->kernel);
}

SIMGPU_API CUresult cuGraphKernelNodeSetParams(CUgraphNode handle,
                                               const CUDA_KERNEL_NODE_PARAMS_v1* params) {
    if (params == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const CUDA_KERNEL_NODE_PARAMS_v2 wide = widen(*params);
    return cuGraphKernelNodeSetParams_v2(handle, &wide);
}

SIMGPU_API CUresult cuGraphKernelNodeGetAttribute(CUgraphNode handle, CUkernelNodeAttrID which,
                                                  CUkernelNodeAttrValue* value) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_kernel_node(handle, node)) return error;
    if (value == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *value = {};
    switch (which) {
        case CU_LAUNCH_ATTRIBUTE_PRIORITY:
            value->priority = std::get<KernelWork>(node->work).priority;
            return CUDA_SUCCESS;
        case CU_LAUNCH_ATTRIBUTE_COOPERATIVE:
            value->cooperative = node->kernel->cooperative ? 1 : 0;
            return CUDA_SUCCESS;
        default:
            return CUDA_ERROR_NOT_SUPPORTED;
    }
}

SIMGPU_API CUresult cuGraphKernelNodeSetAttribute(CUgraphNode handle, CUkernelNodeAttrID which,
                                                  const CUkernelNodeAttrValue* value) {
    std::shared_ptr<GraphNode> node;
    if (CUresult error = find_kernel_node(handle, node)) return error;
    if (value == nullptr) return CUDA_ERROR_INVALID_VALUE;
    switch (which) {
        case CU_LAUNCH_ATTRIBUTE_PRIORITY:
            std::get<KernelWork>(node->work).priority = clamp_priority(value->priority);
            return CUDA_SUCCESS;
        case CU_LAUNCH_ATTRIBUTE_COOPERATIVE:
            node->kernel->cooperative = value->cooperative != 0;
            return CUDA_SUCCESS;
        default:
            return CUDA_ERROR_NOT_SUPPORTED;
    }
}
