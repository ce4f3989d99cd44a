// SPDX-License-Identifier: Apache-2.0
#include "host/exec/cupti_library.h"

#include <algorithm>

#include "tests/support/catch.h"

using namespace urgengo::exec;

namespace {

std::ptrdiff_t place(const std::vector<std::string>& files, const std::string& file) {
    const auto found = std::find(files.begin(), files.end(), file);
    return found == files.end() ? -1 : found - files.begin();
}

}  // namespace

TEST_CASE("libcupti that was asked for comes first, then the program's own, then toolkits'",
          "[exec][cupti]") {
    const auto files =
        cupti_candidates("/mine/libcupti.so",
                         {"/usr/lib/libc.so.6", "/env/site-packages/torch/lib/libtorch_cuda.so",
                          "/opt/cuda-12/lib64/libcudart.so.12"},
                         "/home/cuda");
    CHECK(place(files, "/mine/libcupti.so") == 0);
    const auto wheel = place(files, "/env/site-packages/nvidia/cuda_cupti/lib/libcupti.so.12");
    const auto wheel13 = place(files, "/env/site-packages/nvidia/cu13/lib/libcupti.so.13");
    const auto toolkit = place(files, "/opt/cuda-12/extras/CUPTI/lib64/libcupti.so.12");
    const auto home = place(files, "/home/cuda/extras/CUPTI/lib64/libcupti.so");
    const auto usual = place(files, "/usr/local/cuda/extras/CUPTI/lib64/libcupti.so.13");
    CHECK(wheel13 > 0);
    CHECK(wheel > wheel13);
    CHECK(toolkit > wheel);
    CHECK(home > toolkit);
    CHECK(usual > home);
    CHECK(place(files, "libcupti.so.13") > usual);  // where the loader looks
}

TEST_CASE("libcupti is looked for beside NVIDIA's wheels, and each place once", "[exec][cupti]") {
    const auto files = cupti_candidates("",
                                        {"/p/nvidia/cublas/lib/libcublas.so.12",
                                         "/p/nvidia/cudnn/lib/libcudnn.so.9", "/p/lib/libother.so"},
                                        "");
    CHECK(place(files, "/p/nvidia/cuda_cupti/lib/libcupti.so.12") >= 0);
    CHECK(place(files, "/p/nvidia/cu13/lib/libcupti.so.13") >= 0);
    auto sorted = files;
    std::sort(sorted.begin(), sorted.end());
    CHECK(std::unique(sorted.begin(), sorted.end()) == sorted.end());
}
