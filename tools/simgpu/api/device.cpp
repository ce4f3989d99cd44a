// SPDX-License-Identifier: Apache-2.0
//
// Initialisation and device queries. The devices are all alike; their bus ids and UUIDs differ.
#include <dlfcn.h>
#include <fmt/format.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <string>

#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/engine/zero_cost.h"

using namespace urgengo::simgpu;

namespace {

std::string pci_bus_id(CUdevice device) {
    return fmt::format("0000:{:02x}:00.0", device + 1);
}

/// Attributes that are not listed are 0: the device cannot do that.
int attribute(CUdevice_attribute which, CUdevice device) {
    const Part& part = driver().part;
    switch (which) {
        case CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT:
            return part.num_sms;
        case CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_MULTIPROCESSOR:
            return part.threads_per_sm;
        case CU_DEVICE_ATTRIBUTE_MAX_BLOCKS_PER_MULTIPROCESSOR:
            return part.blocks_per_sm;
        case CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR:
            return part.compute_major;
        case CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR:
            return part.compute_minor;
        case CU_DEVICE_ATTRIBUTE_WARP_SIZE:
            return 32;
        case CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_BLOCK:
        case CU_DEVICE_ATTRIBUTE_MAX_BLOCK_DIM_X:
        case CU_DEVICE_ATTRIBUTE_MAX_BLOCK_DIM_Y:
            return 1024;
        case CU_DEVICE_ATTRIBUTE_MAX_BLOCK_DIM_Z:
            return 64;
        case CU_DEVICE_ATTRIBUTE_MAX_GRID_DIM_X:
            return 2147483647;
        case CU_DEVICE_ATTRIBUTE_MAX_GRID_DIM_Y:
        case CU_DEVICE_ATTRIBUTE_MAX_GRID_DIM_Z:
            return 65535;
        case CU_DEVICE_ATTRIBUTE_MAX_SHARED_MEMORY_PER_BLOCK:
            return 48 << 10;
        case CU_DEVICE_ATTRIBUTE_MAX_SHARED_MEMORY_PER_BLOCK_OPTIN:
            return part.shared_kb_opt_in << 10;
        case CU_DEVICE_ATTRIBUTE_MAX_SHARED_MEMORY_PER_MULTIPROCESSOR:
            return part.shared_kb_per_sm << 10;
        case CU_DEVICE_ATTRIBUTE_RESERVED_SHARED_MEMORY_PER_BLOCK:
            return 1 << 10;
        case CU_DEVICE_ATTRIBUTE_MAX_REGISTERS_PER_BLOCK:
        case CU_DEVICE_ATTRIBUTE_MAX_REGISTERS_PER_MULTIPROCESSOR:
            return 65536;
        case CU_DEVICE_ATTRIBUTE_TOTAL_CONSTANT_MEMORY:
            return 64 << 10;
        case CU_DEVICE_ATTRIBUTE_L2_CACHE_SIZE:
            return part.l2_mb << 20;
        case CU_DEVICE_ATTRIBUTE_MAX_PITCH:
            return 2147483647;
        case CU_DEVICE_ATTRIBUTE_TEXTURE_ALIGNMENT:
            return 512;
        case CU_DEVICE_ATTRIBUTE_CLOCK_RATE:
            return part.clock_khz;
        case CU_DEVICE_ATTRIBUTE_MEMORY_CLOCK_RATE:
            return part.memory_clock_khz;
        case CU_DEVICE_ATTRIBUTE_GLOBAL_MEMORY_BUS_WIDTH:
            return part.memory_bus_bits;
        case CU_DEVICE_ATTRIBUTE_GPU_OVERLAP:
        case CU_DEVICE_ATTRIBUTE_CAN_MAP_HOST_MEMORY:
        case CU_DEVICE_ATTRIBUTE_CONCURRENT_KERNELS:
        case CU_DEVICE_ATTRIBUTE_UNIFIED_ADDRESSING:
        case CU_DEVICE_ATTRIBUTE_STREAM_PRIORITIES_SUPPORTED:
        case CU_DEVICE_ATTRIBUTE_MANAGED_MEMORY:
        case CU_DEVICE_ATTRIBUTE_HOST_NATIVE_ATOMIC_SUPPORTED:
        case CU_DEVICE_ATTRIBUTE_COOPERATIVE_LAUNCH:
        case CU_DEVICE_ATTRIBUTE_HOST_REGISTER_SUPPORTED:
        case CU_DEVICE_ATTRIBUTE_CAN_USE_HOST_POINTER_FOR_REGISTERED_MEM:
        case CU_DEVICE_ATTRIBUTE_CAN_USE_64_BIT_STREAM_MEM_OPS:
        case CU_DEVICE_ATTRIBUTE_CAN_USE_STREAM_WAIT_VALUE_NOR:
        case CU_DEVICE_ATTRIBUTE_MEMORY_POOLS_SUPPORTED:
            return 1;
        case CU_DEVICE_ATTRIBUTE_PCI_BUS_ID:
            return device + 1;
        case CU_DEVICE_ATTRIBUTE_INTEGRATED:
            return part.integrated ? 1 : 0;
        case CU_DEVICE_ATTRIBUTE_CONCURRENT_MANAGED_ACCESS:
            return part.concurrent_managed ? 1 : 0;
        case CU_DEVICE_ATTRIBUTE_ASYNC_ENGINE_COUNT:
            return 2;
        default:
            return 0;
    }
}

/// The tool that the environment names, which may call cuInit itself.
void load_injection() {
    static std::atomic<bool> is_loaded{false};
    const char* const path = std::getenv("CUDA_INJECTION64_PATH");
    if (!path || is_loaded.exchange(true)) return;
    void* const tool = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    const auto initialize =
        reinterpret_cast<int (*)()>(tool ? dlsym(tool, "InitializeInjection") : nullptr);
    if (initialize) initialize();
}

}  // namespace

