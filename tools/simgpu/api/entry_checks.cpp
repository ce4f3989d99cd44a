// SPDX-License-Identifier: Apache-2.0
//
// Turns the entries that SIMGPU_FAIL names to their checked path, and decides there which call
// fails; for SIMGPU_COUNT_CALLS all entries, whose calls are told at exit. All of it is set before
// the program can call anything, and only counts afterwards.
#include <fmt/format.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/api/injected_errors.h"
#include "tools/simgpu/engine/kernel_failures.h"

using namespace urgengo::simgpu;

extern "C" {
/// Where each entry point goes: entries_x86_64.S.
extern void* simgpu_entry_slots_table[];
extern void* const simgpu_entry_checked_table[];
__attribute__((visibility("hidden"))) int simgpu_injected_error(unsigned entry);
}

namespace {

constexpr std::string_view kNames[] = {
#define SIMGPU_ENTRY(name, version, flavour, symbol) #symbol,
#include "tools/simgpu/api/proc_address_table.inc"
#undef SIMGPU_ENTRY
};
constexpr std::size_t kNumEntries = std::size(kNames);
constexpr int kNone = -1;

struct Check {
    std::atomic<std::uint64_t> num_calls{0};
    std::vector<InjectedError> errors;
};

Check* g_checks[kNumEntries];  // never deleted: programs call until the last moment

Check& check(std::size_t entry) {
    if (g_checks[entry] == nullptr) g_checks[entry] = new Check;
    simgpu_entry_slots_table[entry] = simgpu_entry_checked_table[entry];
    return *g_checks[entry];
}

void arm(const InjectedError& error) {
    if (error.on != InjectedError::On::kCall) return KernelFailures::add(error);
    const auto* const found = std::find(std::begin(kNames), std::end(kNames), error.name);
    if (found == std::end(kNames)) {
        complain(fmt::format(
            "SIMGPU_FAIL: found '{}', accepted: a function that this library exports, by its "
            "symbol, such as cuMemAlloc_v2",
            error.name));
        return;
    }
    check(static_cast<std::size_t>(found - std::begin(kNames))).errors.push_back(error);
}

void tell_counts() {
    const char* const path = std::getenv("SIMGPU_COUNT_CALLS");
    std::FILE* const file = path ? std::fopen(path, "we") : nullptr;
    if (!file) return;
    for (std::size_t i = 0; i < kNumEntries; ++i)
        if (const std::uint64_t calls = g_checks[i]->num_calls.load(); calls > 0)
            fmt::print(file, "{} {}\n", kNames[i], calls);
    std::fclose(file);
}

__attribute__((constructor)) void read_environment() {
    if (std::getenv("SIMGPU_COUNT_CALLS") != nullptr) {
        for (std::size_t i = 0; i < kNumEntries; ++i) check(i);
        std::atexit(tell_counts);
    }
    const char* const text = std::getenv("SIMGPU_FAIL");
    if (text == nullptr) return;
    const auto errors = parse_injected_errors(text);
    if (!errors) return complain(errors.error());
    for (const InjectedError& error : *errors) arm(error);
}

}  // namespace

int simgpu_injected_error(unsigned entry) {
    Check& its = *g_checks[entry];
    const std::uint64_t call = its.num_calls.fetch_add(1) + 1;
    for (const InjectedError& error : its.errors) {
        if (error.call == call) return error.code;
    }
    return kNone;
}
