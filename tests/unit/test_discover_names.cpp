// SPDX-License-Identifier: Apache-2.0
//
// Names and patterns made of what programs contain.
#include "tools/discover/names.h"

#include "tests/support/catch.h"

namespace urgengo::discover {
namespace {

TEST_CASE("Kernel's short name is what one would say when it is mangled or not",
          "[tools][discover]") {
    CHECK(short_kernel_name("conv2d") == "conv2d");
    CHECK(short_kernel_name("_Z4convPfi") == "conv");
    CHECK(short_kernel_name("_ZN2at6native6kernelIfLi4EEEvPT_") == "kernel");
    CHECK(short_kernel_name("_ZN12_GLOBAL__N_16detectEPf") == "detect");
    CHECK(short_kernel_name("void cutlass::Kernel<A<B>>(P)") == "Kernel");
    CHECK(short_kernel_name("sm80_xmma_gemm_f32f32") == "sm80_xmma_gemm_f32f32");
    CHECK(short_kernel_name("(graph)") == "(graph)");
    CHECK(short_kernel_name("") == "");
}

TEST_CASE("Readable name is fit for a chain when the text is odd", "[tools][discover]") {
    CHECK(readable("lidar 0: front") == "lidar_0_front");
    CHECK(readable("__x__") == "__x");
    CHECK(readable("((") == "chain");
    CHECK(readable("") == "chain");
    CHECK(readable(std::string(100, 'a')).size() == 32);
    std::vector<std::string> taken;
    CHECK(unique_name("a", taken) == "a");
    CHECK(unique_name("a", taken) == "a_2");
    CHECK(unique_name("a_2", taken) == "a_2_2");
    CHECK(unique_name("a", taken) == "a_3");
}

TEST_CASE("Escaped pattern matches its text and no other when it has special characters",
          "[tools][discover]") {
    for (const std::string text : {"a*b", "what?", "[x]", "back\\slash", "plain"}) {
        CHECK(matches_glob(escape_glob(text), text));
    }
    CHECK_FALSE(matches_glob(escape_glob("a*b"), "axb"));
    CHECK(matches_glob(escape_glob("caf\xc3\xa9"), "caf\xc3\xa9"));
    CHECK(yaml_quoted("a\"b\\c\n") == "\"a\\\"b\\\\c?\"");
    CHECK(printable("a\nb") == "a?b");
}

}  // namespace
}  // namespace urgengo::discover
