// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/gpu_facts.h"

#include <nlohmann/json.hpp>

#include "tools/urgengo/doctor/gpu_session.h"

namespace urgengo::cli {
// Not in the unnamed namespace: nlohmann-json looks for them beside the types.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(GpuDevice, name, compute_major, compute_minor, num_sms,
                                   memory_mib, compute_mode)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(GpuFacts, cuda_version, devices, context_problem, least_priority,
                                   greatest_priority, memory_operation_problem)

namespace {

using Json = nlohmann::json;

constexpr int kBytesPerMibShift = 20;

GpuDevice describe(const GpuSession& gpu, CUdevice device) {
    const auto attribute = [&](CUdevice_attribute which) {
        int value = 0;
        URGENGO_CALL(gpu, cuDeviceGetAttribute, &value, which, device);
        return value;
    };
    GpuDevice found;
    char name[256] = {};
    URGENGO_CALL(gpu, cuDeviceGetName, name, int{sizeof name - 1}, device);
    found.name = name;
    found.compute_major = attribute(CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR);
    found.compute_minor = attribute(CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR);
    found.num_sms = attribute(CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT);
    found.compute_mode = attribute(CU_DEVICE_ATTRIBUTE_COMPUTE_MODE);
    std::size_t bytes = 0;
    URGENGO_CALL(gpu, cuDeviceTotalMem_v2, &bytes, device);
    found.memory_mib = static_cast<std::int64_t>(bytes >> kBytesPerMibShift);
    return found;
}

/// Has a stream write a word and wait for it.
void try_memory_operations(const GpuSession& gpu) {
    CUdeviceptr word = 0;
    URGENGO_CALL(gpu, cuMemAlloc_v2, &word, sizeof(std::uint32_t));
    CUstream stream = nullptr;
    URGENGO_CALL(gpu, cuStreamCreate, &stream, unsigned{CU_STREAM_NON_BLOCKING});
    constexpr std::uint32_t kValue = 0x5a5a5a5a;
    URGENGO_CALL(gpu, cuStreamWriteValue32_v2, stream, word, kValue, 0u);
    URGENGO_CALL(gpu, cuStreamWaitValue32_v2, stream, word, kValue,
                 unsigned{CU_STREAM_WAIT_VALUE_EQ});
    URGENGO_CALL(gpu, cuStreamSynchronize, stream);
    std::uint32_t read = 0;
    URGENGO_CALL(gpu, cuMemcpyDtoH_v2, &read, word, sizeof read);
    if (read != kValue) throw DriverFailure("a value that a stream wrote did not arrive");
}

GpuFacts ask(const std::string& library) {
    const GpuSession gpu(library);
    GpuFacts facts;
    URGENGO_CALL(gpu, cuDriverGetVersion, &facts.cuda_version);
    int count = 0;
    URGENGO_CALL(gpu, cuDeviceGetCount, &count);
    for (int i = 0; i < count; ++i) {
        CUdevice device = 0;
        URGENGO_CALL(gpu, cuDeviceGet, &device, i);
        facts.devices.push_back(describe(gpu, device));
    }
    try {
        gpu.enter_context();
        URGENGO_CALL(gpu, cuCtxGetStreamPriorityRange, &facts.least_priority,
                     &facts.greatest_priority);
    } catch (const DriverFailure& failure) {
        facts.context_problem = failure.what();
        return facts;
    }
    try {
        try_memory_operations(gpu);
    } catch (const DriverFailure& failure) {
        facts.memory_operation_problem = failure.what();
    }
    return facts;
}

}  // namespace

Result<GpuFacts> find_gpu_facts(const std::string& library, std::chrono::milliseconds limit) {
    const auto answer = ask_in_child(
        [&] {
            Json json;
            try {
                json["facts"] = ask(library);
            } catch (const DriverFailure& failure) {
                json["problem"] = failure.what();
            }
            return json.dump(-1, ' ', false, Json::error_handler_t::replace);
        },
        limit);
    if (!answer) return Error{answer.error()};
    const Json json = Json::parse(*answer);  // by the same build: always as above
    if (json.contains("problem")) return Error{json["problem"].get<std::string>()};
    return json["facts"].get<GpuFacts>();
}

}  // namespace urgengo::cli
