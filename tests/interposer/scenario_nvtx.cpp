// SPDX-License-Identifier: Apache-2.0
//
// NVTX ranges around launches: what NVTX answers and, if asked, whether a tool is
// there (only then are there domains).
#include <nvtx3/nvToolsExt.h>

#include <string>

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

// More names than a tool need keep.
int nvtx_many(const Arguments&) {
    const nvtxDomainHandle_t domain = nvtxDomainCreateA("a domain");
    const nvtxStringHandle_t first = nvtxDomainRegisterStringA(domain, "0");
    int num_kept = 0;
    for (int i = 0; i < 70'000; ++i)
        if (nvtxDomainRegisterStringA(domain, std::to_string(i).c_str())) ++num_kept;
    say("kept %d, the first again %d", num_kept, nvtxDomainRegisterStringA(domain, "0") == first);
    // One that is not kept is a range nevertheless.
    nvtxEventAttributes_t event{};
    event.version = NVTX_VERSION;
    event.size = NVTX_EVENT_ATTRIB_STRUCT_SIZE;
    event.messageType = NVTX_MESSAGE_TYPE_REGISTERED;
    event.message.registered = nvtxDomainRegisterStringA(domain, "one more");
    say("range: %d %d", nvtxDomainRangePushEx(domain, &event), nvtxDomainRangePop(domain));
    return 0;
}

const Scenario s1("nvtx", nvtx), s2("nvtx_many", nvtx_many);

}  // namespace
}  // namespace twin
