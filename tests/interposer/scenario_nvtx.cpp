// SPDX-License-Identifier: Apache-2.0
//
// NVTX ranges around launches: what NVTX answers and, if asked, whether a tool is
// there (only then are there domains).
#include <nvtx3/nvToolsExt.h>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

int nvtx(const Arguments& arguments) {
    Gpu gpu;
    CUstream stream = make_stream();
    nvtxDomainHandle_t domain = nvtxDomainCreateA("a domain");
    if (!arguments.empty()) say("a tool: %d", domain != nullptr);
    for (int i = 0; i < 20; ++i) {
        say("push: %d %d", nvtxRangePushA("frame"), nvtxRangePushW(L"detect"));
        SHOW(launch_tiny(gpu.tiny, stream));
        SHOW(cuStreamSynchronize(stream));
        say("pop: %d %d", nvtxRangePop(), nvtxRangePop());
    }
    nvtxEventAttributes_t event{};
    event.version = NVTX_VERSION;
    event.size = NVTX_EVENT_ATTRIB_STRUCT_SIZE;
    event.messageType = NVTX_MESSAGE_TYPE_REGISTERED;
    event.message.registered = nvtxDomainRegisterStringA(domain, "registered");
    say("domain: %d %d", nvtxDomainRangePushEx(domain, &event), nvtxDomainRangePop(domain));
    say("range: %d", static_cast<int>(nvtxRangeStartA("anywhere")));
    nvtxDomainDestroy(domain);
    return 0;
}

const Scenario s1("nvtx", nvtx);

}  // namespace
}  // namespace twin
