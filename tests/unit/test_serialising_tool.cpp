// SPDX-License-Identifier: Apache-2.0
#include "host/base/serialising_tool.h"

#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include "tests/support/catch.h"

using urgengo::serialising_tool;
using urgengo::tool_signs;

namespace {

/// @returns the tool; empty: none
std::string tool_of(const std::vector<std::string>& libraries, const std::string& tracer = "") {
    const char* const tool = serialising_tool({libraries, tracer});
    return tool ? tool : "";
}

enum Found : int { kNothing, kTool, kNoTracer };

/// @returns what a child process finds that this one traces, with this name
int found_by_traced_child(const char* name) {
    char before[16] = "";
    prctl(PR_GET_NAME, before);
    prctl(PR_SET_NAME, name);
    const pid_t child = fork();
    if (child == 0) {
        if (ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) != 0) _exit(kNoTracer);
        _exit(serialising_tool(tool_signs()) ? kTool : kNothing);
    }
    int status = 0;
    waitpid(child, &status, 0);
    prctl(PR_SET_NAME, before);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace

TEST_CASE("A tool that serialises kernels is known by its libraries, or as the tracer",
          "[base][serialising_tool]") {
    CHECK(tool_of({"/lib/libc.so.6", "/a/libsanitizer-public.so"}) == "compute-sanitizer");
    CHECK(tool_of({"/a/libsanitizer-collection.so"}) == "compute-sanitizer");
    CHECK(tool_of({"libsanitizer-public.so"}) == "compute-sanitizer");
    CHECK(tool_of({"/a/target/linux-desktop-glibc_2_11_3-x64/libcuda-injection.so"}) ==
          "Nsight Compute");
    CHECK(tool_of({}, "cuda-gdb") == "cuda-gdb");
    CHECK(tool_of({}, "cuda-gdb-python") == "cuda-gdb");
}

TEST_CASE("Tools that serialise nothing are no reason to close no gate",
          "[base][serialising_tool]") {
    CHECK(tool_of({}) == "");
    // Nsight Systems, CUPTI; what several tools have in common.
    CHECK(tool_of({"/a/libToolsInjection64.so", "/a/libcupti.so.13", "libnvperf_target.so",
                   "/a/libInterceptorInjectionTarget.so",
                   "/a/libTreeLauncherTargetInjection.so"}) == "");
    CHECK(tool_of({"/compute-sanitizer/libcuda.so.1", "/libsanitizer-public.so/libm.so.6"}) == "");
    CHECK(tool_of({}, "gdb") == "");
    CHECK(tool_of({}, "strace") == "");
}

TEST_CASE("Signs of tools are what this process has, and who traces it",
          "[base][serialising_tool]") {
    const auto signs = tool_signs();
    CHECK(std::any_of(signs.libraries.begin(), signs.libraries.end(), [](const auto& library) {
        return library.find("libc.so") != std::string::npos;
    }));
    CHECK(serialising_tool(signs) == nullptr);
    SECTION("a library that the driver is about to load") {
        setenv("CUDA_INJECTION64_PATH", "/a/libsanitizer-collection.so", 1);
        CHECK(serialising_tool(tool_signs()) != nullptr);
        unsetenv("CUDA_INJECTION64_PATH");
    }
    SECTION("a tracer") {
        const int found = found_by_traced_child("cuda-gdb-minima");
        if (found == kNoTracer) return;  // it may not be traced here
        CHECK(found == kTool);
        CHECK(found_by_traced_child("gdb") == kNothing);
    }
}
