// SPDX-License-Identifier: Apache-2.0
//
// The recorder's extensions: payloads, deferred events, counters, memory.
#include "tests/interposer/nvtx_recorder.h"

#include <nvtx3/nvToolsExtMem.h>
#include <nvtx3/nvToolsExtSemanticsTime.h>

#include <cinttypes>
#include <cstring>
#include <map>
#include <mutex>
#include <vector>

#define EXPORT extern "C" __attribute__((visibility("default")))

namespace recorder {
namespace {

struct Entry {
    std::string name;
    std::uint64_t type;
    std::uint64_t flags;
    std::size_t offset;
};
struct Schema {
    std::vector<Entry> entries;
    std::size_t size;
};

std::mutex g_mutex;
std::map<std::uint64_t, Schema>& schemas() {
    static auto* const all = new std::map<std::uint64_t, Schema>;
    return *all;
}

std::string value(nvtxDomainHandle_t domain, const Entry& entry, const char* at) {
    std::uint64_t word = 0;
    switch (entry.type) {
        case NVTX_PAYLOAD_ENTRY_TYPE_INT32:
            return std::to_string(*reinterpret_cast<const std::int32_t*>(at));
        case NVTX_PAYLOAD_ENTRY_TYPE_UINT32:
        case NVTX_PAYLOAD_ENTRY_TYPE_CATEGORY:
            return std::to_string(*reinterpret_cast<const std::uint32_t*>(at));
        default:
            std::memcpy(&word, at, sizeof word);
    }
    switch (entry.type) {
        case NVTX_PAYLOAD_ENTRY_TYPE_INT64:
            return std::to_string(static_cast<std::int64_t>(word));
        case NVTX_PAYLOAD_ENTRY_TYPE_UINT64:
            return std::to_string(word);
        case NVTX_PAYLOAD_ENTRY_TYPE_CSTRING:
            return reinterpret_cast<const char*>(word);
        case NVTX_PAYLOAD_ENTRY_TYPE_NVTX_REGISTERED_STRING_HANDLE:
            return word == 0 ? "-" : name_of("string", domain, word);
        default:
            wrong("an entry of type %" PRIu64, entry.type);
            return "?";
    }
}

std::string payload(nvtxDomainHandle_t domain, std::uint64_t schema_id, const char* data,
                    std::size_t size) {
    if (schema_id < NVTX_PAYLOAD_SCHEMA_ID_STATIC_START)  // a type by itself
        return " {" + value(domain, {"", schema_id, 0, 0}, data) + "}";
    name_of("schema", domain, schema_id);  // is it registered?
    const std::lock_guard lock(g_mutex);
    const auto found = schemas().find(schema_id);
    if (found == schemas().end()) return " {?}";
    if (size != found->second.size) wrong("a payload of %zu bytes", size);
    std::string text = " {";
    for (const Entry& entry : found->second.entries) {
        if (text.size() > 2) text += ", ";
        text += entry.name + ": " + value(domain, entry, data + entry.offset);
    }
    return text + "}";
}

std::uint64_t register_schema(nvtxDomainHandle_t domain, const nvtxPayloadSchemaAttr_t* attr) {
    const std::uint64_t id = add("schema", domain, attr->name);
    Schema schema{{}, attr->payloadStaticSize};
    std::string text;
    std::size_t offset = 0;
    for (std::size_t i = 0; i < attr->numEntries; ++i) {
        const nvtxPayloadSchemaEntry_t& entry = attr->entries[i];
        if (entry.offset != 0) offset = entry.offset;
        schema.entries.push_back({entry.name, entry.type, entry.flags, offset});
        offset += 8;
        text += std::string(" ") + entry.name;
        if (entry.semantics && entry.semantics->semanticId == NVTX_SEMANTIC_ID_TIME_V1) {
            const auto& time = *reinterpret_cast<const nvtxSemanticsTime_t*>(entry.semantics);
            text += " (time of " + name_of("time domain", domain, time.timeDomainId) + ")";
        }
    }
    say("[%s] schema %s:%s", domain_name(domain).c_str(), attr->name, text.c_str());
    const std::lock_guard lock(g_mutex);
    schemas()[id] = schema;
    return id;
}

void mark_payload(nvtxDomainHandle_t domain, const nvtxPayloadData_t* data, std::size_t count) {
    say("[%s] mark%s", domain_name(domain).c_str(), payloads(domain, data, count).c_str());
}
int push_payload(nvtxDomainHandle_t domain, const nvtxPayloadData_t* data, std::size_t count) {
    const int depth = push(domain);
    say("[%s] push%s = %d", domain_name(domain).c_str(), payloads(domain, data, count).c_str(),
        depth);
    return depth;
}
int pop_payload(nvtxDomainHandle_t domain, const nvtxPayloadData_t* data, std::size_t count) {
    const int depth = pop(domain);
    say("[%s] pop%s = %d", domain_name(domain).c_str(), payloads(domain, data, count).c_str(),
        depth);
    return depth;
}
nvtxRangeId_t start_payload(nvtxDomainHandle_t domain, const nvtxPayloadData_t* data,
                            std::size_t count) {
    const nvtxRangeId_t id = start(domain);
    say("[%s] start%s = %" PRIu64, domain_name(domain).c_str(),
        payloads(domain, data, count).c_str(), id);
    return id;
}
void end_payload(nvtxDomainHandle_t domain, nvtxRangeId_t id, const nvtxPayloadData_t* data,
                 std::size_t count) {
    say("[%s] end %" PRIu64 "%s", domain_name(domain).c_str(), id,
        payloads(domain, data, count).c_str());
    end(domain, id);
}
std::uint8_t is_enabled(nvtxDomainHandle_t domain) {
    domain_name(domain);
    return 7;  // enabled, and no other tool's answer
}
std::uint64_t register_scope(nvtxDomainHandle_t domain, const nvtxScopeAttr_t* attr) {
    say("[%s] scope %s", domain_name(domain).c_str(), attr->path);
    return add("scope", domain, attr->path);
}
std::uint64_t register_time_domain(nvtxDomainHandle_t domain, const nvtxTimeDomainAttr_t* attr) {
    say("[%s] time domain of type %" PRIu64, domain_name(domain).c_str(), attr->timestampTypeId);
    if (attr->scopeId >= NVTX_SCOPE_ID_DYNAMIC_START) name_of("scope", domain, attr->scopeId);
    return add("time domain", domain, "type " + std::to_string(attr->timestampTypeId));
}
void check_time(nvtxDomainHandle_t domain, std::uint64_t id) {
    if (id >= NVTX_TIME_DOMAIN_ID_STATIC_START) name_of("time domain", domain, id);
}
void sync_points(nvtxDomainHandle_t domain, std::uint64_t from, std::uint64_t to,
                 const nvtxSyncPoint_t* points, std::size_t count) {
    check_time(domain, from);
    check_time(domain, to);
    for (std::size_t i = 1; i < count; ++i)
        if (points[i].src <= points[i - 1].src) wrong("sync points that are not in order");
    say("[%s] sync points: %s", domain_name(domain).c_str(), count >= 2 ? "enough" : "too few");
}
std::int64_t timestamp() {
    return 12345;
}
void submit(nvtxDomainHandle_t domain, const nvtxPayloadData_t* data, std::size_t count) {
    say("[%s] event%s", domain_name(domain).c_str(), payloads(domain, data, count).c_str());
}
void submit_batch(nvtxDomainHandle_t domain, const nvtxEventBatch_t* batch) {
    std::size_t size = 0;
    {
        const std::lock_guard lock(g_mutex);
        size = schemas()[batch->eventSchemaId].size;
    }
    if (size == 0 || batch->size % size != 0) return wrong("a batch of %zu bytes", batch->size);
    for (std::size_t at = 0; at < batch->size; at += size) {
        const nvtxPayloadData_t one{batch->eventSchemaId, size,
                                    static_cast<const char*>(batch->events) + at};
        submit(domain, &one, 1);
    }
}

std::uint64_t register_counter(nvtxDomainHandle_t domain, const nvtxCounterAttr_t* attr) {
    if (attr->scopeId >= NVTX_SCOPE_ID_DYNAMIC_START) name_of("scope", domain, attr->scopeId);
    say("[%s] counter %s", domain_name(domain).c_str(), attr->name);
    return add("counter", domain, attr->name);
}
void sample(nvtxDomainHandle_t domain, std::uint64_t counter, std::int64_t value) {
    say("[%s] sample %s %" PRIi64, domain_name(domain).c_str(),
        name_of("counter", domain, counter).c_str(), value);
}

nvtxMemHeapHandle_t register_heap(nvtxDomainHandle_t domain, const nvtxMemHeapDesc_t* heap) {
    say("[%s] heap %s", domain_name(domain).c_str(), heap->message.ascii);
    return reinterpret_cast<nvtxMemHeapHandle_t>(add("heap", domain, heap->message.ascii));
}

}  // namespace

std::string payloads(nvtxDomainHandle_t domain, const nvtxPayloadData_t* data, std::size_t count) {
    std::string text;
    for (std::size_t i = 0; i < count; ++i)
        text += payload(domain, data[i].schemaId, static_cast<const char*>(data[i].payload),
                        data[i].size);
    return text;
}

}  // namespace recorder

