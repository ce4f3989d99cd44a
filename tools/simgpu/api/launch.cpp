// SPDX-License-Identifier: Apache-2.0
//
// Kernel launches: the driver's checks, the parameters that matter, the cost.
#include "tools/simgpu/api/launch.h"
#include "tools/simgpu/api/launch_call.h"

#include <fmt/format.h>

#include "tools/simgpu/api/launch_params.h"
#include "tools/simgpu/engine/kernel_failures.h"
#include "tools/simgpu/engine/zero_cost.h"
#include "tools/simgpu/graph/capture.h"
#include "tools/simgpu/graph/graph.h"
#include "tools/simgpu/image/function.h"
#include "tools/simgpu/simgpu.h"

using namespace urgengo::simgpu;

namespace {

constexpr unsigned kMaxThreadsPerBlock = 1024;
constexpr unsigned kMaxBlockZ = 64;
constexpr unsigned kMaxGridX = 2147483647;
constexpr unsigned kMaxGridYz = 65535;

CUresult check_shape(const CUlaunchConfig& config, const Function& function) {
    const bool empty = config.gridDimX == 0 || config.gridDimY == 0 || config.gridDimZ == 0 ||
                       config.blockDimX == 0 || config.blockDimY == 0 || config.blockDimZ == 0;
    const bool grid_too_large =
        config.gridDimX > kMaxGridX || config.gridDimY > kMaxGridYz || config.gridDimZ > kMaxGridYz;
    // Each dimension first, so that the product cannot overflow.
    const bool block_too_large =
        config.blockDimX > kMaxThreadsPerBlock || config.blockDimY > kMaxThreadsPerBlock ||
        config.blockDimZ > kMaxBlockZ ||
        std::uint64_t{config.blockDimX} * config.blockDimY * config.blockDimZ > kMaxThreadsPerBlock;
    const bool shared_too_large =
        config.sharedMemBytes > static_cast<unsigned>(function.max_dynamic_shared_bytes);
    return empty || grid_too_large || block_too_large || shared_too_large ? CUDA_ERROR_INVALID_VALUE
                                                                          : CUDA_SUCCESS;
}

/// Reads the parameter that the kernel's duration depends on.
CUresult read_units(const Function& function, const LaunchParams& params, std::uint64_t& units) {
    const KernelCost& cost = function.cost;
    const std::vector<std::size_t> offsets = function.param_offsets();
    const bool has_offset = cost.unit_arg == 0 || cost.unit_arg < offsets.size();
    const std::size_t offset = cost.unit_arg == 0 ? 0
                               : has_offset       ? offsets[cost.unit_arg]
                                                  : SIZE_MAX / 2;
    // Little-endian hosts only, as CUDA's are: the low bytes of `units` are the integer.
    if (params.copy(cost.unit_arg, offset, cost.unit_bytes, &units)) return CUDA_SUCCESS;
    complain(
        fmt::format("launch of '{}': its cost needs parameter {}, which the launch does not "
                    "pass{}",
                    *function.name, cost.unit_arg,
                    has_offset ? "" : " (a parameter buffer needs param_bytes in the table)"));
    return CUDA_ERROR_INVALID_VALUE;
}

/// Takes the parameters of a native kernel, which runs long after the launch has returned.
CUresult bind_native(const NativeKernel& native, const LaunchParams& params,
                     std::function<void(Time)>& run) {
    const std::vector<std::size_t> offsets = layout_params(native.param_bytes);
    std::vector<std::byte> values(offsets.back() + native.param_bytes.back());
    for (std::size_t i = 0; i < offsets.size(); ++i) {
        if (!params.copy(i, offsets[i], native.param_bytes[i], values.data() + offsets[i])) {
            return CUDA_ERROR_INVALID_VALUE;
        }
    }
    run = [&native, values = std::move(values)](Time end) { native.run(values, end); };
    return CUDA_SUCCESS;
}

/// Where this launch leaves its stamps, if its parameter asks for them.
CUresult bind_stamps(const Function& function, const LaunchParams& params,
                     std::function<void(Time, Time)>& stamp) {
    const std::size_t arg = *function.cost.stamps_arg;
    const std::vector<std::size_t> offsets = function.param_offsets();
    std::uint64_t word = 0;
    if (!params.copy(arg, arg < offsets.size() ? offsets[arg] : SIZE_MAX / 2, sizeof word, &word))
        return CUDA_ERROR_INVALID_VALUE;
    if ((word & 1) == 0) return CUDA_SUCCESS;
    auto* const to = reinterpret_cast<simgpu_stamps*>(word & ~std::uint64_t{1});
    stamp = [to](Time start, Time end) {
        const std::uint32_t launch = to->launches++;
        if (launch >= to->room) return;
        auto* const pair = reinterpret_cast<std::int64_t*>(to->stamps) + 2 * std::size_t{launch};
        pair[0] = start.count() + SIMGPU_GLOBALTIMER_OFFSET_NS;
        pair[1] = end.count() + SIMGPU_GLOBALTIMER_OFFSET_NS;
    };
    return CUDA_SUCCESS;
}

CUresult apply_attributes(const CUlaunchConfig& config, KernelWork& work) {
    const Part& part = driver().part;
    for (unsigned i = 0; i < config.numAttrs; ++i) {
        const CUlaunchAttribute& attribute = config.attrs[i];
        if (attribute.id == CU_LAUNCH_ATTRIBUTE_PRIORITY) {
            if (part.priority_attribute == PriorityAttribute::kRefused) {
                return CUDA_ERROR_NOT_SUPPORTED;
            }
            if (part.priority_attribute == PriorityAttribute::kIgnored) continue;
            work.priority = clamp_priority(attribute.value.priority);
        } else if (attribute.id == CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION) {
            const bool asked = attribute.value.programmaticStreamSerializationAllowed != 0;
            if (asked && !part.programmatic_launch) return CUDA_ERROR_NOT_SUPPORTED;
            work.overlaps_launch = asked;
        } else if (attribute.id == CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_EVENT) {
            if (!part.programmatic_launch) return CUDA_ERROR_NOT_SUPPORTED;
        }
        // The others say how a kernel runs, not when.
    }
    return CUDA_SUCCESS;
}

}  // namespace

