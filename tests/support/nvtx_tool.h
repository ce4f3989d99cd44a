// SPDX-License-Identifier: Apache-2.0
//
// An NVTX tool in the test's own process, which takes ranges and marks, and neither strings nor
// extensions: so each mark is one line of text ("miss: chain tight, task -, ...").
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "host/observe/nvtx_link.h"
#include "host/observe/nvtx_slots.h"

namespace urgengo::testing {

class NvtxTool {
  public:
    NvtxTool() { lines().clear(); }

    /// @returns a link for Runtime::show_in_nvtx(), or for NvtxOut::attach()
    static std::unique_ptr<observe::NvtxLink> link() {
        return observe::NvtxLink::attach({.initialize = initialize});
    }
    /// @returns the marks of that category and name that came since the object was made, counters'
    ///          left out: what is behind the name
    static std::vector<std::string> marks(observe::nvtx::Category category,
                                          const std::string& name) {
        const std::string begin =
            std::to_string(static_cast<std::uint32_t>(category)) + ' ' + name + ": ";
        std::vector<std::string> found;
        for (const std::string& line : lines())
            if (line.starts_with(begin)) found.push_back(line.substr(begin.size()));
        return found;
    }

  private:
    static std::vector<std::string>& lines() {
        static std::vector<std::string> all;
        return all;
    }
    static void NVTX_API mark(nvtxDomainHandle_t, const nvtxEventAttributes_t* event) {
        if (event->payloadType == NVTX_PAYLOAD_UNKNOWN)
            lines().push_back(std::to_string(event->category) + ' ' + event->message.ascii);
    }
    static nvtxRangeId_t NVTX_API start(nvtxDomainHandle_t, const nvtxEventAttributes_t*) {
        static nvtxRangeId_t last = 0;
        return ++last;
    }
    static int NVTX_API initialize(const void* (*tables)(std::uint32_t)) {
        const auto* const callbacks =
            static_cast<const NvtxExportTableCallbacks*>(tables(NVTX_ETID_CALLBACKS));
        NvtxFunctionTable table = nullptr;
        if (!callbacks->GetModuleFunctionTable(NVTX_CB_MODULE_CORE2, &table, nullptr)) return 0;
        *table[NVTX_CBID_CORE2_DomainMarkEx] = reinterpret_cast<NvtxFunctionPointer>(mark);
        *table[NVTX_CBID_CORE2_DomainRangeStartEx] = reinterpret_cast<NvtxFunctionPointer>(start);
        return 1;
    }
};

}  // namespace urgengo::testing
