// SPDX-License-Identifier: Apache-2.0
//
// Reading cost tables.
#include "tests/support/catch.h"
#include "tools/simgpu/engine/cost_table.h"

using namespace urgengo::simgpu;

namespace {

std::string error_of(const std::string& json) {
    const auto table = CostTable::parse(json, "t.json");
    return table ? "" : table.error();
}

}  // namespace

TEST_CASE("CostTable reads every key when the table is valid", "[unit][simgpu]") {
    const auto table = CostTable::parse(
        R"({"kernels":[{"name":"a","block_ns":1000},
                       {"name":"b","block_ns_per_unit":1.5,"unit_arg":2,"unit_bytes":8,
                        "blocks_per_sm":6,"param_bytes":[8,4,8]}],
            "default":{"block_ns":7}})",
        "t.json");
    REQUIRE(table);
    const KernelCost* a = table->find("a");
    REQUIRE(a != nullptr);
    CHECK(a->block_ns == 1000);
    CHECK_FALSE(a->needs_units());
    CHECK(a->blocks_per_sm == 0);
    const KernelCost* b = table->find("b");
    REQUIRE(b != nullptr);
    CHECK(b->block_ns == 0);
    CHECK(b->block_ns_per_unit == 1.5);
    CHECK(b->unit_arg == 2);
    CHECK(b->unit_bytes == 8);
    CHECK(b->blocks_per_sm == 6);
    CHECK(b->param_bytes == std::vector<std::size_t>{8, 4, 8});
    REQUIRE(table->fallback());
    CHECK(table->fallback()->block_ns == 7);
    CHECK(table->find("c") == nullptr);
}

TEST_CASE("CostTable names the place and what is accepted when it refuses", "[unit][simgpu]") {
    CHECK(error_of(R"({"kernels":[{"name":"a","block_ns":-1}]})") ==
          "t.json: kernels[0].block_ns: found -1, accepted: nanoseconds, 0 to 1e15");
    CHECK(error_of(R"({"kernels":[{"name":"a"},{"block_ns":1}]})") ==
          R"(t.json: kernels[1]: found {"block_ns":1}, accepted: an object with a name)");
    CHECK(error_of(R"({"kernels":[{"name":"a","unit_bytes":3}]})") ==
          "t.json: kernels[0].unit_bytes: found 3, accepted: 1, 2, 4, 8");
    CHECK(error_of(R"({"kernels":[{"name":"a","blocks_per_sm":17}]})") ==
          "t.json: kernels[0].blocks_per_sm: found 17, accepted: a whole number from 1 to 16");
    CHECK(error_of(R"({"default":{"blocks":1}})") ==
          R"(t.json: default: found "blocks", accepted: the keys block_ns, block_ns_per_unit, )"
          "unit_arg, unit_bytes, blocks_per_sm, stamps_arg, param_bytes");
    CHECK(error_of(R"({"kernel":[]})") ==
          R"(t.json: the table: found "kernel", accepted: the keys kernels, default)");
}

TEST_CASE("CostTable says where when the text is not JSON", "[unit][simgpu]") {
    const std::string error = error_of("{\n \"kernels\": [}");
    CHECK(error.find("t.json: ") == 0);
    CHECK(error.find("line 2") != std::string::npos);
}

TEST_CASE("Parameters are aligned to their size when they are laid out", "[unit][simgpu]") {
    const std::vector<std::size_t> sizes{4, 8, 1, 2, 12, 16};
    CHECK(layout_params(sizes) == std::vector<std::size_t>{0, 8, 16, 18, 20, 32});
}
