// SPDX-License-Identifier: Apache-2.0
//
// The simulated GPU's log of completed kernels, for scenarios: asked of the real driver itself,
// which under UrgenGo is not the library that the program is linked to.
#pragma once

#include <dlfcn.h>

#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "tests/interposer/twin.h"
#include "tools/simgpu/simgpu.h"

namespace twin {

/// @returns the simulated driver's function of that name; past UrgenGo, if that is there
template <typename Function>
Function* of_driver(const char* name) {
    // The tests say where the simulated driver is; by now it is loaded, one way or the other.
    const char* path = std::getenv("TWIN_SIMGPU");
    void* driver = path ? dlopen(path, RTLD_LAZY | RTLD_NOLOAD) : nullptr;
    if (!driver) give_up("finding the simulated driver by TWIN_SIMGPU", errno);
    return reinterpret_cast<Function*>(dlsym(driver, name));
}

/// @returns the completed kernels whose names begin so, in the order in which they completed
inline std::vector<simgpu_kernel_record> kernel_log(const std::string& name_begins) {
    const auto read = of_driver<decltype(simgpu_kernel_log)>("simgpu_kernel_log");
    std::vector<simgpu_kernel_record> all(read(nullptr, 0)), wanted;
    read(all.data(), all.size());
    for (const simgpu_kernel_record& record : all)
        if (std::strncmp(record.name, name_begins.c_str(), name_begins.size()) == 0)
            wanted.push_back(record);
    return wanted;
}

}  // namespace twin
