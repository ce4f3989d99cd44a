// SPDX-License-Identifier: Apache-2.0
//
// What kernels, graphs, threads, streams and ranges are known by, without a runtime.
#include "host/base/hash.h"
#include "host/identity/kernels.h"
#include "host/identity/served_chains.h"
#include "host/identity/stream_owners.h"
#include "host/identity/task_names.h"
#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using identity::KernelsOfThread;
using identity::KnownKernel;

namespace {

const auto kGemm = reinterpret_cast<CUfunction>(0x20);
const auto kExecutable = reinterpret_cast<CUgraphExec>(0x50);
const auto kGraph = reinterpret_cast<CUgraph>(0x60);

struct IdentityNamesTest {
    IdentityNamesTest() {
        driver.names[kConv] = "conv_3x3";
        driver.names[kGemm] = "gemm";
    }
    KnownKernel& find(CUfunction function) {
        return kernels.find(thread, cursor, {.function = function});
    }
    std::uint64_t hash_of_graph() {
        return kernels.find(thread, cursor, {.graph = kExecutable}).name_hash;
    }

    FakeDriver driver;
    identity::Kernels kernels{driver.api, nullptr};
    KernelsOfThread thread;
    observe::TraceCursor cursor;
};

}  // namespace

TEST_CASE("Kernels asks for a name once a thread, until handles may mean others",
          "[identity][kernels]") {
    IdentityNamesTest f;
    for (int i = 0; i < 3; ++i) CHECK(f.find(kConv).name_hash == fnv1a64("conv_3x3"));
    CHECK(f.driver.num_name_queries == 1);
    f.driver.names[kConv] = "other";
    f.kernels.forget();
    CHECK(f.find(kConv).name_hash == fnv1a64("other"));
}

TEST_CASE("Kernels knows whether the process has launched one", "[identity][kernels]") {
    IdentityNamesTest f;
    CHECK(f.find(kConv).is_new);
    KernelsOfThread other;
    CHECK_FALSE(f.kernels.find(other, f.cursor, {.function = kConv}).is_new);
    f.kernels.forget();
    CHECK(f.find(kConv).is_new);
}

TEST_CASE("Kernels knows which tasks begin with a kernel", "[identity][kernels]") {
    IdentityNamesTest f;
    f.kernels.add_task(3, {{.name_glob = "conv*"}, {.name_glob = "x*"}});
    f.kernels.add_task(5, {{.name_glob = "*"}});
    REQUIRE(f.find(kConv).begins);
    CHECK((f.find(kConv).begins->contains(3) && f.find(kConv).begins->contains(5)));
    CHECK_FALSE(f.find(kGemm).begins->contains(3));
    KernelsOfThread other;  // sets that are equal are one
    CHECK(f.kernels.find(other, f.cursor, {.function = kConv}).begins == f.find(kConv).begins);
}

TEST_CASE("Kernels reads no name while another thread unloads, and then does",
          "[identity][kernels]") {
    IdentityNamesTest f;
    f.find(kGemm);
    {
        const identity::NameGate::Unloading unloading(&f.kernels.gate());
        CHECK(f.find(kConv).name_hash == 0);
    }
    CHECK(f.find(kConv).name_hash == fnv1a64("conv_3x3"));
}

TEST_CASE("Kernels looks into graphs where their names matter, and names them by that",
          "[identity][kernels][graphs]") {
    IdentityNamesTest f;
    CHECK_FALSE(f.kernels.looks_into_graphs());
    f.kernels.look_into_graphs();
    REQUIRE(f.kernels.looks_into_graphs());
    const std::uint64_t unknown = f.hash_of_graph();
    f.driver.nodes = {{kConv, 100, 256}, {kGemm, 5, 128}};
    const auto make = [&] {
        f.kernels.graph_destroyed(kExecutable);
        f.kernels.graph_instantiated(kExecutable, kGraph, nullptr);
        f.kernels.forget();
        return f.hash_of_graph();
    };
    const std::uint64_t known = make();
    CHECK(known != unknown);
    std::swap(f.driver.nodes[0], f.driver.nodes[1]);  // not by the order of handles
    f.driver.nodes[0].grid = 7;                       // nor by grids, which updates change
    CHECK(make() == known);
    f.driver.nodes[0].block = 64;
    CHECK(make() != known);
    f.kernels.graph_destroyed(kExecutable);
    CHECK_FALSE(f.kernels.graphs().find(kExecutable));
}