namespace urgengo::simgpu {

CUresult prepare_kernel(const CUlaunchConfig& config, CUfunction handle, void** param_pointers,
                        void** extra, bool cooperative, const Context* context, int priority,
                        KernelWork& work) {
    const auto function = find_function(handle);
    if (!function) return CUDA_ERROR_INVALID_HANDLE;
    const bool foreign =
        function->context != nullptr && function->context->owner() != context->owner();
    if (foreign) return CUDA_ERROR_INVALID_HANDLE;
    if (CUresult error = check_shape(config, *function)) return error;
    if (config.numAttrs > 0 && config.attrs == nullptr) return CUDA_ERROR_INVALID_VALUE;
    LaunchParams params;
    if (CUresult error = LaunchParams::read(param_pointers, extra, params)) return error;

    const Part& part = driver().part;
    const unsigned num_threads = config.blockDimX * config.blockDimY * config.blockDimZ;
    work.name = function->name;
    work.num_blocks = std::uint64_t{config.gridDimX} * config.gridDimY * config.gridDimZ;
    work.blocks_per_sm = function->blocks_per_sm(num_threads);
    work.priority = priority;
    work.launch = LaunchCall::current();
    if (CUresult error = apply_attributes(config, work)) return error;

    const auto room =
        static_cast<std::uint64_t>(part.num_sms) * static_cast<std::uint64_t>(work.blocks_per_sm);
    if (cooperative && work.num_blocks > room) return CUDA_ERROR_COOPERATIVE_LAUNCH_TOO_LARGE;

    std::uint64_t units = 0;
    if (function->cost.needs_units()) {
        if (CUresult error = read_units(*function, params, units)) return error;
    }
    if (function->native != nullptr) {
        if (CUresult error = bind_native(*function->native, params, work.run)) return error;
    }
    if (function->cost.stamps_arg) {
        if (CUresult error = bind_stamps(*function, params, work.stamp)) return error;
    }
    work.block_time = part.scaled(function->cost.block_ns +
                                  function->cost.block_ns_per_unit * static_cast<double>(units));
    return CUDA_SUCCESS;
}

}  // namespace urgengo::simgpu

