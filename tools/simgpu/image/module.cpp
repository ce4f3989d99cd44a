// SPDX-License-Identifier: Apache-2.0
//
// Modules. Any image loads, and has every function that is asked for, unless it lists its own.
#include <fstream>
#include <iterator>

#include "tools/simgpu/api/stack_use.h"
#include "tools/simgpu/graph/capture.h"
#include "tools/simgpu/image/function.h"

using namespace urgengo::simgpu;

namespace {

CUresult load(CUmodule* handle, const char* image, const std::string& where) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (handle == nullptr || image == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = require_safe_call()) return error;
    use_stack_of_large_call();
    auto module = std::make_shared<Module>();
    module->context = context->owner();
    if (CUresult error = read_image(image, where, module->costs, module->image)) return error;
    *handle = driver().modules.add(std::move(module));
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuModuleLoadData(CUmodule* module, const void* image) {
    return load(module, static_cast<const char*>(image), "module image");
}

SIMGPU_API CUresult cuModuleLoadDataEx(CUmodule* module, const void* image, unsigned num_options,
                                       CUjit_option* options, void** option_values) {
    return cuModuleLoadData(module, image);
}

SIMGPU_API CUresult cuModuleLoadFatBinary(CUmodule* module, const void* image) {
    return cuModuleLoadData(module, image);
}

SIMGPU_API CUresult cuModuleLoad(CUmodule* module, const char* path) {
    if (path == nullptr) return CUDA_ERROR_INVALID_VALUE;
    std::ifstream file(path);
    if (!file) return CUDA_ERROR_FILE_NOT_FOUND;
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    return load(module, text.c_str(), path);
}

SIMGPU_API CUresult cuModuleUnload(CUmodule handle) {
    if (CUresult error = require_init()) return error;
    if (CUresult error = require_safe_call()) return error;
    const auto module = driver().modules.remove(handle);
    if (!module) return CUDA_ERROR_INVALID_HANDLE;
    synchronize(*module->context);
    driver().functions.remove_if(
        [handle](const Function& function) { return function.module == handle; });
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuModuleGetFunction(CUfunction* handle, CUmodule module_handle,
                                        const char* name) {
    if (CUresult error = require_init()) return error;
    const auto module = driver().modules.find(module_handle);
    if (!module) return CUDA_ERROR_INVALID_HANDLE;
    if (handle == nullptr || name == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (*name == '\0') return CUDA_ERROR_INVALID_VALUE;

    std::lock_guard lock(module->mutex);
    const auto found = module->functions.find(name);
    CUfunction known = found == module->functions.end() ? nullptr : found->second;
    if (known == nullptr) {
        auto function = make_function(name, module->costs.get(), module->image);
        if (!function) return CUDA_ERROR_NOT_FOUND;
        function->context = module->context;
        function->module = module_handle;
        known = driver().functions.add(std::move(function));
        module->functions[name] = known;
    }
    *handle = known;
    return CUDA_SUCCESS;
}
