// SPDX-License-Identifier: Apache-2.0
#include "host/model/graph_name.h"

#include "tests/support/catch.h"

using urgengo::model::graph_name;
using urgengo::model::kernels_of;

TEST_CASE("A graph's name tells how many kernels it has", "[model]") {
    CHECK(graph_name(53, 0x8f3a12bc) == "(graph of 53 kernels, 8f3a12bc)");
    CHECK(graph_name(1, 7) == "(graph of 1 kernel, 00000007)");
    for (std::size_t kernels : {0, 1, 2, 53, 12345})
        CHECK(kernels_of(graph_name(kernels, 1)) == kernels);
}

TEST_CASE("What is no graph's name is one kernel", "[model]") {
    for (const char* name :
         {"", "gemm", "(graph of ", "(graph of many kernels", "(graph of 5", "(graph of 5 k",
          "(graph of 99999999999999999999 kernels, 1)", "a (graph of 5 kernels, 1)"})
        CHECK(kernels_of(name) == 1);
}
