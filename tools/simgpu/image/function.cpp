// SPDX-License-Identifier: Apache-2.0
//
// Functions: what they cost, their attributes, their occupancy.
#include "tools/simgpu/image/function.h"

#include <cctype>
#include <mutex>

#include "tools/simgpu/engine/kernel_failures.h"

using namespace urgengo::simgpu;

namespace urgengo::simgpu {

std::shared_ptr<Function> make_function(const char* name, const CostTable* image_costs,
                                        const std::shared_ptr<const Image>& image) {
    auto function = std::make_shared<Function>();
    function->name = std::make_shared<const std::string>(name);
    function->native = find_native_kernel(*function->name);
    function->failures = KernelFailures::find(*function->name);
    function->image = image;
    if (image) function->in_image = image->find(*function->name);
    if (image && image->is_complete() && function->in_image == nullptr) return nullptr;

    const CostTable& file_costs = driver().file_costs;
    const KernelCost* cost = file_costs.find(*function->name);
    if (cost == nullptr && image_costs != nullptr) cost = image_costs->find(*function->name);
    if (cost != nullptr) {
        function->cost = *cost;
    } else if (function->native != nullptr) {
        function->cost.block_ns = static_cast<double>(function->native->block_time.count());
        function->cost.block_ns_per_unit = function->native->block_ns_per_unit;
        function->cost.unit_bytes = function->native->param_bytes.front();
    } else if (image_costs != nullptr && image_costs->fallback()) {
        function->cost = *image_costs->fallback();
    } else if (file_costs.fallback()) {
        function->cost = *file_costs.fallback();
    }
    return function;
}

CUresult read_image(const char* image, const std::string& where,
                    std::shared_ptr<const CostTable>& costs,
                    std::shared_ptr<const Image>& kernels) {
    const char* begin = image;
    while (std::isspace(static_cast<unsigned char>(*begin)) != 0) ++begin;
    if (*begin != '{') {
        kernels = std::make_shared<const Image>(Image::parse(image));
        return CUDA_SUCCESS;
    }
    auto table = CostTable::parse(begin, where);
    if (!table) {
        complain(table.error());
        return CUDA_ERROR_INVALID_IMAGE;
    }
    costs = std::make_shared<const CostTable>(std::move(*table));
    return CUDA_SUCCESS;
}

std::shared_ptr<Function> find_function(CUfunction handle) {
    return driver().functions.find(handle);
}

}  // namespace urgengo::simgpu

