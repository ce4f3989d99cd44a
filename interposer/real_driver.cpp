// SPDX-License-Identifier: Apache-2.0
#include "interposer/real_driver.h"

#include <dlfcn.h>
#include <sys/stat.h>

#include <atomic>
#include <cerrno>
#include <fstream>
#include <iterator>
#include <mutex>
#include <string_view>
#include <vector>

#include "host/base/log.h"
#include "host/base/settings.h"
#include "interposer/generated/entry_points.h"
#include "interposer/ld_cache.h"

namespace urgengo::interposer {
namespace {

constexpr const char* kSoname = "libcuda.so.1";

std::atomic<bool> g_loaded{false};
std::recursive_mutex g_mutex;  // the driver's own constructors may call an entry point
bool g_loading = false;
exec::DriverApi g_real;       // never null once loaded
exec::DriverApi g_available;  // null where the driver lacks a function

// What an entry point is when there is no driver, or the driver lacks it. An entry that the driver
// lacks would, without us, have ended the program in the loader.
CUresult no_driver() {
    return CUDA_ERROR_NO_DEVICE;
}
CUresult not_in_driver() {
    return CUDA_ERROR_NOT_FOUND;
}

bool is_ourselves(const std::string& path) {
    Dl_info self;
    struct stat a, b;
    return dladdr(reinterpret_cast<void*>(&is_ourselves), &self) != 0 &&
           stat(self.dli_fname, &a) == 0 && stat(path.c_str(), &b) == 0 && a.st_dev == b.st_dev &&
           a.st_ino == b.st_ino;
}

// The loader's order: LD_LIBRARY_PATH, its cache, the default folders. (A program's RPATH is not
// known here; drivers are not installed beside programs.)
std::vector<std::string> candidates() {
    std::vector<std::string> paths;
    if (const char* list = std::getenv("LD_LIBRARY_PATH")) {
        std::string_view rest = list;
        while (true) {
            const std::size_t end = rest.find_first_of(":;");
            const std::string_view folder = rest.substr(0, end);
            paths.push_back((folder.empty() ? "." : std::string(folder)) + "/" + kSoname);
            if (end == std::string_view::npos) break;
            rest.remove_prefix(end + 1);
        }
    }
    std::ifstream file("/etc/ld.so.cache", std::ios::binary);
    const std::string cache{std::istreambuf_iterator<char>(file), {}};
    for (std::string& path : find_in_ld_cache(cache, kSoname)) paths.push_back(std::move(path));
    for (const char* folder : {"/lib/x86_64-linux-gnu", "/usr/lib/x86_64-linux-gnu",
                               "/lib/aarch64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/lib64",
                               "/usr/lib64", "/lib", "/usr/lib", "/usr/lib/wsl/lib"})
        paths.push_back(std::string(folder) + "/" + kSoname);
    return paths;
}

// @returns a handle of the library at `path`, or null if it is none, or another copy of ours.
void* open_driver(const std::string& path) {
    struct stat status;
    if (stat(path.c_str(), &status) != 0 || is_ourselves(path)) return nullptr;
    void* handle = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (handle && dlsym(handle, "ug_status")) {
        dlclose(handle);
        return nullptr;
    }
    return handle;
}

void* find_real_driver() {
    const std::string asked = read_settings().real_libcuda;
    if (!asked.empty()) {
        void* handle = open_driver(asked);
        if (!handle)
            log_line("URGENGO_REAL_LIBCUDA: found '" + asked +
                     "', accepted: the absolute path of a libcuda.so.1 that can be loaded");
        return handle;
    }
    for (const std::string& path : candidates())
        if (void* handle = open_driver(path)) return handle;
    return nullptr;
}

}  // namespace

void load_real_driver() {
    if (g_loaded.load(std::memory_order_acquire)) return;
    const std::lock_guard lock(g_mutex);
    if (g_loaded.load(std::memory_order_relaxed) || g_loading) return;
    g_loading = true;
    const int saved_errno = errno;
    void* handle = find_real_driver();
    void* const missing = reinterpret_cast<void*>(handle ? &not_in_driver : &no_driver);
    const auto find = [&](const char* name) { return handle ? dlsym(handle, name) : nullptr; };
    const auto find_or_missing = [&](const char* name) {
        void* function = find(name);
        return function ? function : missing;
    };
    for (int i = 0; i < kNumEntryPoints; ++i)
        __atomic_store_n(&urgengo_entry_points[i], find_or_missing(kEntryPointNames[i]),
                         __ATOMIC_RELAXED);
    g_real.load(find_or_missing);
    g_available.load(find);
    errno = saved_errno;
    g_loaded.store(true, std::memory_order_release);
}

const exec::DriverApi& real() {
    load_real_driver();
    return g_real;
}

const exec::DriverApi& available() {
    load_real_driver();
    return g_available;
}

void* overridden(void* pointer) {
    for (const Override& o : kOverrides)
        if (urgengo_entry_points[o.index] == pointer) return o.function;
    return pointer;
}

/// Called by urgengo_lazy_entry. @returns the real function behind entry point `index`
extern "C" __attribute__((visibility("hidden"))) void* urgengo_resolve_entry(long index) {
    load_real_driver();
    if (!g_loaded.load(std::memory_order_acquire))
        return reinterpret_cast<void*>(&no_driver);  // called from the driver's own constructor
    return urgengo_entry_points[index];
}

}  // namespace urgengo::interposer
