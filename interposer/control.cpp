// SPDX-License-Identifier: Apache-2.0
#include "interposer/control.h"

#include <atomic>

#include "host/base/own_thread.h"
#include "interposer/boundary.h"

namespace urgengo::interposer {
namespace {

void listen(void* argument) {
    auto& runtime = *static_cast<runtime::Runtime*>(argument);
    observe::StatusPage& page = runtime.status();
    std::uint32_t seen = 0;
    page.header().is_controlled.store(1, std::memory_order_release);
    for (;;) {
        const auto word = page.control_word();
        if (!word) break;  // the file has been cut short
        if (page.header().is_over.load(std::memory_order_relaxed) != 0) break;
        if (*word == seen) {
            if (!page.wait_for_control(seen)) break;
            continue;
        }
        seen = *word;
        const Inside inside;  // a library inside the driver may call it
        protect([&] { runtime.steering().obey(seen); });
    }
    page.header().is_controlled.store(0, std::memory_order_release);
}

}  // namespace

void listen_to_control(runtime::Runtime& runtime) {
    if (runtime.status().is_shared()) start_own_thread(listen, &runtime);
}

}  // namespace urgengo::interposer
