// SPDX-License-Identifier: Apache-2.0
//
// Tools that may run a program's kernels one after the other, or stop the GPU. Under one of them
// what opens a gate may never come to the GPU, so none is closed (config/dispatch_choice.h).
//
//   1 Known by their libraries, whose names are in their packages: compute-sanitizer
//     (libsanitizer-collection.so, libsanitizer-public.so) and Nsight Compute
//     (libcuda-injection.so, whose replay of kernels serialises them).
//     libInterceptorInjectionTarget.so and libTreeLauncher*.so are no sign: other tools have them,
//     too. Variables are none either: those that these tools set are not documented, but for
//     CUDA_INJECTION64_PATH, which names a library that the driver is about to load.
//   2 cuda-gdb is known as the process that traces this one, if it has started it, or was attached
//     before UrgenGo began. What it asks of launches (`set cuda launch_blocking`) cannot be read.
//   3 Nsight Systems, and CUPTI's CONCURRENT_KERNEL, do not serialise. CUPTI's KERNEL does, and
//     cannot be known: a tool asks for either by the same library.
#pragma once

#include <string>
#include <vector>

namespace urgengo {

struct ToolSigns {
    std::vector<std::string> libraries;  ///< paths: of those loaded, or about to be
    std::string tracer;                  ///< name of the process that traces; empty: none does
};

/// @returns the tool that is known by one of the signs; null: none is
const char* serialising_tool(const ToolSigns& signs);

/// @returns the signs in this process
/// @threads any; reads /proc
ToolSigns tool_signs();

}  // namespace urgengo
