// SPDX-License-Identifier: Apache-2.0
//
// Order on and between streams, of everything that has one.
#include "tests/interposer/check_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

TEST_CASE("Order and attributes are the same when marks overlap what is before them",
          "[interposer][twins]") {
    if (on_real_gpu()) return;  // it is what it is
    for (const char* name : {"order", "attributes"}) {
        Scenario scenario{name};
        scenario.environment = {{"SIMGPU_DEVICE", "h200"}};
        check_twin(scenario);
    }
}

TEST_CASE("Order on and between streams is the same when UrgenGo is loaded",
          "[interposer][twins]") {
    check_twin({"order"});
}

TEST_CASE("Old launches keep their order on streams that they name", "[interposer][twins][order]") {
    check_twin({"order_old_async"});
}

TEST_CASE("Old launches keep their order on the default stream", "[interposer][twins][order]") {
    check_twin({"order_old_launches"});
}

TEST_CASE("Cooperative launches keep their order", "[interposer][twins][order]") {
    check_twin({"order_cooperative"});
}

TEST_CASE("Launches for several devices keep their order", "[interposer][twins][order]") {
    check_twin({"order_multi_device"});
}

TEST_CASE("Launches for no device are refused as usual", "[interposer][twins][order]") {
    check_twin({"order_multi_device_none"});
}

TEST_CASE("Values in streams keep their order", "[interposer][twins][order]") {
    check_twin({"order_values"});
}

TEST_CASE("Batches of values keep their order", "[interposer][twins][order]") {
    check_twin({"order_batched_values"});
}

TEST_CASE("Batch of values from nowhere is refused as usual", "[interposer][twins][order]") {
    if (on_real_gpu()) return;  // driver 580.159.04 dies of it, bare
    check_twin({"order_batched_values_none"});
}

TEST_CASE("Program's own pools keep their order", "[interposer][twins][order]") {
    check_twin({"order_pools"});
}

TEST_CASE("Managed memory keeps its order", "[interposer][twins][order]") {
    check_twin({"order_managed"});
}

TEST_CASE("Events of every kind keep their order", "[interposer][twins][order]") {
    check_twin({"order_events"});
}

TEST_CASE("Semaphores of which there are none are refused as usual", "[interposer][twins][order]") {
    check_twin({"order_semaphores"});
}
