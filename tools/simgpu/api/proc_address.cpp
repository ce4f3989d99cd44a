// SPDX-License-Identifier: Apache-2.0
//
// cuGetProcAddress: the entry point for a name, a CUDA version and a flavour of the default stream.
// Answers as the driver does, compared with 580.159.04 on an H200 name by name: the newest ABI that
// is no newer than the version asked for; of the per-thread flavour, where a function comes in it,
// that one or none. What is not there is no error of cuGetProcAddress_v2, which has a status to say
// so.
#include <algorithm>
#include <iterator>
#include <string_view>

#include "tools/simgpu/api/driver_state.h"

using namespace urgengo::simgpu;

namespace {

enum Flavour { kPlain, kPerThread };

struct Entry {
    std::string_view name;
    int version;
    Flavour flavour;
    void (*function)();
};

// A second name for each symbol: cuda.h declares some of them, with types that do not matter here,
// and not others. A symbol that does not exist fails the link.
#define SIMGPU_ENTRY(name, version, flavour, symbol) \
    extern "C" void simgpu_entry_##symbol() __asm__(#symbol);
#include "tools/simgpu/api/proc_address_table.inc"
#undef SIMGPU_ENTRY

const Entry kEntries[] = {
#define SIMGPU_ENTRY(name, version, flavour, symbol) \
    {#name, version, flavour, simgpu_entry_##symbol},
#include "tools/simgpu/api/proc_address_table.inc"
#undef SIMGPU_ENTRY
};

struct Answer {
    void* function = nullptr;
    CUdriverProcAddressQueryResult status = CU_GET_PROC_ADDRESS_SYMBOL_NOT_FOUND;
};

Answer find_entry(std::string_view name, int version, Flavour wanted) {
    // What is newer than the driver is as unknown to it as what never was.
    const auto is_it = [name, newest = driver().version](const Entry& entry, Flavour flavour) {
        return entry.name == name && entry.flavour == flavour && entry.version <= newest;
    };
    const auto comes_in = [&is_it](Flavour flavour) {
        return std::any_of(std::begin(kEntries), std::end(kEntries),
                           [&](const Entry& entry) { return is_it(entry, flavour); });
    };
    const Flavour flavour = wanted == kPerThread && comes_in(kPerThread) ? kPerThread : kPlain;
    if (!comes_in(flavour)) return {};

    const Entry* best = nullptr;
    for (const Entry& entry : kEntries) {
        if (!is_it(entry, flavour) || entry.version > version) continue;
        if (best == nullptr || entry.version > best->version) best = &entry;
    }
    if (best == nullptr) return {nullptr, CU_GET_PROC_ADDRESS_VERSION_NOT_SUFFICIENT};
    return {reinterpret_cast<void*>(best->function), CU_GET_PROC_ADDRESS_SUCCESS};
}

CUresult answer(const char* name, int version, cuuint64_t flags, Answer& found) {
    constexpr cuuint64_t kKnown =
        CU_GET_PROC_ADDRESS_LEGACY_STREAM | CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM;
    if (name == nullptr || version > driver().version || (flags & ~kKnown) != 0) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    const bool per_thread = (flags & CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM) != 0;
    found = find_entry(name, version, per_thread ? kPerThread : kPlain);
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuGetProcAddress_v2(const char* name, void** function, int version,
                                        cuuint64_t flags, CUdriverProcAddressQueryResult* status) {
    Answer found;
    if (function == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = answer(name, version, flags, found)) return error;
    *function = found.function;
    if (status != nullptr) *status = found.status;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGetProcAddress(const char* name, void** function, int version,
                                     cuuint64_t flags) {
    Answer found;
    if (function == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = answer(name, version, flags, found)) return error;
    if (found.function == nullptr) return CUDA_ERROR_NOT_FOUND;
    *function = found.function;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGetExportTable(const void** table, const CUuuid* id) {
    if (table == nullptr || id == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *table = nullptr;
    return CUDA_ERROR_NOT_FOUND;  // the tables are NVIDIA's private interfaces
}
