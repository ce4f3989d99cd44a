// SPDX-License-Identifier: Apache-2.0
//
// A program that calls an entry point which not every driver has. Linked twice: with all its names
// looked up at its start (-z now), and each at its first call (-z lazy). Says which functions
// answered: stub_driver.cpp, and not with what, which there depends on arguments that these lack.
#include <cuda.h>
#include <cudaProfiler.h>

#include <cstdio>
#include <cstring>

namespace {

void say(const char* name, CUresult answer) {
    std::printf("%s: function %d\n", name, static_cast<int>(answer) / 1000);
}

}  // namespace

int main(int argc, char** argv) {
    setvbuf(stdout, nullptr, _IONBF, 0);
    say("cuInit", cuInit(0));
    if (argc > 1 && std::strcmp(argv[1], "call") == 0)
        say("cuLaunchKernelEx", cuLaunchKernelEx(nullptr, nullptr, nullptr, nullptr));
    say("cuProfilerStop", cuProfilerStop());
}
