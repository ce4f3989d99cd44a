// SPDX-License-Identifier: Apache-2.0
#include "interposer/nvtx_events.h"

#include <unistd.h>

#include <atomic>
#include <cstdlib>

#include "host/base/log.h"
#include "host/base/own_thread.h"
#include "host/base/uncancelled.h"
#include "host/config/names.h"
#include "interposer/boundary.h"
#include "interposer/nvtx_behind.h"

namespace urgengo::interposer {
namespace {

std::atomic<config::NvtxEvents> g_asked{config::NvtxEvents::kOff};
std::atomic<pid_t> g_process{0};

// At exit, before the tool's own handlers: what is under way ends.
void finish() {
    if (getpid() != g_process.load()) return;  // a child's
    const Inside inside;
    the_runtime().observers().nvtx.finish();
}

void tell_of_thread(unsigned id) {
    the_runtime().observers().nvtx.own_thread(id);
}

// In that thread: the tool may call the driver.
void tell_of_new_thread(unsigned id) {
    const Inside inside;
    tell_of_thread(id);
}

void attach(config::NvtxEvents asked) {
    const NvtxToolBehind& tool = nvtx_tool_of_process();
    auto link = observe::NvtxLink::attach(tool);
    if (!link) {
        if (asked == config::NvtxEvents::kOn)
            log_line(
                "nvtx: on, but there is no NVTX tool (NVTX_INJECTION64_PATH): nothing is told");
        return;
    }
    g_process.store(getpid());
    the_runtime().show_in_nvtx(std::move(link));
    tell_of_own_threads(tell_of_new_thread);
    for (const unsigned id : own_threads()) tell_of_thread(id);
    std::atexit(finish);
}

}  // namespace

void ask_for_nvtx_events(config::NvtxEvents configured, const Settings& settings) {
    g_asked.store(
        settings.nvtx.events.empty()
            ? configured
            : config::from_word<config::NvtxEvents>(settings.nvtx.events).value_or(configured));
}

void start_nvtx_events(void* /*unused*/) noexcept {
    const config::NvtxEvents asked = g_asked.exchange(config::NvtxEvents::kOff);
    if (asked == config::NvtxEvents::kOff) return;
    const Inside inside;
    const Uncancelled uncancelled;
    try {
        attach(asked);
    } catch (...) {
        log_line("NVTX: no memory for events of UrgenGo");
    }
}

}  // namespace urgengo::interposer