SIMGPU_API CUresult cuInit(unsigned flags) {
    if (flags != 0) return CUDA_ERROR_INVALID_VALUE;
    static std::once_flag once;
    std::call_once(once, [] {
        Driver& state = driver();
        if (state.wants_zero_cost) {
            set_zero_cost(true);
        } else {
            state.gpu = &GpuThread::start(
                state.part, [&state](const KernelRecord& record) { state.kernel_log.add(record); });
        }
        state.initialised.store(true, std::memory_order_release);
    });
    load_injection();
    return require_init();
}

SIMGPU_API CUresult cuDriverGetVersion(int* version) {
    if (version == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *version = driver().version;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGet(CUdevice* device, int ordinal) {
    if (CUresult error = require_init()) return error;
    if (device == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = require_device(ordinal)) return error;
    *device = ordinal;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetCount(int* count) {
    if (CUresult error = require_init()) return error;
    if (count == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *count = driver().part.num_in_machine;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetName(char* name, int length, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    if (name == nullptr || length <= 0) return CUDA_ERROR_INVALID_VALUE;
    const std::size_t copied = driver().part.name.copy(name, static_cast<std::size_t>(length) - 1);
    name[copied] = '\0';
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetUuid_v2(CUuuid* uuid, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    if (uuid == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const std::string text = fmt::format("UrgenGo-simgpu-{}", device);
    static_assert(sizeof uuid->bytes == 16 && Part::kMostInMachine <= 10);
    text.copy(uuid->bytes, sizeof uuid->bytes);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetUuid(CUuuid* uuid, CUdevice device) {
    return cuDeviceGetUuid_v2(uuid, device);
}

SIMGPU_API CUresult cuDeviceTotalMem_v2(std::size_t* bytes, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    if (bytes == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *bytes = driver().part.memory_bytes;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetAttribute(int* value, CUdevice_attribute which, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    if (value == nullptr || which <= 0 || which >= CU_DEVICE_ATTRIBUTE_MAX) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    *value = attribute(which, device);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceComputeCapability(int* major, int* minor, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    if (major == nullptr || minor == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *major = attribute(CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR, device);
    *minor = attribute(CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR, device);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetPCIBusId(char* id, int length, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    const std::string text = pci_bus_id(device);
    if (id == nullptr || length <= static_cast<int>(text.size())) return CUDA_ERROR_INVALID_VALUE;
    std::memcpy(id, text.c_str(), text.size() + 1);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDeviceGetByPCIBusId(CUdevice* device, const char* id) {
    if (CUresult error = require_init()) return error;
    if (device == nullptr || id == nullptr) return CUDA_ERROR_INVALID_VALUE;
    for (CUdevice each = 0; each < driver().part.num_in_machine; ++each) {
        if (pci_bus_id(each) != id) continue;
        *device = each;
        return CUDA_SUCCESS;
    }
    return CUDA_ERROR_INVALID_DEVICE;
}