namespace {

/// What SIMGPU_FAIL asks of this launch of this kernel.
CUresult fail_as_asked(CUfunction handle, const Stream& stream, KernelWork& work) {
    const auto function = find_function(handle);
    if (!function || function->failures == nullptr) return CUDA_SUCCESS;
    const InjectedError* const error = function->failures->next_launch();
    if (error == nullptr) return CUDA_SUCCESS;
    const auto code = static_cast<CUresult>(error->code);
    if (error->on == InjectedError::On::kLaunch) {
        if (breaks_context(code)) stream.context->broken = code;
        return code;
    }
    work.run = [context = stream.context, code](Time) { context->broken = code; };
    return CUDA_SUCCESS;
}

CUresult launch(const CUlaunchConfig& config, CUfunction function, void** params, void** extra,
                bool cooperative) {
    const LaunchCall call;
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(config.hStream, stream)) return error;
    KernelWork work;
    if (CUresult error = prepare_kernel(config, function, params, extra, cooperative,
                                        stream->context, stream->priority, work)) {
        return error;
    }
    if (KernelFailures::any()) {
        if (CUresult error = fail_as_asked(function, *stream, work)) return error;
    }
    if (is_capturing(*stream)) {
        capture_work(*stream, std::move(work),
                     describe_launch(config, function, params, extra, cooperative));
    } else {
        const Fence done = submit(*stream, std::move(work));
        if (driver().launch_blocking) {
            done.wait();
            return stream->context->broken;
        }
    }
    return CUDA_SUCCESS;
}

bool asks_for_cooperation(const CUlaunchConfig& config) {
    for (unsigned i = 0; config.attrs != nullptr && i < config.numAttrs; ++i) {
        const CUlaunchAttribute& attribute = config.attrs[i];
        if (attribute.id == CU_LAUNCH_ATTRIBUTE_COOPERATIVE)
            return attribute.value.cooperative != 0;
    }
    return false;
}

}  // namespace

SIMGPU_API CUresult cuLaunchKernel(CUfunction function, unsigned grid_x, unsigned grid_y,
                                   unsigned grid_z, unsigned block_x, unsigned block_y,
                                   unsigned block_z, unsigned shared_bytes, CUstream stream,
                                   void** params, void** extra) {
    if (zero_cost()) return launch_at_no_cost(function, params, extra);
    const CUlaunchConfig config{grid_x,  grid_y,       grid_z, block_x, block_y,
                                block_z, shared_bytes, stream, nullptr, 0};
    return launch(config, function, params, extra, false);
}

SIMGPU_API CUresult cuLaunchKernelEx(const CUlaunchConfig* config, CUfunction function,
                                     void** params, void** extra) {
    if (zero_cost()) return launch_at_no_cost(function, params, extra);
    if (CUresult error = require_init()) return error;
    if (config == nullptr) return CUDA_ERROR_INVALID_VALUE;
    return launch(*config, function, params, extra, asks_for_cooperation(*config));
}

SIMGPU_API CUresult cuLaunchCooperativeKernel(CUfunction function, unsigned grid_x, unsigned grid_y,
                                              unsigned grid_z, unsigned block_x, unsigned block_y,
                                              unsigned block_z, unsigned shared_bytes,
                                              CUstream stream, void** params) {
    if (zero_cost()) return launch_at_no_cost(function, params, nullptr);
    const CUlaunchConfig config{grid_x,  grid_y,       grid_z, block_x, block_y,
                                block_z, shared_bytes, stream, nullptr, 0};
    return launch(config, function, params, nullptr, true);
}