namespace {

CUresult find(CUfunction handle, std::shared_ptr<Function>& function) {
    if (CUresult error = require_init()) return error;
    function = find_function(handle);
    return function ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
}

CUresult get_attribute(int* value, CUfunction_attribute which, CUfunction handle) {
    std::shared_ptr<Function> function;
    if (CUresult error = find(handle, function)) return error;
    if (value == nullptr || which < 0 || which >= CU_FUNC_ATTRIBUTE_MAX) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    const KernelImage* const said = function->in_image;
    switch (which) {
        case CU_FUNC_ATTRIBUTE_MAX_THREADS_PER_BLOCK:
            *value = said != nullptr && said->max_threads > 0 ? said->max_threads : 1024;
            break;
        case CU_FUNC_ATTRIBUTE_NUM_REGS:
            *value = said != nullptr && said->num_regs > 0 ? said->num_regs : 32;
            break;
        case CU_FUNC_ATTRIBUTE_SHARED_SIZE_BYTES:
            *value = said != nullptr ? static_cast<int>(said->shared_bytes) : 0;
            break;
        case CU_FUNC_ATTRIBUTE_PTX_VERSION:
        case CU_FUNC_ATTRIBUTE_BINARY_VERSION:
            *value = 10 * driver().part.compute_major + driver().part.compute_minor;
            break;
        case CU_FUNC_ATTRIBUTE_PREFERRED_SHARED_MEMORY_CARVEOUT:
            *value = -1;
            break;
        case CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES:
            *value = function->max_dynamic_shared_bytes;
            break;
        default:
            *value = 0;
    }
    return CUDA_SUCCESS;
}

CUresult set_attribute(CUfunction handle, CUfunction_attribute which, int value) {
    std::shared_ptr<Function> function;
    if (CUresult error = find(handle, function)) return error;
    switch (which) {
        case CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES: {
            const int most_bytes = driver().part.shared_kb_opt_in << 10;
            if (value < 0 || value > most_bytes) return CUDA_ERROR_INVALID_VALUE;
            function->max_dynamic_shared_bytes = value;
            return CUDA_SUCCESS;
        }
        case CU_FUNC_ATTRIBUTE_PREFERRED_SHARED_MEMORY_CARVEOUT:
            return CUDA_SUCCESS;
        default:
            return CUDA_ERROR_INVALID_VALUE;
    }
}

CUresult get_param_info(CUfunction handle, std::size_t index, std::size_t* offset,
                        std::size_t* bytes) {
    std::shared_ptr<Function> function;
    if (CUresult error = find(handle, function)) return error;
    if (offset == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const auto sizes = function->param_sizes();
    const bool hidden = sizes.empty() && function->in_image == nullptr && function->image &&
                        function->image->is_compressed();
    if (hidden) {
        // Once: a framework asks for thousands.
        static std::once_flag once;
        std::call_once(once, [&function] {
            complain("parameters of '" + *function->name +
                     "': found a compressed fat binary, accepted: an uncompressed one (nvcc "
                     "--no-compress)");
        });
        return CUDA_ERROR_NOT_SUPPORTED;
    }
    if (index >= sizes.size()) return CUDA_ERROR_INVALID_VALUE;
    *offset = function->param_offsets()[index];
    if (bytes != nullptr) *bytes = sizes[index];
    return CUDA_SUCCESS;
}

CUresult get_name(const char** name, CUfunction handle) {
    std::shared_ptr<Function> function;
    if (CUresult error = find(handle, function)) return error;
    if (name == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *name = function->name->c_str();
    return CUDA_SUCCESS;
}

CUresult occupancy(int* num_blocks, CUfunction handle, int threads_per_block) {
    std::shared_ptr<Function> function;
    if (CUresult error = find(handle, function)) return error;
    if (num_blocks == nullptr || threads_per_block <= 0) return CUDA_ERROR_INVALID_VALUE;
    *num_blocks = threads_per_block > 1024
                      ? 0
                      : function->blocks_per_sm(static_cast<unsigned>(threads_per_block));
    return CUDA_SUCCESS;
}

CUfunction as_function(CUkernel kernel) {
    return reinterpret_cast<CUfunction>(kernel);
}

}  // namespace

SIMGPU_API CUresult cuFuncGetName(const char** name, CUfunction function) {
    return get_name(name, function);
}

SIMGPU_API CUresult cuKernelGetName(const char** name, CUkernel kernel) {
    return get_name(name, as_function(kernel));
}

SIMGPU_API CUresult cuFuncGetModule(CUmodule* module, CUfunction handle) {
    std::shared_ptr<Function> function;
    if (CUresult error = find(handle, function)) return error;
    if (module == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (function->module == nullptr) return CUDA_ERROR_NOT_SUPPORTED;  // a library's
    *module = function->module;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuFuncGetAttribute(int* value, CUfunction_attribute which,
                                       CUfunction function) {
    return get_attribute(value, which, function);
}

SIMGPU_API CUresult cuFuncSetAttribute(CUfunction function, CUfunction_attribute which, int value) {
    return set_attribute(function, which, value);
}

SIMGPU_API CUresult cuKernelGetAttribute(int* value, CUfunction_attribute which, CUkernel kernel,
                                         CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    return get_attribute(value, which, as_function(kernel));
}

SIMGPU_API CUresult cuKernelSetAttribute(CUfunction_attribute which, int value, CUkernel kernel,
                                         CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    return set_attribute(as_function(kernel), which, value);
}

SIMGPU_API CUresult cuFuncSetCacheConfig(CUfunction handle, CUfunc_cache config) {
    std::shared_ptr<Function> function;
    return find(handle, function);  // a preference; there is no cache
}

SIMGPU_API CUresult cuFuncGetParamInfo(CUfunction function, std::size_t index, std::size_t* offset,
                                       std::size_t* bytes) {
    return get_param_info(function, index, offset, bytes);
}

SIMGPU_API CUresult cuKernelGetParamInfo(CUkernel kernel, std::size_t index, std::size_t* offset,
                                         std::size_t* bytes) {
    return get_param_info(as_function(kernel), index, offset, bytes);
}

SIMGPU_API CUresult cuOccupancyMaxActiveBlocksPerMultiprocessor(int* num_blocks,
                                                                CUfunction function,
                                                                int threads_per_block,
                                                                std::size_t shared_bytes) {
    return occupancy(num_blocks, function, threads_per_block);
}

SIMGPU_API CUresult cuOccupancyMaxActiveBlocksPerMultiprocessorWithFlags(int* num_blocks,
                                                                         CUfunction function,
                                                                         int threads_per_block,
                                                                         std::size_t shared_bytes,
                                                                         unsigned flags) {
    return occupancy(num_blocks, function, threads_per_block);
}
