// SPDX-License-Identifier: Apache-2.0
#include "interposer/unknown_captures.h"

#include <array>
#include <atomic>
#include <string_view>

#include "host/base/log.h"
#include "interposer/boundary.h"

using urgengo::exec::StreamFlavor;

// One for each function (begin_capture_<machine>.S). They go through urgengo_lazy_entry, with
// indices behind those of the known entry points.
extern "C" __attribute__((visibility("hidden"))) void* const urgengo_begin_capture[];

namespace urgengo::interposer {
namespace {

/// So many are there for each flavour: the legacy one's come first.
constexpr int kMost = 4;
/// Set once. No lock: a child that is forked meanwhile asks, too.
constinit std::array<std::atomic<void*>, 2 * kMost> g_begins{};
constinit std::atomic<bool> g_told{false};

StreamFlavor flavor_at(int index) {
    return index < kMost ? StreamFlavor::kLegacy : StreamFlavor::kPerThread;
}

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
    const int first = flavor_of(name, flags) == StreamFlavor::kLegacy ? 0 : kMost;
    for (int i = first; i < first + kMost; ++i) {
        void* known = nullptr;
        if (g_begins[static_cast<std::size_t>(i)].compare_exchange_strong(known, function) ||
            known == function)
            return urgengo_begin_capture[i];
    }
    if (!g_told.exchange(true))
        log_line(
            "more ways to begin a capture than can be told apart: what is captured by them may get "
            "priorities and marks of UrgenGo's");
    return function;
}

void* note_capture(int index, CUstream stream) {
    void* const function = g_begins[static_cast<std::size_t>(index)].load();
    if (!acts()) return function;
    const Inside inside;
    protect([&] {
        const StreamFlavor flavor = flavor_at(index);
        the_runtime().streams().capture_may_begin(stream, flavor);
        if (exec::is_per_thread(stream, flavor)) this_thread();
    });
    return function;
}

}  // namespace urgengo::interposer
