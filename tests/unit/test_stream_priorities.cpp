// SPDX-License-Identifier: Apache-2.0
#include "host/exec/stream_priorities.h"

#include <map>

#include "host/exec/untimed_events.h"
#include "tests/support/catch.h"

using namespace urgengo::exec;

namespace {

std::map<CUstream, int> g_priorities;
bool g_refuses = false;

DriverApi driver() {
    DriverApi api;
    api.cuStreamGetAttribute = [](CUstream s, CUstreamAttrID, CUstreamAttrValue* v) {
        v->priority = g_priorities[s];
        return CUDA_SUCCESS;
    };
    api.cuStreamSetAttribute = [](CUstream s, CUstreamAttrID, const CUstreamAttrValue* v) {
        if (g_refuses) return CUDA_ERROR_INVALID_CONTEXT;
        g_priorities[s] = v->priority;
        return CUDA_SUCCESS;
    };
    api.cuStreamGetPriority = [](CUstream s, int* p) {
        *p = g_priorities[s];
        return CUDA_SUCCESS;
    };
    return api;
}

const CUstream kA = reinterpret_cast<CUstream>(0xa0), kB = reinterpret_cast<CUstream>(0xb0);
constexpr auto kLegacy = StreamFlavor::kLegacy;

}  // namespace

TEST_CASE("Stream has its own priority again when the loan is over", "[exec][priority]") {
    g_priorities = {{kA, -2}, {kB, 0}};
    const DriverApi api = driver();
    StreamPriorities priorities(api);
    REQUIRE(priorities.lend(kA, kLegacy, -5));
    CHECK(g_priorities[kA] == -5);
    CHECK(priorities.own(kA, kLegacy) == -2);  // what the program sees
    CHECK(priorities.own(kB, kLegacy) == 0);
    priorities.give_back(kA, kLegacy);
    CHECK(g_priorities[kA] == -2);
    CHECK_FALSE(priorities.lend(kA, kLegacy, -2));  // nothing to lend
}

TEST_CASE("Last of two lenders restores the stream's own priority", "[exec][priority]") {
    g_priorities = {{kA, -1}};
    const DriverApi api = driver();
    StreamPriorities priorities(api);
    REQUIRE(priorities.lend(kA, kLegacy, -5));
    REQUIRE(priorities.lend(kA, kLegacy, -3));
    priorities.give_back(kA, kLegacy);
    CHECK(g_priorities[kA] == -3);
    CHECK(priorities.own(kA, kLegacy) == -1);
    priorities.give_back(kA, kLegacy);
    CHECK(g_priorities[kA] == -1);
}

TEST_CASE("Program's new priority is what a lent stream gets back", "[exec][priority]") {
    g_priorities = {{kA, 0}};
    const DriverApi api = driver();
    StreamPriorities priorities(api);
    REQUIRE(priorities.lend(kA, kLegacy, -5));
    priorities.set_by_program(kA, kA, kLegacy, [] {
        g_priorities[kA] = -4;
        return CUDA_SUCCESS;
    });
    priorities.give_back(kA, kLegacy);
    CHECK(g_priorities[kA] == -4);
}

TEST_CASE("Copied attributes are the program's own when the one to copy from is lent another",
          "[exec][priority]") {
    g_priorities = {{kA, -1}, {kB, 0}};
    const DriverApi api = driver();
    StreamPriorities priorities(api);
    REQUIRE(priorities.lend(kA, kLegacy, -5));
    priorities.set_by_program(kB, kA, kLegacy, [] {
        g_priorities[kB] = g_priorities[kA];
        return CUDA_SUCCESS;
    });
    CHECK(g_priorities[kB] == -1);
    priorities.give_back(kA, kLegacy);
    CHECK(g_priorities[kA] == -1);
}

TEST_CASE("Loan that could not be given back is not the next stream's of that handle",
          "[exec][priority]") {
    g_priorities = {{kA, -1}};
    static bool refuses;
    refuses = false;
    DriverApi api = driver();
    api.cuStreamSetAttribute = [](CUstream s, CUstreamAttrID, const CUstreamAttrValue* v) {
        if (refuses) return CUDA_ERROR_LAUNCH_FAILED;
        g_priorities[s] = v->priority;
        return CUDA_SUCCESS;
    };
    StreamPriorities priorities(api);
    REQUIRE(priorities.lend(kA, kLegacy, -5));
    refuses = true;
    priorities.give_back(kA, kLegacy);
    CHECK(priorities.own(kA, kLegacy) == -1);
    priorities.forget(kA);  // destroyed, and made again
    g_priorities[kA] = -3;
    CHECK(priorities.own(kA, kLegacy) == -3);
}

TEST_CASE("Lent stream has its own priority at once when something copies it", "[exec][priority]") {
    g_priorities = {{kA, -1}};
    const DriverApi api = driver();
    StreamPriorities priorities(api);
    REQUIRE(priorities.lend(kA, kLegacy, -5));
    priorities.restore(kA, kLegacy);
    CHECK(g_priorities[kA] == -1);
    priorities.give_back(kA, kLegacy);
    CHECK(g_priorities[kA] == -1);
}

TEST_CASE("Nothing is lent when the driver cannot say or set a priority", "[exec][priority]") {
    g_priorities = {{kA, -1}};
    DriverApi api = driver();
    api.cuStreamSetAttribute = [](CUstream, CUstreamAttrID, const CUstreamAttrValue*) {
        return CUDA_ERROR_NOT_SUPPORTED;
    };
    StreamPriorities refused(api);
    CHECK_FALSE(refused.lend(kA, kLegacy, -5));
    refused.give_back(kA, kLegacy);
    CHECK(g_priorities[kA] == -1);
    const DriverApi none;
    StreamPriorities old_driver(none);
    CHECK_FALSE(old_driver.lend(kA, kLegacy, -5));
    CHECK(old_driver.own(kA, kLegacy) == 0);
}

TEST_CASE("Event counts as timing unless it is known to be made without", "[exec][events]") {
    UntimedEvents events;
    const CUevent timed = reinterpret_cast<CUevent>(0x10),
                  untimed = reinterpret_cast<CUevent>(0x20);
    events.created(timed, CU_EVENT_DEFAULT);
    events.created(untimed, CU_EVENT_DISABLE_TIMING | CU_EVENT_BLOCKING_SYNC);
    CHECK_FALSE(events.contains(timed));
    CHECK(events.contains(untimed));
    CHECK_FALSE(events.contains(nullptr));
    events.destroyed(untimed);
    CHECK_FALSE(events.contains(untimed));  // its handle may come to mean another
}

TEST_CASE("What the driver refused to take back is given back when it is asked to once more",
          "[exec][priority]") {
    g_priorities = {{kA, -1}, {kB, -2}};
    const DriverApi api = driver();
    StreamPriorities priorities(api);
    REQUIRE(priorities.lend(kA, kLegacy, -5));
    REQUIRE(priorities.lend(kB, kLegacy, -5));
    g_refuses = true;
    priorities.give_back(kA, kLegacy);
    priorities.give_back_refused();
    CHECK(g_priorities[kA] == -5);
    CHECK(priorities.own(kA, kLegacy) == -1);
    g_refuses = false;
    priorities.give_back_refused();
    CHECK(g_priorities[kA] == -1);
    CHECK(g_priorities[kB] == -5);  // a launch is under way there
    priorities.give_back(kB, kLegacy);
    CHECK(g_priorities[kB] == -2);
}
