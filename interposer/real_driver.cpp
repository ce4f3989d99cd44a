// SPDX-License-Identifier: Apache-2.0
#include "interposer/real_driver.h"

#include <dlfcn.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <compare>
#include <cstdlib>
#include <vector>

#include "host/base/log.h"
#include "host/base/settings.h"
#include "interposer/driver_file.h"
#include "interposer/driver_room.h"
#include "interposer/generated/entry_points.h"
#include "interposer/unknown_captures.h"

namespace urgengo::interposer {
namespace {

// A function that the driver exports, and what the loader finds under its name with us. Of several
// names at one address the first in this order stands for all, as in own_symbols.cpp.
struct Export {
    void* real;
    int rank;  // overridden ones first
    void* ours;
    auto operator<=>(const Export&) const = default;
};

struct Loaded {
    exec::DriverApi real;         // nothing is null
    exec::DriverApi available;    // null where the driver lacks a function
    std::vector<Export> exports;  // sorted
    void* library = nullptr;      // null: there is none
};

// Loading takes no lock of ours: the loader has one, and a library's constructor that calls CUDA
// holds it already. Threads that come in together all load the same, and the first to publish wins.
std::atomic<const Loaded*> g_loaded{nullptr};
// The driver's own constructors may call an entry point.
__attribute__((tls_model("initial-exec"))) thread_local bool t_loading = false;
std::atomic<bool> g_complained{false};

// What an entry point is when there is no driver, or the driver lacks it.
CUresult no_driver() {
    return CUDA_ERROR_NO_DEVICE;
}
CUresult not_in_driver() {
    return CUDA_ERROR_NOT_FOUND;
}

// @returns a handle of the library at `path`, or null if it is none, or a copy of ours: that would
// be loaded for good, where the driver should lie.
void* open_driver(const std::string& path) {
    struct stat status;
    if (stat(path.c_str(), &status) != 0 || is_urgengo(path)) return nullptr;
    free_driver_room();  // only now: whatever is mapped in between may take it
    return dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
}

void* find_real_driver() {
    const std::string asked = read_settings().real_libcuda;
    if (!asked.empty()) {
        void* handle = open_driver(asked);
        if (!handle && !g_complained.exchange(true))
            log_line("URGENGO_REAL_LIBCUDA: found '" + asked +
                     "', accepted: the absolute path of a libcuda.so.1 that can be loaded");
        return handle;
    }
    for (const std::string& path : driver_candidates(std::getenv("LD_LIBRARY_PATH")))
        if (void* handle = open_driver(path)) return handle;
    return nullptr;
}

}  // namespace

void load_real_driver() {
    if (g_loaded.load(std::memory_order_acquire) || t_loading) return;
    t_loading = true;
    const int saved_errno = errno;
    void* handle = find_real_driver();
    free_driver_room();  // also if there is none
    void* const missing = reinterpret_cast<void*>(handle ? &not_in_driver : &no_driver);
    const auto find = [&](const char* name) { return handle ? dlsym(handle, name) : nullptr; };
    const auto find_or_missing = [&](const char* name) {
        void* function = find(name);
        return function ? function : missing;
    };
    auto* loaded = new Loaded;
    loaded->library = handle;
    for (int i = 0; i < kNumEntryPoints; ++i) {
        const EntryPoint& entry = kEntryPoints[i];
        void* const function = find(entry.name);
        __atomic_store_n(&urgengo_entry_points[i], function ? function : missing, __ATOMIC_RELAXED);
        if (!function) continue;
        loaded->exports.push_back(
            {function, entry.overridden ? i : i + kNumEntryPoints, entry.function});
    }
    std::sort(loaded->exports.begin(), loaded->exports.end());
    loaded->real.load(find_or_missing);
    loaded->available.load(find);
    const Loaded* none = nullptr;
    if (!g_loaded.compare_exchange_strong(none, loaded, std::memory_order_acq_rel)) delete loaded;
    const exec::DriverApi& real = g_loaded.load(std::memory_order_acquire)->real;
    g_every_call.launch.store(real.cuLaunchKernel, std::memory_order_relaxed);
    g_every_call.launch_ptsz.store(real.cuLaunchKernel_ptsz, std::memory_order_relaxed);
    g_every_call.launch_ex.store(real.cuLaunchKernelEx, std::memory_order_relaxed);
    g_every_call.launch_ex_ptsz.store(real.cuLaunchKernelEx_ptsz, std::memory_order_relaxed);
    g_every_call.real.store(&real, std::memory_order_release);
    errno = saved_errno;
    t_loading = false;
}

namespace {

const Loaded& loaded_driver() {
    load_real_driver();
    const Loaded* loaded = g_loaded.load(std::memory_order_acquire);
    if (loaded) [[likely]]
        return *loaded;
    // Called from the driver's own constructor, while this thread loads it.
    static const auto* const nothing = [] {
        auto* l = new Loaded;
        l->real.load([](const char*) { return reinterpret_cast<void*>(&no_driver); });
        return l;
    }();
    return *nothing;
}

}  // namespace

const exec::DriverApi& detail::load_and_get_real() {
    return loaded_driver().real;
}

const exec::DriverApi& available() {
    return loaded_driver().available;
}

void* find_in_driver(const char* name) {
    void* const library = loaded_driver().library;
    return library ? dlsym(library, name) : nullptr;
}

void* ours_for(void* real_function) {
    const auto& exports = loaded_driver().exports;
    const auto found =
        std::lower_bound(exports.begin(), exports.end(), real_function,
                         [](const Export& e, void* function) { return e.real < function; });
    return found != exports.end() && found->real == real_function ? found->ours : real_function;
}

/// Called by urgengo_lazy_entry. @returns the real function behind entry point `index`, or behind
/// one that begins a capture on the stream that is its first argument (unknown_captures.h)
extern "C" __attribute__((visibility("hidden"))) void* urgengo_resolve_entry(long index,
                                                                             void* argument) {
    if (index >= kNumEntryPoints)
        return note_capture(static_cast<int>(index) - kNumEntryPoints,
                            static_cast<CUstream>(argument));
    load_real_driver();
    if (!g_loaded.load(std::memory_order_acquire))
        return reinterpret_cast<void*>(&no_driver);  // from the driver's own constructor
    return urgengo_entry_points[index];
}

}  // namespace urgengo::interposer
