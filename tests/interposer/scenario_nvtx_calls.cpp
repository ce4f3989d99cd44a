// SPDX-License-Identifier: Apache-2.0
//
// A call of each kind that NVTX has, and what it answers: handles, too, which tests make with a
// tool whose handles are the same at every run (nvtx_recorder.h).
#include <nvtx3/nvToolsExtCounters.h>
#include <nvtx3/nvToolsExtCuda.h>
#include <nvtx3/nvToolsExtMem.h>
#include <nvtx3/nvToolsExtPayload.h>
#include <nvtx3/nvToolsExtSync.h>
#include <unistd.h>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

template <typename Handle>
unsigned long long number(Handle handle) {
    return reinterpret_cast<unsigned long long>(handle);
}

nvtxEventAttributes_t event(const char* text) {
    nvtxEventAttributes_t event{};
    event.version = NVTX_VERSION;
    event.size = NVTX_EVENT_ATTRIB_STRUCT_SIZE;
    event.messageType = NVTX_MESSAGE_TYPE_ASCII;
    event.message.ascii = text;
    return event;
}

void default_domain() {
    auto with = event("ex");
    with.category = 3;
    with.payloadType = NVTX_PAYLOAD_TYPE_INT64;
    with.payload.llValue = 17;
    nvtxMarkA("a mark");
    nvtxMarkW(L"a wide mark");
    nvtxMarkEx(&with);
    say("pushed %d %d %d", nvtxRangePushA("one"), nvtxRangePushW(L"two"), nvtxRangePushEx(&with));
    say("popped %d %d %d", nvtxRangePop(), nvtxRangePop(), nvtxRangePop());
    say("popped one too many %d", nvtxRangePop());
    const nvtxRangeId_t ids[] = {nvtxRangeStartA("a"), nvtxRangeStartW(L"b"),
                                 nvtxRangeStartEx(&with)};
    for (const nvtxRangeId_t id : ids) {
        say("started %llu", static_cast<unsigned long long>(id));
        nvtxRangeEnd(id);
    }
    nvtxNameCategoryA(3, "third");
    nvtxNameCategoryW(4, L"fourth");
    nvtxNameOsThreadA(static_cast<std::uint32_t>(gettid()), "main");
}

void own_domain(CUstream stream) {
    const nvtxDomainHandle_t domain = nvtxDomainCreateA("mine");
    const nvtxStringHandle_t text = nvtxDomainRegisterStringA(domain, "registered");
    const nvtxStringHandle_t wide = nvtxDomainRegisterStringW(domain, L"registered wide");
    say("domain %llx %llx, strings %llx %llx", number(domain), number(nvtxDomainCreateW(L"other")),
        number(text), number(wide));
    nvtxDomainNameCategoryA(domain, 1, "first");
    auto with = event("plain");
    say("pushed %d", nvtxDomainRangePushEx(domain, &with));
    with.messageType = NVTX_MESSAGE_TYPE_REGISTERED;
    with.message.registered = text;
    say("pushed %d", nvtxDomainRangePushEx(domain, &with));
    with.message.registered = wide;
    nvtxDomainMarkEx(domain, &with);
    say("popped %d %d", nvtxDomainRangePop(domain), nvtxDomainRangePop(domain));
    const nvtxRangeId_t id = nvtxDomainRangeStartEx(domain, &with);
    nvtxDomainRangeEnd(domain, id);
    nvtxResourceAttributes_t resource{};
    resource.version = NVTX_VERSION;
    resource.size = NVTX_RESOURCE_ATTRIB_STRUCT_SIZE;
    resource.messageType = NVTX_MESSAGE_TYPE_ASCII;
    resource.message.ascii = "a resource";
    const nvtxResourceHandle_t made = nvtxDomainResourceCreate(domain, &resource);
    say("resource %llx", number(made));
    nvtxDomainResourceDestroy(made);
    nvtxNameCuStreamA(stream, "a stream");
    const nvtxSyncUserAttributes_t attributes{};
    const nvtxSyncUser_t sync = nvtxDomainSyncUserCreate(domain, &attributes);
    say("sync %llx", number(sync));
    nvtxDomainSyncUserAcquireStart(sync);
    nvtxDomainSyncUserReleasing(sync);  // the recorder does not listen to it
    nvtxDomainSyncUserDestroy(sync);
    nvtxDomainDestroy(domain);
}

void extensions() {
    const nvtxDomainHandle_t domain = nvtxDomainCreateA("extended");
    struct Payload {
        std::int64_t count = 42;
        std::uint64_t text = 0;
    } payload;
    nvtxPayloadSchemaEntry_t entries[2]{};
    entries[0].type = NVTX_PAYLOAD_ENTRY_TYPE_INT64;
    entries[0].name = "count";
    entries[1].type = NVTX_PAYLOAD_ENTRY_TYPE_NVTX_REGISTERED_STRING_HANDLE;
    entries[1].name = "text";
    nvtxPayloadSchemaAttr_t schema{};
    schema.fieldMask = NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_NAME | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_TYPE |
                       NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_ENTRIES |
                       NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_NUM_ENTRIES |
                       NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_STATIC_SIZE;
    schema.name = "a schema";
    schema.type = NVTX_PAYLOAD_SCHEMA_TYPE_STATIC;
    schema.entries = entries;
    schema.numEntries = 2;
    schema.payloadStaticSize = sizeof payload;
    const std::uint64_t id = nvtxPayloadSchemaRegister(domain, &schema);
    say("enabled %d, schema %llx, enum %llx", nvtxDomainIsEnabled(domain),
        static_cast<unsigned long long>(id),
        static_cast<unsigned long long>(nvtxPayloadEnumRegister(domain, nullptr)));
    payload.text = number(nvtxDomainRegisterStringA(domain, "in a payload"));
    const nvtxPayloadData_t data{id, sizeof payload, &payload};
    say("pushed %d", nvtxRangePushPayload(domain, &data, 1));
    nvtxMarkPayload(domain, &data, 1);
    say("popped %d", nvtxRangePopPayload(domain, &data, 1));
    const nvtxRangeId_t range = nvtxRangeStartPayload(domain, &data, 1);
    say("started %llu", static_cast<unsigned long long>(range));
    nvtxRangeEndPayload(domain, range, &data, 1);
    say("time %s", nvtxTimestampGet() == 12345 ? "of the tool" : "of NVTX");

    nvtxCounterAttr_t attributes{};
    attributes.structSize = sizeof attributes;
    attributes.schemaId = NVTX_PAYLOAD_ENTRY_TYPE_INT64;
    attributes.name = "a counter";
    const std::uint64_t counter = nvtxCounterRegister(domain, &attributes);
    say("counter %llx", static_cast<unsigned long long>(counter));
    nvtxCounterSampleInt64(domain, counter, -5);
    nvtxCounterSampleFloat64(domain, counter, 0.5);  // the recorder does not listen to it

    nvtxMemHeapDesc_t heap{};
    heap.extCompatID = NVTX_EXT_COMPATID_MEM;
    heap.structSize = sizeof heap;
    heap.messageType = NVTX_MESSAGE_TYPE_ASCII;
    heap.message.ascii = "a heap";
    say("heap %llx", number(nvtxMemHeapRegister(domain, &heap)));
}

int nvtx_calls(const Arguments&) {
    Gpu gpu;
    CUstream stream = make_stream();
    SHOW(launch_tiny(gpu.tiny, stream));
    default_domain();
    own_domain(stream);
    extensions();
    SHOW(cuStreamSynchronize(stream));
    return 0;
}

const Scenario s1("nvtx_calls", nvtx_calls);

}  // namespace
}  // namespace twin
