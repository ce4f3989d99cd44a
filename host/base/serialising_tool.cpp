// SPDX-License-Identifier: Apache-2.0
#include "host/base/serialising_tool.h"

#include <cstdlib>
#include <fstream>
#include <string_view>

#include "host/base/mapped_libraries.h"

namespace urgengo {
namespace {

struct Sign {
    std::string_view name;  ///< begins with this
    const char* tool;
};

constexpr Sign kLibraries[] = {{"libsanitizer-collection.so", "compute-sanitizer"},
                               {"libsanitizer-public.so", "compute-sanitizer"},
                               {"libcuda-injection.so", "Nsight Compute"}};
// Its script starts programs that are called cuda-gdb-minimal and the like.
constexpr Sign kTracer = {"cuda-gdb", "cuda-gdb"};

std::string_view name_of(std::string_view path) {
    return path.substr(path.rfind('/') + 1);
}

std::string name_of_tracer() {
    constexpr std::string_view kKey = "TracerPid:";
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);) {
        if (!line.starts_with(kKey)) continue;
        const int process = std::atoi(line.c_str() + kKey.size());
        std::string name;
        if (process != 0)
            std::getline(std::ifstream("/proc/" + std::to_string(process) + "/comm"), name);
        return name;
    }
    return {};
}

}  // namespace

const char* serialising_tool(const ToolSigns& signs) {
    for (const std::string& library : signs.libraries)
        for (const Sign& sign : kLibraries)
            if (name_of(library).starts_with(sign.name)) return sign.tool;
    return signs.tracer.starts_with(kTracer.name) ? kTracer.tool : nullptr;
}

ToolSigns tool_signs() {
    ToolSigns signs{mapped_libraries(), name_of_tracer()};
    if (const char* const injected = std::getenv("CUDA_INJECTION64_PATH"))
        signs.libraries.emplace_back(injected);
    return signs;
}

}  // namespace urgengo