EXPORT int InitializeInjectionNvtxExtension(nvtxExtModuleInfo_t* module) {
    using namespace recorder;
    say("init of module %d", module->moduleId);
    if (lacks("extensions")) return 0;
    const auto listen = [&](std::size_t id, auto* function) {
        if (id >= module->segments[0].slotCount) return wrong("module has no slot %zu", id);
        module->segments[0].functionSlots[id] = reinterpret_cast<std::intptr_t>(function);
    };
    if (module->moduleId == NVTX_EXT_PAYLOAD_MODULEID && !lacks("payload")) {
        if (!module->extInfo) wrong("no sizes of types");
        listen(NVTX3EXT_CBID_nvtxPayloadSchemaRegister, register_schema);
        listen(NVTX3EXT_CBID_nvtxMarkPayload, mark_payload);
        listen(NVTX3EXT_CBID_nvtxRangePushPayload, push_payload);
        listen(NVTX3EXT_CBID_nvtxRangePopPayload, pop_payload);
        listen(NVTX3EXT_CBID_nvtxRangeStartPayload, start_payload);
        listen(NVTX3EXT_CBID_nvtxRangeEndPayload, end_payload);
        listen(NVTX3EXT_CBID_nvtxDomainIsEnabled, is_enabled);
        listen(NVTX3EXT_CBID_nvtxScopeRegister, register_scope);
        listen(NVTX3EXT_CBID_nvtxTimestampGet, timestamp);
        listen(NVTX3EXT_CBID_nvtxTimeDomainRegister, register_time_domain);
        listen(NVTX3EXT_CBID_nvtxTimeSyncPointTable, sync_points);
        listen(NVTX3EXT_CBID_nvtxEventSubmit, submit);
        listen(NVTX3EXT_CBID_nvtxEventBatchSubmit, submit_batch);
    }
    if (module->moduleId == NVTX_EXT_COUNTERS_MODULEID && !lacks("counters")) {
        listen(NVTX3EXT_CBID_nvtxCounterRegister, register_counter);
        listen(NVTX3EXT_CBID_nvtxCounterSampleInt64, sample);
    }
    if (module->moduleId == NVTX_EXT_MODULEID_MEM)
        listen(NVTX3EXT_CBID_nvtxMemHeapRegister, register_heap);
    return 1;
}
