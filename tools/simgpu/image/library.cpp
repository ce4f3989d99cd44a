// SPDX-License-Identifier: Apache-2.0
//
// Libraries and kernels: the same as modules and functions, but belonging to no context.
#include <fstream>
#include <iterator>

#include "tools/simgpu/image/function.h"

using namespace urgengo::simgpu;

namespace {

CUresult load(CUlibrary* handle, const char* image, const std::string& where) {
    if (CUresult error = require_init()) return error;
    if (handle == nullptr || image == nullptr) return CUDA_ERROR_INVALID_VALUE;
    auto library = std::make_shared<Library>();
    if (CUresult error = read_image(image, where, library->costs, library->image)) return error;
    *handle = driver().libraries.add(std::move(library));
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuLibraryLoadData(CUlibrary* library, const void* code,
                                      CUjit_option* jit_options, void** jit_values,
                                      unsigned num_jit_options, CUlibraryOption* options,
                                      void** values, unsigned num_options) {
    return load(library, static_cast<const char*>(code), "library image");
}

SIMGPU_API CUresult cuLibraryLoadFromFile(CUlibrary* library, const char* path,
                                          CUjit_option* jit_options, void** jit_values,
                                          unsigned num_jit_options, CUlibraryOption* options,
                                          void** values, unsigned num_options) {
    if (path == nullptr) return CUDA_ERROR_INVALID_VALUE;
    std::ifstream file(path);
    if (!file) return CUDA_ERROR_FILE_NOT_FOUND;
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    return load(library, text.c_str(), path);
}

SIMGPU_API CUresult cuLibraryUnload(CUlibrary handle) {
    if (CUresult error = require_init()) return error;
    if (!driver().libraries.remove(handle)) return CUDA_ERROR_INVALID_HANDLE;
    driver().functions.remove_if(
        [handle](const Function& function) { return function.library == handle; });
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuLibraryGetKernel(CUkernel* handle, CUlibrary library_handle,
                                       const char* name) {
    if (CUresult error = require_init()) return error;
    const auto library = driver().libraries.find(library_handle);
    if (!library) return CUDA_ERROR_INVALID_HANDLE;
    if (handle == nullptr || name == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (*name == '\0') return CUDA_ERROR_INVALID_VALUE;

    std::lock_guard lock(library->mutex);
    const auto found = library->kernels.find(name);
    CUkernel known = found == library->kernels.end() ? nullptr : found->second;
    if (known == nullptr) {
        auto kernel = make_function(name, library->costs.get(), library->image);
        if (!kernel) return CUDA_ERROR_NOT_FOUND;
        kernel->library = library_handle;
        known = reinterpret_cast<CUkernel>(driver().functions.add(std::move(kernel)));
        library->kernels[name] = known;
    }
    *handle = known;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuKernelGetFunction(CUfunction* handle, CUkernel kernel_handle) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    const auto kernel = find_function(reinterpret_cast<CUfunction>(kernel_handle));
    if (!kernel || kernel->library == nullptr) return CUDA_ERROR_INVALID_HANDLE;
    const auto library = driver().libraries.find(kernel->library);
    if (!library) return CUDA_ERROR_INVALID_HANDLE;
    if (handle == nullptr) return CUDA_ERROR_INVALID_VALUE;

    context = context->owner();
    std::lock_guard lock(library->mutex);
    CUfunction& known = library->functions[{kernel_handle, context}];
    if (known == nullptr || !find_function(known)) {
        auto function = make_function(kernel->name->c_str(), library->costs.get(), library->image);
        function->context = context;
        function->library = kernel->library;
        known = driver().functions.add(std::move(function));
    }
    *handle = known;
    return CUDA_SUCCESS;
}
