// SPDX-License-Identifier: Apache-2.0
#include "interposer/nvtx_behind.h"

#include <dlfcn.h>

#include <atomic>
#include <cstdlib>
#include <string>

#include "host/base/log.h"
#include "host/base/settings.h"
#include "interposer/driver_file.h"

namespace urgengo::interposer {
namespace {

constexpr NvtxToolBehind kNone;

// Threads that come in together all load the same library, and the first to publish wins: a lock
// around loading could be waited for by the constructor of a library, inside the loader's.
std::atomic<const NvtxToolBehind*> g_behind{nullptr}, g_named{nullptr};
std::atomic<bool> g_complained{false};

void complain(const char* variable, const std::string& path, const std::string& why) {
    if (g_complained.exchange(true)) return;
    log_line(std::string(variable) + ": found '" + path +
             "', accepted: an NVTX injection library (" + why +
             "); NVTX calls reach UrgenGo alone");
}

// A tool that is linked with libcuda.so.1 has us among what it depends on: what it lacks would be
// found in us, and we would call ourselves.
void* find_outside_of_us(void* library, const char* name) {
    void* const found = dlsym(library, name);
    Dl_info its{}, ours{};
    const bool is_ours = found && dladdr(found, &its) != 0 &&
                         dladdr(reinterpret_cast<void*>(&find_outside_of_us), &ours) != 0 &&
                         its.dli_fbase == ours.dli_fbase;
    return is_ours ? nullptr : found;
}

// As NVTX itself loads it.
NvtxToolBehind load(const char* variable, const std::string& path) {
    NvtxToolBehind tool;
    if (is_urgengo(path)) return tool;  // ourselves
    void* const library = dlopen(path.c_str(), RTLD_LAZY);
    if (!library) {
        const char* const why = dlerror();
        complain(variable, path, why ? why : "it cannot be loaded");
        return tool;
    }
    tool.initialize = reinterpret_cast<decltype(tool.initialize)>(
        find_outside_of_us(library, "InitializeInjectionNvtx2"));
    tool.initialize_extension = reinterpret_cast<decltype(tool.initialize_extension)>(
        find_outside_of_us(library, "InitializeInjectionNvtxExtension"));
    if (!tool.initialize) complain(variable, path, "it has no InitializeInjectionNvtx2");
    return tool;
}

const NvtxToolBehind& publish(std::atomic<const NvtxToolBehind*>& place,
                              const NvtxToolBehind& tool) {
    auto* const mine = new NvtxToolBehind(tool);
    const NvtxToolBehind* none = nullptr;
    if (place.compare_exchange_strong(none, mine, std::memory_order_acq_rel)) return *mine;
    delete mine;
    return *none;
}

}  // namespace

const NvtxToolBehind& nvtx_tool_behind() {
    if (const auto* known = g_behind.load(std::memory_order_acquire)) return *known;
    const std::string path = read_settings().nvtx.tool;
    return publish(g_behind, path.empty() ? kNone : load("URGENGO_NVTX_TOOL", path));
}

const NvtxToolBehind& nvtx_tool_of_process() {
    const NvtxToolBehind& behind = nvtx_tool_behind();
    if (behind.initialize) return behind;
    if (const auto* known = g_named.load(std::memory_order_acquire)) return *known;
    const char* const path = std::getenv("NVTX_INJECTION64_PATH");
    return publish(g_named, path && *path ? load("NVTX_INJECTION64_PATH", path) : kNone);
}

}  // namespace urgengo::interposer
