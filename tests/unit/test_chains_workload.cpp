// SPDX-License-Identifier: Apache-2.0
//
// workload.json: what is written is read back, and what is wrong is named.
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "tests/support/catch.h"
#include "tools/chains/workload.h"

using namespace urgengo::chains;

namespace {

Workload sample_workload() {
    Workload workload;
    workload.gpu = "Some \"GPU\"";
    workload.driver = "580.159.04";
    workload.num_sms = 132;
    workload.seed = 7;
    workload.umin = 0.3;
    workload.umax = 1.0;
    const Kernel compute{KernelKind::kCompute, 300, 256, 1234, 60.5, 0.61};
    const Kernel memory{KernelKind::kMemory, 12, 128, 9, 4.25, 0.3};
    workload.variable = true;
    workload.chains = {
        {"C0", 150, 120, {{"detect3d", 8.7, 13.4, 22000, 25000, {compute, memory}}}}};
    return workload;
}

/// The sample as JSON with `value` at `pointer`.
std::string changed(const char* pointer, const nlohmann::json& value) {
    auto json = nlohmann::json::parse(format_workload(sample_workload()));
    json[nlohmann::json::json_pointer(pointer)] = value;
    return json.dump();
}

/// @returns what parse_workload() complains about; empty if it does not
std::string complaint(const std::string& text) {
    try {
        parse_workload(text);
    } catch (const std::runtime_error& error) {
        return error.what();
    }
    return "";
}

bool contains(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("Workload is the same when written and read back", "[unit][chains]") {
    const Workload read = parse_workload(format_workload(sample_workload()));
    CHECK(read.gpu == "Some \"GPU\"");
    CHECK(read.driver == "580.159.04");
    CHECK(read.num_sms == 132);
    REQUIRE(read.chains.size() == 1);
    CHECK(read.chains[0].period_ms == 150);
    CHECK(read.chains[0].deadline_ms == 120);
    const Task& task = read.chains[0].tasks.at(0);
    CHECK(task.name == "detect3d");
    CHECK(read.variable);
    CHECK(task.cpu_ms == 8.7);
    CHECK(task.min_inputs == 22000);
    CHECK(task.max_inputs == 25000);
    CHECK(task.isolated_ms == 13.4);
    REQUIRE(task.kernels.size() == 2);
    CHECK(task.kernels[0].iterations == 1234);
    CHECK(task.kernels[0].grid == 300);
    CHECK(task.kernels[0].est_us == 60.5);
    CHECK(task.kernels[1].kind == KernelKind::kMemory);
    CHECK(task.kernels[1].block == 128);
    CHECK(format_workload(read) == format_workload(sample_workload()));
}

TEST_CASE("parse_workload names place, finding and what is accepted when a value is wrong",
          "[unit][chains]") {
    const std::string kernel = "workload.chains[0].tasks[0].kernels[1]";
    CHECK(contains(complaint("chains:"), "not JSON"));
    CHECK(contains(complaint("[]"), "no key \"format_version\""));
    CHECK(complaint(changed("/format_version", 1)) ==
          "format_version: found 1, accepted: 2 (calibrate again)");
    CHECK(complaint(changed("/chains", nlohmann::json::array())) ==
          "workload.chains: found [], accepted: a list with an entry");
    CHECK(complaint(changed("/chains/0/tasks/0/kernels/1/grid", 0)) ==
          kernel + ".grid: found 0, accepted: 1 to 16777216");
    CHECK(contains(complaint(changed("/chains/0/tasks/0/kernels/1/grid", "many")),
                   kernel + ".grid: found \"many\""));
    CHECK(complaint(changed("/chains/0/tasks/0/kernels/1/kernel", "gemm")) ==
          kernel + ".kernel: found \"gemm\", accepted: chains_comp, chains_mem");
    CHECK(complaint(changed("/chains/0/tasks/0/max_inputs", 21999)) ==
          "workload.chains[0].tasks[0].max_inputs: found 21999, accepted: 22000 to 16777216");
    CHECK(contains(complaint(changed("/chains/0/period_ms", -1)),
                   "workload.chains[0].period_ms: found -1"));
}

TEST_CASE("parse_workload refuses names that YAML or a thread cannot carry", "[unit][chains]") {
    CHECK(complaint(changed("/chains/0/name", "Front1")).empty());
    CHECK(contains(complaint(changed("/chains/0/name", "a: b")), ".name: found \"a: b\""));
    CHECK(contains(complaint(changed("/chains/0/name", "")), ".name: found \"\""));
    CHECK(contains(complaint(changed("/chains/0/name", "1e3")), ".name: found \"1e3\""));
    CHECK(contains(complaint(changed("/chains/0/name", "chain_zero")), "at most 15 bytes"));
}

TEST_CASE("scaled_grid follows the input and keeps a block", "[unit][chains]") {
    const Kernel kernel{KernelKind::kCompute, 300, 256, 1, 1, 1};
    CHECK(scaled_grid(kernel, 1) == 300);
    CHECK(scaled_grid(kernel, 22000 / 43500.0) == 152);
    CHECK(scaled_grid(kernel, 65000 / 43500.0) == 448);
    CHECK(scaled_grid({KernelKind::kCompute, 1, 256, 1, 1, 1}, 0.1) == 1);
}
