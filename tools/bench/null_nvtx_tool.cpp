// SPDX-License-Identifier: Apache-2.0
//
// An NVTX tool that takes all that UrgenGo tells and does nothing with it: what a call costs while
// it is attached is what telling costs. Every call of a thread is counted.
#ifndef NVTX_NO_IMPL
#define NVTX_NO_IMPL
#endif
#include <nvtx3/nvToolsExtCounters.h>
#include <nvtx3/nvToolsExtPayload.h>

#include <cstddef>
#include <cstdint>

#define EXPORTED extern "C" __attribute__((visibility("default")))

namespace {

/// Above all that is a type or a scope by itself.
constexpr std::uint64_t kSomeId = std::uint64_t{1} << 62;

__attribute__((tls_model("initial-exec"))) thread_local std::uint64_t t_num_calls = 0;

template <typename... Arguments>
void NVTX_API take(Arguments...) {
    ++t_num_calls;
}
template <typename... Arguments>
std::uint64_t NVTX_API take_and_name(Arguments...) {
    ++t_num_calls;
    return kSomeId;
}
nvtxDomainHandle_t NVTX_API create(const char*) {
    return reinterpret_cast<nvtxDomainHandle_t>(kSomeId);
}
nvtxStringHandle_t NVTX_API keep(nvtxDomainHandle_t, const char*) {
    return reinterpret_cast<nvtxStringHandle_t>(kSomeId);
}

}  // namespace

/// Calls that the calling thread has made of this tool.
EXPORTED std::uint64_t nullnvtx_num_calls() {
    return t_num_calls;
}

EXPORTED int InitializeInjectionNvtx2(NvtxGetExportTableFunc_t tables) {
    const auto* const callbacks =
        static_cast<const NvtxExportTableCallbacks*>(tables(NVTX_ETID_CALLBACKS));
    NvtxFunctionTable core2 = nullptr;
    if (!callbacks->GetModuleFunctionTable(NVTX_CB_MODULE_CORE2, &core2, nullptr)) return 0;
    const auto listen = [&](NvtxCallbackIdCore2 id, auto* function) {
        *core2[id] = reinterpret_cast<NvtxFunctionPointer>(function);
    };
    using Event = const nvtxEventAttributes_t*;
    listen(NVTX_CBID_CORE2_DomainCreateA, create);
    listen(NVTX_CBID_CORE2_DomainRegisterStringA, keep);
    listen(NVTX_CBID_CORE2_DomainMarkEx, take<nvtxDomainHandle_t, Event>);
    listen(NVTX_CBID_CORE2_DomainRangeStartEx, take_and_name<nvtxDomainHandle_t, Event>);
    listen(NVTX_CBID_CORE2_DomainRangeEnd, take<nvtxDomainHandle_t, nvtxRangeId_t>);
    return 1;
}

EXPORTED int InitializeInjectionNvtxExtension(nvtxExtModuleInfo_t* module) {
    const auto listen = [&](std::size_t id, auto* function) {
        module->segments[0].functionSlots[id] = reinterpret_cast<std::intptr_t>(function);
    };
    using Domain = nvtxDomainHandle_t;
    using Data = const nvtxPayloadData_t*;
    if (module->moduleId == NVTX_EXT_PAYLOAD_MODULEID) {
        listen(NVTX3EXT_CBID_nvtxPayloadSchemaRegister,
               take_and_name<Domain, const nvtxPayloadSchemaAttr_t*>);
        listen(NVTX3EXT_CBID_nvtxScopeRegister, take_and_name<Domain, const nvtxScopeAttr_t*>);
        listen(NVTX3EXT_CBID_nvtxTimeDomainRegister,
               take_and_name<Domain, const nvtxTimeDomainAttr_t*>);
        listen(NVTX3EXT_CBID_nvtxTimeSyncPointTable,
               take<Domain, std::uint64_t, std::uint64_t, const nvtxSyncPoint_t*, std::size_t>);
        listen(NVTX3EXT_CBID_nvtxEventSubmit, take<Domain, Data, std::size_t>);
        listen(NVTX3EXT_CBID_nvtxRangeEndPayload, take<Domain, nvtxRangeId_t, Data, std::size_t>);
    }
    if (module->moduleId == NVTX_EXT_COUNTERS_MODULEID) {
        listen(NVTX3EXT_CBID_nvtxCounterRegister, take_and_name<Domain, const nvtxCounterAttr_t*>);
        listen(NVTX3EXT_CBID_nvtxCounterSampleInt64, take<Domain, std::uint64_t, std::int64_t>);
    }
    return 1;
}
