// SPDX-License-Identifier: Apache-2.0
#include "host/observe/nvtx_slots.h"

namespace urgengo::observe {
namespace {

// Sizes and alignments of NVTX_PAYLOAD_ENTRY_TYPE_*, in their order, as NVTX tells them.
template <typename T>
constexpr nvtxPayloadEntryTypeInfo_t size_of() {
    return {sizeof(T), alignof(T)};
}
const nvtxPayloadEntryTypeInfo_t kTypes[NVTX_PAYLOAD_ENTRY_TYPE_INFO_ARRAY_SIZE] = {
    {NVTX_PAYLOAD_ENTRY_TYPE_INFO_ARRAY_SIZE, sizeof(nvtxPayloadEntryTypeInfo_t)},
    size_of<char>(),
    size_of<unsigned char>(),
    size_of<short>(),
    size_of<unsigned short>(),
    size_of<int>(),
    size_of<unsigned int>(),
    size_of<long>(),
    size_of<unsigned long>(),
    size_of<long long>(),
    size_of<unsigned long long>(),
    size_of<std::int8_t>(),
    size_of<std::uint8_t>(),
    size_of<std::int16_t>(),
    size_of<std::uint16_t>(),
    size_of<std::int32_t>(),
    size_of<std::uint32_t>(),
    size_of<std::int64_t>(),
    size_of<std::uint64_t>(),
    size_of<float>(),
    size_of<double>(),
    size_of<long double>(),
    size_of<std::size_t>(),
    size_of<void*>(),
    size_of<wchar_t>(),
    size_of<char8_t>(),
    size_of<char16_t>(),
    size_of<char32_t>()};

// The tool asks through functions that know no object: it fills the newest tables.
struct Asked {
    NvtxFunctionTable tables[NVTX_CB_MODULE_SIZE] = {};
    unsigned sizes[NVTX_CB_MODULE_SIZE] = {};
};
Asked g_asked;

int NVTX_API module_table(NvtxCallbackModule module, NvtxFunctionTable* table, unsigned* size) {
    if (module <= NVTX_CB_MODULE_INVALID || module >= NVTX_CB_MODULE_SIZE) return 0;
    if (table) *table = g_asked.tables[module];
    if (size) *size = g_asked.sizes[module];
    return 1;
}

void NVTX_API set_version(std::uint32_t) {}

const void* NVTX_API export_table(std::uint32_t id) {
    static const NvtxExportTableCallbacks callbacks{sizeof callbacks, module_table};
    static const NvtxExportTableVersionInfo version{sizeof version, NVTX_VERSION, 0, set_version};
    if (id == NVTX_ETID_CALLBACKS) return &callbacks;
    if (id == NVTX_ETID_VERSIONINFO) return &version;
    return nullptr;
}

template <std::size_t kSize>
void offer(NvtxCallbackModule module, NvtxModule<kSize>& its) {
    g_asked.tables[module] = its.table;
    g_asked.sizes[module] = kSize;
}

void initialize_module(const NvtxInjection& tool, std::uint16_t id, std::uint16_t version,
                       std::intptr_t (&slots)[NvtxSlots::kNumSlots], const void* info) {
    nvtxExtModuleSegment_t segment{0, NvtxSlots::kNumSlots, slots};
    nvtxExtModuleInfo_t module{NVTX_VERSION, sizeof module, id,  version, 1,
                               &segment,     nullptr,       info};
    if (tool.initialize_extension(&module) != 0) return;
    for (std::intptr_t& slot : slots) slot = 0;  // NVTX calls nothing then, either
}

}  // namespace

bool NvtxSlots::fill(const NvtxInjection& tool) {
    offer(NVTX_CB_MODULE_CORE, core);
    offer(NVTX_CB_MODULE_CORE2, core2);
    offer(NVTX_CB_MODULE_CUDA, cuda);
    offer(NVTX_CB_MODULE_CUDART, cudart);
    offer(NVTX_CB_MODULE_OPENCL, opencl);
    offer(NVTX_CB_MODULE_SYNC, sync);
    if (tool.initialize(export_table) == 0) return false;
    if (!tool.initialize_extension) return true;
    initialize_module(tool, NVTX_EXT_PAYLOAD_MODULEID, NVTX_EXT_PAYLOAD_COMPATID, payload, kTypes);
    initialize_module(tool, NVTX_EXT_COUNTERS_MODULEID, NVTX_EXT_COUNTERS_COMPATID, counters,
                      nullptr);
    return true;
}

}  // namespace urgengo::observe
