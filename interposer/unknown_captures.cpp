// SPDX-License-Identifier: Apache-2.0
#include "interposer/unknown_captures.h"

#include <atomic>
#include <mutex>
#include <string_view>
#include <utility>

#include "host/base/log.h"
#include "interposer/boundary.h"

using urgengo::exec::StreamFlavor;

// One for each function (begin_capture_<machine>.S). They go through urgengo_lazy_entry, with
// indices behind those of the known entry points.
extern "C" __attribute__((visibility("hidden"))) void* const urgengo_begin_capture[];

namespace urgengo::interposer {
namespace {

constexpr int kMost = 8;  // so many are there

struct Begin {
    std::atomic<void*> function{nullptr};  // set once
    std::atomic<StreamFlavor> flavor{StreamFlavor::kLegacy};
};
Begin g_begins[kMost];
std::mutex g_mutex;

bool begins_capture(std::string_view name) {
    return name.starts_with("cuStreamBegin") && name.find("apture") != std::string_view::npos;
}

StreamFlavor flavor_of(std::string_view name, cuuint64_t flags) {
    const bool per_thread = (flags & CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM) != 0;
    return per_thread || name.ends_with("_ptsz") ? StreamFlavor::kPerThread : StreamFlavor::kLegacy;
}

}  // namespace

void* noting_captures(void* function, const char* name, cuuint64_t flags) {
    if (!begins_capture(name)) return function;
    const std::lock_guard lock(g_mutex);
    for (int i = 0; i < kMost; ++i) {
        void* const known = g_begins[i].function.load(std::memory_order_relaxed);
        if (known == function) return urgengo_begin_capture[i];
        if (known) continue;
        g_begins[i].flavor.store(flavor_of(name, flags), std::memory_order_relaxed);
        g_begins[i].function.store(function, std::memory_order_release);
        return urgengo_begin_capture[i];
    }
    static bool told = false;
    if (!std::exchange(told, true))
        log_line(
            "more ways to begin a capture than can be told apart: what is captured by them may get "
            "priorities and marks of UrgenGo's");
    return function;
}

void* note_capture(int index, CUstream stream) {
    const Begin& begin = g_begins[index];
    void* const function = begin.function.load(std::memory_order_acquire);
    if (!acts()) return function;
    const Inside inside;
    protect([&] {
        const StreamFlavor flavor = begin.flavor.load(std::memory_order_relaxed);
        the_runtime().capture_begins(stream, flavor);
        if (exec::is_per_thread(stream, flavor)) this_thread();
    });
    return function;
}

}  // namespace urgengo::interposer
