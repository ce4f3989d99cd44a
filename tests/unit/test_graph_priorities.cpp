// SPDX-License-Identifier: Apache-2.0
//
// Which graphs have one priority, and what is remembered of them.
#include <atomic>
#include <cstdint>
#include <map>
#include <thread>
#include <vector>

#include "host/exec/graph_priorities.h"
#include "tests/support/catch.h"

using namespace urgengo;

namespace {

struct Node {
    CUgraphNodeType type = CU_GRAPH_NODE_TYPE_KERNEL;
    int priority = 0;
    CUgraph child = nullptr;
};

/// Graphs whose handles are 1, 2, ...; a node's handle is its address.
std::map<std::uintptr_t, std::vector<Node>> g_graphs;

CUgraph handle(std::uintptr_t number) {
    return reinterpret_cast<CUgraph>(number);
}
CUgraphExec executable(std::uintptr_t number) {
    return reinterpret_cast<CUgraphExec>(0x5500'0000'0000 + 64 * number);
}
Node& of(CUgraphNode node) {
    return *reinterpret_cast<Node*>(node);
}

exec::DriverApi driver_with_graphs() {
    exec::DriverApi driver{};
    driver.cuGraphGetNodes = [](CUgraph graph, CUgraphNode* found, size_t* count) {
        auto& nodes = g_graphs.at(reinterpret_cast<std::uintptr_t>(graph));
        for (std::size_t i = 0; found && i < nodes.size(); ++i)
            found[i] = reinterpret_cast<CUgraphNode>(&nodes[i]);
        *count = nodes.size();
        return CUDA_SUCCESS;
    };
    driver.cuGraphNodeGetType = [](CUgraphNode node, CUgraphNodeType* type) {
        *type = of(node).type;
        return CUDA_SUCCESS;
    };
    driver.cuGraphChildGraphNodeGetGraph = [](CUgraphNode node, CUgraph* child) {
        *child = of(node).child;
        return CUDA_SUCCESS;
    };
    driver.cuGraphKernelNodeGetAttribute = [](CUgraphNode node, CUkernelNodeAttrID id,
                                              CUkernelNodeAttrValue* value) {
        REQUIRE(id == CU_LAUNCH_ATTRIBUTE_PRIORITY);
        value->priority = of(node).priority;
        return CUDA_SUCCESS;
    };
    return driver;
}

}  // namespace

TEST_CASE("Graph has one priority when all of its kernels have it", "[exec][graph_priorities]") {
    const exec::DriverApi driver = driver_with_graphs();
    const exec::GraphPriorities graphs(driver);
    const Node copy{.type = CU_GRAPH_NODE_TYPE_MEMCPY, .priority = -1}, kernel{.priority = -3},
        other{.priority = -2}, body{.type = CU_GRAPH_NODE_TYPE_CONDITIONAL},
        child{.type = CU_GRAPH_NODE_TYPE_GRAPH, .child = handle(2)};
    const auto priority_of = [&](std::vector<Node> first, std::vector<Node> second = {}) {
        g_graphs = {{1, std::move(first)}, {2, std::move(second)}};
        return graphs.of_all_kernels(handle(1));
    };
    CHECK(priority_of({kernel}) == -3);
    CHECK(priority_of({copy, kernel, kernel}) == -3);
    CHECK(priority_of({kernel, child}, {kernel, copy}) == -3);
    CHECK(priority_of({child}, {kernel}) == -3);
    CHECK(priority_of({kernel, other}) == std::nullopt);
    CHECK(priority_of({kernel, child}, {other}) == std::nullopt);
    CHECK(priority_of({kernel, body}) == std::nullopt);
    CHECK(priority_of({copy}) == std::nullopt);
    CHECK(priority_of({}) == std::nullopt);
    // A graph in itself does not exist, but must not be the end of us.
    CHECK(priority_of({kernel, child}, {kernel, child}) == std::nullopt);
}

TEST_CASE("Graph's priority is not known when the driver cannot tell", "[exec][graph_priorities]") {
    g_graphs = {{1, {Node{.priority = -3}}}};
    exec::DriverApi driver = driver_with_graphs();
    SECTION("it is too old") {
        driver.cuGraphKernelNodeGetAttribute = nullptr;
    }
    SECTION("it refuses") {
        driver.cuGraphKernelNodeGetAttribute = [](CUgraphNode, CUkernelNodeAttrID,
                                                  CUkernelNodeAttrValue*) {
            return CUDA_ERROR_INVALID_VALUE;
        };
    }
    CHECK(exec::GraphPriorities(driver).of_all_kernels(handle(1)) == std::nullopt);
}

TEST_CASE("Graphs' priorities are found until they are destroyed", "[exec][graph_priorities]") {
    const exec::DriverApi driver{};
    exec::GraphPriorities graphs(driver);
    CHECK(graphs.find(executable(1)) == std::nullopt);
    graphs.forget(executable(1));
    CHECK(graphs.keep(executable(1), -3));
    CHECK(graphs.keep(executable(2), 0));
    CHECK(graphs.find(executable(1)) == -3);
    CHECK(graphs.find(executable(2)) == 0);
    CHECK(graphs.keep(executable(1), -4));  // the handle means another graph
    CHECK(graphs.find(executable(1)) == -4);
    graphs.forget(executable(1));
    CHECK(graphs.find(executable(1)) == std::nullopt);
    CHECK(graphs.find(executable(2)) == 0);
}

TEST_CASE("Thousands of graphs come and go, and what does not fit is said",
          "[exec][graph_priorities]") {
    const exec::DriverApi driver{};
    exec::GraphPriorities graphs(driver);
    constexpr std::uintptr_t kAtOnce = 1000, kAll = 20'000;
    for (std::uintptr_t i = 0; i < kAll; ++i) {
        REQUIRE(graphs.keep(executable(i), -static_cast<int>(i % 6)));
        if (i >= kAtOnce) graphs.forget(executable(i - kAtOnce));
    }
    for (std::uintptr_t i = 0; i < kAll; ++i) {
        const auto expected =
            i + kAtOnce < kAll ? std::nullopt : std::optional(-static_cast<int>(i % 6));
        REQUIRE(graphs.find(executable(i)) == expected);
    }
    std::uintptr_t next = kAll;
    while (graphs.keep(executable(next), -1)) REQUIRE(++next < kAll + 5000);
    CHECK(graphs.find(executable(next)) == std::nullopt);
    CHECK(graphs.find(executable(next - 1)) == -1);
}

TEST_CASE("Graph is found while others come and go in other threads", "[exec][graph_priorities]") {
    const exec::DriverApi driver{};
    exec::GraphPriorities graphs(driver);
    constexpr std::uintptr_t kStays = 1, kOthers = 2000;
    REQUIRE(graphs.keep(executable(kStays), -3));
    std::atomic<int> at_work{2};
    std::vector<std::thread> threads;
    for (std::uintptr_t first : {10'000u, 20'000u})
        threads.emplace_back([&, first] {
            for (std::uintptr_t i = first; i < first + kOthers; ++i) {
                graphs.keep(executable(i), -1);
                graphs.forget(executable(i));
            }
            --at_work;
        });
    int not_found = 0;
    while (at_work > 0) not_found += graphs.find(executable(kStays)) != -3;
    for (std::thread& thread : threads) thread.join();
    CHECK(not_found == 0);
    CHECK(graphs.find(executable(10'000)) == std::nullopt);
}
