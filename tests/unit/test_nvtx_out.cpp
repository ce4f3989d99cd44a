// SPDX-License-Identifier: Apache-2.0
//
// Another NVTX tool's calls, as the thread makes them. What they tell: tests/interposer.
#include "host/observe/nvtx_out.h"

#include <pthread.h>

#include <functional>
#include <string>

#include "host/observe/nvtx_slots.h"
#include "tests/support/steering_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

/// A tool that takes ranges and marks, and does something in each call.
struct Tool {
    inline static std::function<void()> on_call;
    inline static int depth = 0;
    inline static bool is_reentered = false;
    inline static std::string last_mark;  ///< its message

    static void called() {
        is_reentered = is_reentered || depth > 0;
        ++depth;
        if (on_call) on_call();
        --depth;
    }
    static int initialize(const void* (*tables)(std::uint32_t)) {
        const auto* const callbacks = static_cast<const NvtxExportTableCallbacks*>(
            tables(static_cast<std::uint32_t>(NVTX_ETID_CALLBACKS)));
        NvtxFunctionTable table = nullptr;
        unsigned size = 0;
        if (!callbacks->GetModuleFunctionTable(NVTX_CB_MODULE_CORE2, &table, &size)) return 0;
        const nvtxDomainRangeStartEx_impl_fntype start = [](nvtxDomainHandle_t,
                                                            const nvtxEventAttributes_t*) {
            called();
            return nvtxRangeId_t{1};
        };
        const nvtxDomainRangeEnd_impl_fntype end = [](nvtxDomainHandle_t, nvtxRangeId_t) {
            called();
        };
        const nvtxDomainMarkEx_impl_fntype mark = [](nvtxDomainHandle_t,
                                                     const nvtxEventAttributes_t* event) {
            last_mark = event->message.ascii;
            called();
        };
        *table[NVTX_CBID_CORE2_DomainRangeStartEx] = reinterpret_cast<NvtxFunctionPointer>(start);
        *table[NVTX_CBID_CORE2_DomainRangeEnd] = reinterpret_cast<NvtxFunctionPointer>(end);
        *table[NVTX_CBID_CORE2_DomainMarkEx] = reinterpret_cast<NvtxFunctionPointer>(mark);
        return 1;
    }
};

struct Fixture : SteeringFixture {
    Fixture() {
        close_segments();
        rt().show_in_nvtx(observe::NvtxLink::attach({Tool::initialize, nullptr}));
        REQUIRE(rt().observers().nvtx.is_on());
    }
    ~Fixture() { Tool::on_call = {}; }
    void run_frame() {
        begin(thread_a, "tight");
        launch(thread_a);
        wait(thread_a, kStreamA);
        rt().frames().task_end(thread_a);
    }
};

int cancel_state() {
    int state = 0, ignored = 0;
    pthread_setcancelstate(PTHREAD_CANCEL_DISABLE, &state);
    pthread_setcancelstate(state, &ignored);
    return state;
}

}  // namespace

TEST_CASE("NVTX ends, and waits for no thread, when the program exits inside the tool",
          "[observe][nvtx]") {
    Fixture f;
    int calls = 0;
    Tool::on_call = [&] {
        if (++calls == 1) f.rt().observers().nvtx.finish();  // a signal's handler has called exit()
    };
    f.begin(f.thread_a, "tight");
    CHECK_FALSE(f.rt().observers().nvtx.is_on());
    CHECK_FALSE(Tool::is_reentered);  // it may have locks
}

TEST_CASE("NVTX tool is called as no cancellation point", "[observe][nvtx]") {
    Fixture f;
    int calls = 0, cancellable = 0;
    Tool::on_call = [&] {
        ++calls;
        cancellable += cancel_state() == PTHREAD_CANCEL_ENABLE;
    };
    f.run_frame();
    CHECK(calls > 4);
    CHECK(cancellable == 0);
    CHECK(cancel_state() == PTHREAD_CANCEL_ENABLE);
}

TEST_CASE("NVTX tool is told of each mode by its word", "[observe][nvtx]") {
    Fixture f;
    const auto [command, word] = GENERATE(
        table<abi::ControlCommand, std::string>({{abi::ControlCommand::kOff, "off"},
                                                 {abi::ControlCommand::kObserve, "observe"},
                                                 {abi::ControlCommand::kShadow, "shadow"},
                                                 {abi::ControlCommand::kOn, "enforce"}}));
    f.steer(command);
    CHECK(Tool::last_mark == "mode: mode " + word);
}
