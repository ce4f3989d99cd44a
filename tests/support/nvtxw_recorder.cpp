// SPDX-License-Identifier: Apache-2.0
//
// A backend of NVTXW (tools/trace/nvtxw.h) for tests: checks the protocol, and writes all that it
// gets as JSON into the file that the session is named after, when the session ends. What is wrong
// is refused, and kept under "wrong".
//
// NVTXW_RECORDER_REFUSES: what it refuses, though nothing is wrong: "version" or a function's name.
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/trace/nvtxw.h"

namespace {

using nlohmann::json;
using namespace urgengo::trace::nvtxw;

constexpr Code kFailed = 1, kInvalid = 2, kOtherVersion = 6;

struct OpenStream {
    std::string name;
    bool is_open = true;
    std::int64_t last_ns = INT64_MIN;
};
struct KnownSchema {
    std::string name;
    std::vector<std::string> names;
    std::vector<nvtxPayloadSchemaEntry_t> entries;
    std::uint64_t flags = 0;
};
struct State {
    json all = {{"streams", json::array()},   {"wrong", json::array()},
                {"schemas", json::object()},  {"strings", json::array()},
                {"counters", json::object()}, {"categories", json::array()},
                {"syncs", json::array()}};
    std::string path;
    int session = 0, domain = 0;  // their addresses are the handles
    std::deque<std::string> strings;
    std::deque<OpenStream> streams;
    std::map<std::uint64_t, KnownSchema> schemas;
    std::map<std::uint64_t, std::string> counters;
    bool is_begun = false;
};
State* g_state = new State;  // of the newest session
State& state() {
    return *g_state;
}

Code wrong(const std::string& what) {
    state().all["wrong"].push_back(what);
    return kInvalid;
}
bool refuses(const char* function) {
    const char* const what = std::getenv("NVTXW_RECORDER_REFUSES");
    return what && std::strcmp(what, function) == 0;
}
nvtxDomainHandle_t domain_handle() {
    return reinterpret_cast<nvtxDomainHandle_t>(&state().domain);
}
const std::string* string_of(std::uint64_t handle) {
    for (const std::string& text : state().strings)
        if (reinterpret_cast<std::uint64_t>(&text) == handle) return &text;
    return nullptr;
}
OpenStream* stream_of(Stream stream) {
    for (OpenStream& its : state().streams)
        if (&its == stream) return &its;
    return nullptr;
}
json& lines_of(const OpenStream& stream) {
    for (json& each : state().all["streams"])
        if (each["name"] == stream.name) return each;
    std::abort();
}

Code session_begin(const SessionAttributes* attributes, Session* made) {
    if (refuses("SessionBegin")) return kFailed;
    if (attributes->size != sizeof *attributes || !attributes->name) return wrong("session");
    delete g_state;
    g_state = new State;
    state().is_begun = true;
    state().path = attributes->name;
    *made = &state().session;
    return kSuccess;
}
Code session_end(Session session) {
    if (session != &state().session || !state().is_begun) return wrong("end of no session");
    for (const OpenStream& stream : state().streams)
        if (stream.is_open) wrong("the session ends before its stream " + stream.name);
    std::ofstream(state().path) << state().all.dump();
    return kSuccess;
}
Code domain_register(Session session, const DomainAttributes* attributes,
                     nvtxDomainHandle_t* made) {
    if (session != &state().session || attributes->size != sizeof *attributes)
        return wrong("domain");
    state().all["domain"] = attributes->name;
    *made = domain_handle();
    return kSuccess;
}
Code category_register(nvtxDomainHandle_t domain, std::uint32_t category, const char* name) {
    if (domain != domain_handle() || category != state().all["categories"].size() + 1)
        return wrong("category");
    state().all["categories"].push_back(name);
    return kSuccess;
}
Code string_register(nvtxDomainHandle_t domain, const char* text, nvtxStringHandle_t* made) {
    if (refuses("StringRegister")) return kFailed;
    if (domain != domain_handle() || !text || !*text) return wrong("string");
    for (const std::string& known : state().strings)
        if (known == text) return wrong("registered twice: " + known);
    state().all["strings"].push_back(text);
    *made = reinterpret_cast<nvtxStringHandle_t>(&state().strings.emplace_back(text));
    return kSuccess;
}
Code schema_register(nvtxDomainHandle_t domain, const nvtxPayloadSchemaAttr_t* attributes,
                     std::uint64_t* made) {
    constexpr std::uint64_t kNeeded =
        NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_NAME | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_TYPE |
        NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_ENTRIES | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_NUM_ENTRIES |
        NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_STATIC_SIZE;
    if (domain != domain_handle() || (attributes->fieldMask & kNeeded) != kNeeded ||
        attributes->type != NVTX_PAYLOAD_SCHEMA_TYPE_STATIC ||
        attributes->payloadStaticSize != 8 * attributes->numEntries)
        return wrong("schema");
    const std::uint64_t id = NVTX_PAYLOAD_SCHEMA_ID_DYNAMIC_START + state().schemas.size();
    KnownSchema& schema = state().schemas[id];
    schema.name = attributes->name;
    schema.flags = attributes->flags;
    json names = json::array();
    for (std::size_t i = 0; i < attributes->numEntries; ++i) {
        if (attributes->entries[i].offset != 8 * i) return wrong("offset");
        schema.entries.push_back(attributes->entries[i]);
        schema.names.emplace_back(attributes->entries[i].name);
        names.push_back(attributes->entries[i].name);
    }
    state().all["schemas"][schema.name] = names;
    *made = id;
    return kSuccess;
}
Code counter_register(nvtxDomainHandle_t domain, const nvtxCounterAttr_t* attributes,
                      std::uint64_t* made) {
    if (domain != domain_handle() || attributes->structSize != sizeof *attributes ||
        attributes->schemaId != NVTX_PAYLOAD_ENTRY_TYPE_INT64 || !attributes->semantics)
        return wrong("counter");
    *made = (std::uint64_t{1} << 32) + state().counters.size();
    state().counters[*made] = attributes->name;
    state().all["counters"][attributes->name] = attributes->description;
    return kSuccess;
}
Code stream_open(Session session, const StreamAttributes* attributes, Stream* made) {
    if (session != &state().session || attributes->size != sizeof *attributes ||
        attributes->domain != domain_handle() || attributes->time_domain != 14 ||
        attributes->order != Order::kByBegin)
        return wrong("stream");
    for (const OpenStream& known : state().streams)
        if (known.name == attributes->name) return wrong("two streams: " + known.name);
    state().all["streams"].push_back(
        {{"name", attributes->name}, {"events", json::array()}, {"samples", json::array()}});
    *made = &state().streams.emplace_back(OpenStream{attributes->name});
    return kSuccess;
}
Code stream_close(Stream stream) {
    OpenStream* const its = stream_of(stream);
    if (!its || !its->is_open) return wrong("close of no stream");
    its->is_open = false;
    return kSuccess;
}
/// Of each stream times never go back.
bool is_in_order(OpenStream& stream, std::int64_t time_ns) {
    const bool is = time_ns >= stream.last_ns;
    stream.last_ns = time_ns;
    return is;
}
Code event_write(Stream stream, const nvtxPayloadData_t* payloads, std::size_t count) {
    if (refuses("EventWrite")) return kFailed;
    OpenStream* const its = stream_of(stream);
    if (!its || !its->is_open || count != 1) return wrong("event of no stream");
    const auto found = state().schemas.find(payloads->schemaId);
    if (found == state().schemas.end()) return wrong("event of no schema");
    const KnownSchema& schema = found->second;
    if (payloads->size != 8 * schema.entries.size()) return wrong("size of " + schema.name);
    json line = {{"schema", schema.name}};
    std::uint64_t flags = 0;
    std::int64_t begin_ns = 0;
    for (std::size_t i = 0; i < schema.entries.size(); ++i) {
        const nvtxPayloadSchemaEntry_t& entry = schema.entries[i];
        std::int64_t value = 0;
        std::memcpy(&value, static_cast<const char*>(payloads->payload) + 8 * i, sizeof value);
        json told = value;
        if (entry.type == NVTX_PAYLOAD_ENTRY_TYPE_NVTX_REGISTERED_STRING_HANDLE) {
            const std::string* const text = string_of(static_cast<std::uint64_t>(value));
            if (value != 0 && !text) return wrong("no string: " + schema.names[i]);
            told = text ? *text : "";
            if ((entry.flags & NVTX_PAYLOAD_ENTRY_FLAG_EVENT_MESSAGE) && !text)
                return wrong("no message: " + schema.name);
        } else if (entry.type == NVTX_PAYLOAD_ENTRY_TYPE_CATEGORY) {
            if (value < 1 || value > 4) return wrong("category of " + schema.name);
        } else if (entry.flags & NVTX_PAYLOAD_ENTRY_FLAG_TIMESTAMP) {
            const std::uint64_t what = entry.flags & (7 << 12);
            flags |= what;
            if (what == NVTX_PAYLOAD_ENTRY_FLAG_RANGE_END) {
                if (value < begin_ns) return wrong("end before begin of " + schema.name);
            } else {
                begin_ns = value;
            }
        }
        line[schema.names[i]] = told;
    }
    const bool is_mark = schema.flags == NVTX_PAYLOAD_SCHEMA_FLAG_MARK;
    if (flags != static_cast<std::uint64_t>(is_mark ? NVTX_PAYLOAD_ENTRY_FLAG_MARK
                                                    : NVTX_PAYLOAD_ENTRY_FLAG_RANGE_BEGIN |
                                                          NVTX_PAYLOAD_ENTRY_FLAG_RANGE_END))
        return wrong("times of " + schema.name);
    if (!is_in_order(*its, begin_ns)) return wrong("order of " + its->name);
    lines_of(*its)["events"].push_back(line);
    return kSuccess;
}
Code counter_write(Stream stream, std::int64_t time, std::uint64_t counter, const void* value,
                   std::size_t bytes) {
    OpenStream* const its = stream_of(stream);
    const auto found = state().counters.find(counter);
    if (!its || !its->is_open || found == state().counters.end() || bytes != 8)
        return wrong("sample");
    if (!is_in_order(*its, time)) return wrong("order of samples of " + its->name);
    std::int64_t number = 0;
    std::memcpy(&number, value, sizeof number);
    lines_of(*its)["samples"].push_back({found->second, time, number});
    return kSuccess;
}
Code time_sync_point_write(Stream stream, std::uint64_t domain1, std::uint64_t domain2,
                           std::int64_t time1, std::int64_t time2) {
    if (!stream_of(stream)) return wrong("sync point of no stream");
    state().all["syncs"].push_back({domain1, domain2, time1, time2});
    return kSuccess;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) Code nvtxwGetInterface(std::int32_t version,
                                                                         const void** made) {
    static Interface table;
    table = [] {
        Interface filled{};
        filled.session_begin = session_begin;
        filled.session_end = session_end;
        filled.domain_register = domain_register;
        filled.category_register = category_register;
        filled.string_register = string_register;
        filled.schema_register = schema_register;
        filled.counter_register = counter_register;
        filled.stream_open = stream_open;
        filled.stream_close = stream_close;
        filled.event_write = event_write;
        filled.counter_write = counter_write;
        filled.time_sync_point_write = time_sync_point_write;
        return filled;
    }();
    if (version != kVersion || refuses("version")) return kOtherVersion;
    if (refuses("streams")) table.stream_open = nullptr;
    *made = &table;
    return kSuccess;
}
