// SPDX-License-Identifier: Apache-2.0
//
// The libraries that answer like older drivers. Each is opened by its path, beside the others.
#include <cuda.h>
#include <dlfcn.h>

#include <string>

#include "tests/support/catch.h"

namespace {

class DriverLibrary {
  public:
    explicit DriverLibrary(const char* path) : handle_(dlopen(path, RTLD_NOW | RTLD_LOCAL)) {
        INFO(path);
        REQUIRE(handle_ != nullptr);
    }

    void* find(const std::string& symbol) const { return dlsym(handle_, symbol.c_str()); }

    int version() const {
        int version = 0;
        const auto get = reinterpret_cast<CUresult (*)(int*)>(find("cuDriverGetVersion"));
        REQUIRE(get(&version) == CUDA_SUCCESS);
        return version;
    }

    CUresult ask(const char* name, int version, void** function,
                 CUdriverProcAddressQueryResult* status = nullptr) const {
        const auto ask = reinterpret_cast<CUresult (*)(const char*, void**, int, cuuint64_t,
                                                       CUdriverProcAddressQueryResult*)>(
            find("cuGetProcAddress_v2"));
        return ask(name, function, version, 0, status);
    }

    CUresult ask_v1(const char* name, int version, void** function) const {
        const auto ask = reinterpret_cast<CUresult (*)(const char*, void**, int, cuuint64_t)>(
            find("cuGetProcAddress"));
        return ask(name, function, version, 0);
    }

  private:
    void* handle_;
};

struct TableEntry {
    std::string symbol;
    int since;
};

/// Every exported function, and with which CUDA it came, as cuGetProcAddress has it.
const TableEntry kTable[] = {
#define SIMGPU_ENTRY(name, version, flavour, symbol) {#symbol, version},
#include "tools/simgpu/api/proc_address_table.inc"
#undef SIMGPU_ENTRY
};

void check_exports(const DriverLibrary& library, int version) {
    for (const TableEntry& entry : kTable) {
        INFO(entry.symbol << " of " << entry.since << " in the driver of " << version);
        CHECK((library.find(entry.symbol) != nullptr) == (entry.since <= version));
    }
}

}  // namespace

TEST_CASE("Driver exports what is no newer than itself when it is an older one", "[unit][simgpu]") {
    check_exports(DriverLibrary(SIMGPU_12_0), 12000);
    check_exports(DriverLibrary(SIMGPU_12_4), 12040);
    check_exports(DriverLibrary(SIMGPU_13_0), 13000);
}

TEST_CASE("Driver does not know newer names when it is an older one", "[unit][simgpu]") {
    const DriverLibrary driver(SIMGPU_12_0);
    CHECK(driver.version() == 12000);
    void* function = &function;
    CUdriverProcAddressQueryResult status{};
    CHECK(driver.ask("cuFuncGetName", 12000, &function, &status) == CUDA_SUCCESS);
    CHECK(function == nullptr);
    CHECK(status == CU_GET_PROC_ADDRESS_SYMBOL_NOT_FOUND);
    CHECK(driver.ask_v1("cuFuncGetName", 12000, &function) == CUDA_ERROR_NOT_FOUND);
    CHECK(driver.ask("cuFuncGetName", 12030, &function) == CUDA_ERROR_INVALID_VALUE);
    CHECK(driver.ask("cuStreamGetCaptureInfo", 12000, &function, &status) == CUDA_SUCCESS);
    CHECK(function == driver.find("cuStreamGetCaptureInfo_v2"));
    CHECK(status == CU_GET_PROC_ADDRESS_SUCCESS);
}

TEST_CASE("Driver knows what came with it when it is of CUDA 12.4", "[unit][simgpu]") {
    const DriverLibrary driver(SIMGPU_12_4);
    CHECK(driver.version() == 12040);
    void* function = nullptr;
    CHECK(driver.ask("cuFuncGetParamInfo", 12040, &function) == CUDA_SUCCESS);
    CHECK(function == driver.find("cuFuncGetParamInfo"));
    CHECK(driver.ask("cuEventElapsedTime", 12040, &function) == CUDA_SUCCESS);
    CHECK(function == driver.find("cuEventElapsedTime"));
    CHECK(driver.ask("cuStreamGetDevice", 12040, &function) == CUDA_SUCCESS);
    CHECK(function == nullptr);
}