TEST_CASE("Kernels makes threads look again where a handle means another graph",
          "[identity][kernels][graphs]") {
    IdentityNamesTest f;
    const auto epoch = f.kernels.epoch();
    f.kernels.graph_instantiated(kExecutable, kGraph, nullptr);
    CHECK(f.kernels.epoch() == epoch);
    f.kernels.graph_instantiated(kExecutable, kGraph, nullptr);
    CHECK(f.kernels.epoch() != epoch);
}

TEST_CASE("TaskNames knows which tasks a thread may work for", "[identity][names]") {
    identity::TaskNames names;
    names.add_task(0, {"a", "cam*"}, false);
    names.add_task(1, {"b", "camera"}, false);
    names.add_task(2, {"c", "cam*"}, true);                             // its chain is off
    names.add_task(3, {"d", "cam*", "range*"}, false);                  // known by its range alone
    names.add_task(4, {"e", {}, {}, {{.name_glob = "conv*"}}}, false);  // by a kernel of any thread
    names.add_task(5, {"f"}, false);                                    // by hints
    identity::NamedThread thread;
    {
        const ThreadName as("camera");
        names.read(thread);
    }
    REQUIRE(thread.num_candidates == 3);
    CHECK((thread.candidates[0] == 0 && thread.candidates[1] == 1 && thread.candidates[2] == 4));
    const ThreadName as("lidar");
    names.read(thread);
    REQUIRE(thread.num_candidates == 1);
    CHECK(thread.candidates[0] == 4);
    CHECK(names.knows_ranges());
    CHECK(names.task_of_range("range 1") == 3);
    CHECK(names.task_of_range("camera") == -1);
    CHECK(names.unmatched().empty());
}

TEST_CASE("TaskNames is the more patient the longer a name stays", "[identity][names]") {
    identity::TaskNames names;
    names.add_task(0, {"a", "cam*"}, false);
    CHECK_FALSE(names.knows_ranges());
    identity::NamedThread thread;
    const ThreadName as("lidar");
    for (int i = 0; i < 3; ++i) names.read(thread);
    CHECK(thread.patience == 3);
    CHECK(thread.num_candidates == 0);
    for (int i = 0; i < 2000; ++i) names.read(thread);
    CHECK(thread.patience == 1024);
    CHECK(names.unmatched() == std::vector<std::string>{"lidar"});
    const ThreadName renamed("camera");
    names.read(thread);
    CHECK(thread.patience == 1);
    CHECK(thread.num_candidates == 1);
}

TEST_CASE("StreamOwners knows streams of one task, and none of two", "[identity][streams]") {
    identity::StreamOwners owners;
    CHECK(owners.owner(kStreamA) == -1);
    owners.used_by(kStreamA, 4);
    owners.used_by(kStreamA, 4);
    CHECK(owners.owner(kStreamA) == 4);
    owners.used_by(kStreamA, 5);
    owners.used_by(kStreamA, 4);
    CHECK(owners.owner(kStreamA) == -1);
    owners.forget(kStreamA);
    owners.used_by(kStreamA, 5);
    CHECK(owners.owner(kStreamA) == 5);
}

TEST_CASE("ServedChains forgets a chain that its thread has left", "[identity][served_chains]") {
    identity::ServedChains served;
    const auto serves = [&](std::chrono::nanoseconds now) {
        std::vector<int> chains;
        served.for_each(
            now, [](int) { return 10ms; }, [&](int i) { chains.push_back(i); });
        return chains;
    };
    served.serve(2, 0ms);
    served.serve(0, 30ms);
    CHECK(serves(40ms) == std::vector{0, 2});
    CHECK(serves(41ms) == std::vector{0});
    CHECK(serves(71ms).empty());
    served.serve(2, 80ms);
    CHECK(serves(80ms) == std::vector{2});
}
