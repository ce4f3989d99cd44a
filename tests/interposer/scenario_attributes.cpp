// SPDX-License-Identifier: Apache-2.0
//
// cuLaunchKernelEx: attributes of the program's own, and configs at the edge of what is allowed.
#include <array>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

CUlaunchAttribute own_priority(int priority) {
    CUlaunchAttribute attribute{};
    attribute.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    attribute.value.priority = priority;
    return attribute;
}

CUlaunchAttribute harmless() {
    CUlaunchAttribute attribute{};
    attribute.id = CU_LAUNCH_ATTRIBUTE_MEM_SYNC_DOMAIN;
    attribute.value.memSyncDomain = CU_LAUNCH_MEM_SYNC_DOMAIN_DEFAULT;
    return attribute;
}

CUresult launch(CUfunction f, std::vector<CUlaunchAttribute>& attributes, CUstream stream,
                void** parameters = nullptr, void** extra = nullptr) {
    const CUlaunchConfig config{
        1, 1, 1, 32, 1, 1, 0, stream, attributes.data(), static_cast<unsigned>(attributes.size())};
    return cuLaunchKernelEx(&config, f, parameters, extra);
}

// A priority that the program chose for a launch stays, however many other attributes there are.
void own_priorities(const Gpu& gpu) {
    const CUstream stream = make_stream();
    const CUfunction f = gpu.function("chosen");
    for (int priority : {-2, 0, -5, 3}) {
        std::vector<CUlaunchAttribute> attributes{harmless(), own_priority(priority)};
        SHOW(launch(f, attributes, stream));
    }
    std::vector<CUlaunchAttribute> many(40, harmless());
    many[39] = own_priority(-4);
    SHOW(launch(f, many, stream));
    SHOW(cuStreamSynchronize(stream));
    int priority = 0;
    SHOW(cuStreamGetPriority(stream, &priority));
    say("stream's priority %d", priority);
}

void many_attributes(const Gpu& gpu) {
    std::uint64_t* to = make_mapped(2);
    CUdeviceptr d_to = on_gpu(to);
    std::uint64_t value = 0;
    void* parameters[] = {&d_to, &value, &value};
    for (std::size_t count : {0u, 1u, 30u, 31u, 32u, 33u, 200u}) {
        std::vector<CUlaunchAttribute> attributes(count, harmless());
        value = count + 1;
        SHOW(launch(gpu.store, attributes, nullptr, parameters));
        SHOW(cuStreamSynchronize(nullptr));
        say("%zu attributes: %d", count, int(to[0]));
    }
}

void edges(const Gpu& gpu) {
    CUlaunchConfig config{1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, 0};
    SHOW(cuLaunchKernelEx(&config, gpu.tiny, nullptr, nullptr));
    if (simulated()) {  // a real driver may read what is not there
        config.numAttrs = 3;
        SHOW(cuLaunchKernelEx(&config, gpu.tiny, nullptr, nullptr));
        SHOW(cuLaunchKernelEx(nullptr, gpu.tiny, nullptr, nullptr));
    }
    config.numAttrs = 0;
    config.attrs = reinterpret_cast<CUlaunchAttribute*>(8);  // none, so never read
    SHOW(cuLaunchKernelEx(&config, gpu.tiny, nullptr, nullptr));
    config.attrs = nullptr;
    config.gridDimY = 0;
    SHOW(cuLaunchKernelEx(&config, gpu.tiny, nullptr, nullptr));
    SHOW(cuCtxSynchronize());
}

// Parameters in one buffer, and programmatic dependence on the launch before.
void other_forms(const Gpu& gpu) {
    std::uint64_t* to = make_mapped(2);
    std::array<std::uint64_t, 3> buffer{on_gpu(to), 71, 71};
    std::size_t bytes = sizeof buffer;
    void* extra[] = {CU_LAUNCH_PARAM_BUFFER_POINTER, buffer.data(), CU_LAUNCH_PARAM_BUFFER_SIZE,
                     &bytes, CU_LAUNCH_PARAM_END};
    std::vector<CUlaunchAttribute> dependent(1);
    dependent[0].id = CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION;
    dependent[0].value.programmaticStreamSerializationAllowed = 1;
    SHOW(launch(gpu.tiny, dependent, nullptr));
    SHOW(launch(gpu.store, dependent, nullptr, nullptr, extra));
    SHOW(cuCtxSynchronize());
    say("%d", int(to[0]));
    buffer[1] = 72;
    SHOW(cuLaunchKernel(gpu.store, 1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, extra));
    SHOW(cuCtxSynchronize());
    say("%d", int(to[0]));
}

int attributes(const Arguments&) {
    const Gpu gpu;
    if (simulated()) own_priorities(gpu);  // whose log tells priorities
    many_attributes(gpu);
    edges(gpu);
    other_forms(gpu);
    return 0;
}

// What a stream says of itself is what the program gave it.
int priorities(const Arguments&) {
    const Gpu gpu;
    for (int given : {0, -1, -5, 2}) {
        const CUstream stream = make_stream(CU_STREAM_NON_BLOCKING, given);
        int before = 0, after = 0;
        SHOW(cuStreamGetPriority(stream, &before));
        for (int i = 0; i < 5; ++i) MUST(launch_wide(gpu.wide, stream));
        SHOW(cuStreamGetPriority(stream, &after));
        SHOW(cuStreamSynchronize(stream));
        CUstreamAttrValue value{};
        SHOW(cuStreamGetAttribute(stream, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value));
        say("given %d: %d %d %d", given, before, after, value.priority);
    }
    int least = 0, greatest = 0;
    SHOW(cuCtxGetStreamPriorityRange(&least, &greatest));
    say("range %d %d", least, greatest);
    return 0;
}

const Scenario s1("attributes", attributes), s2("priorities", priorities);

}  // namespace
}  // namespace twin
