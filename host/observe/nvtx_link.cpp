// SPDX-License-Identifier: Apache-2.0
#include "host/observe/nvtx_link.h"

#include "host/observe/nvtx_call.h"
#include "host/observe/nvtx_slots.h"

#include <nvtx3/nvToolsExtSemanticsCounters.h>
#include <nvtx3/nvToolsExtSemanticsTime.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <deque>
#include <vector>

namespace urgengo::observe {
namespace {

using nvtx::Category;
using nvtx::Kind;
using nvtx::Schema;

nvtxDomainHandle_t as_domain(void* domain) {
    return static_cast<nvtxDomainHandle_t>(domain);
}

bool is_text(Kind kind) {
    return kind == Kind::kText || kind == Kind::kMessage;
}

const char* text_of(const NvtxLink::Text* text) {
    return text ? text->text.c_str() : "-";
}

// "hold: chain lidar, task detect, held_ns 1200"
void write_plain(std::span<char> to, const NvtxLink::Text* name, Schema schema,
                 NvtxLink::Values values) {
    std::size_t length = 0;
    const auto put = [&](auto... what) {
        const int written = std::snprintf(to.data() + length, to.size() - length, what...);
        if (written > 0)
            length = std::min(to.size() - 1, length + static_cast<std::size_t>(written));
    };
    put("%s", text_of(name));
    const auto entries = nvtx::kSchemas[static_cast<std::size_t>(schema)].entries;
    for (std::size_t i = 0; i < values.size(); ++i) {
        put(i == 0 ? ": %s " : ", %s ", entries[i].name);
        if (is_text(entries[i].kind))
            put("%s", text_of(values[i].text));
        else
            put("%lld", static_cast<long long>(values[i].number));
    }
}

// As the schema says.
std::size_t encode(std::array<std::uint64_t, nvtx::kMostEntries>& to, NvtxLink::Values values) {
    for (std::size_t i = 0; i < values.size(); ++i)
        to[i] =
            values[i].text ? values[i].text->handle : static_cast<std::uint64_t>(values[i].number);
    return values.size() * sizeof to[0];
}

}  // namespace

namespace {

std::atomic<const NvtxLink*> g_of_process{nullptr};

/// The tool may write there as long as it lives: they are never destroyed, and can be reached, so
/// that none is taken for a leak.
NvtxSlots& new_slots() {
    static auto* const all = new std::deque<NvtxSlots>;
    return all->emplace_back();
}

}  // namespace

const NvtxLink* NvtxLink::of_process() {
    return g_of_process.load(std::memory_order_acquire);
}

NvtxLink::~NvtxLink() {
    const NvtxLink* me = this;
    g_of_process.compare_exchange_strong(me, nullptr);
}

std::unique_ptr<NvtxLink> NvtxLink::attach(const NvtxInjection& tool) {
    if (!tool.initialize) return nullptr;
    std::unique_ptr<NvtxLink> link(new NvtxLink);
    link->slots_ = &new_slots();
    if (!link->slots_->fill(tool)) return nullptr;
    link->register_all();
    g_of_process.store(link.get(), std::memory_order_release);
    return link;
}

void NvtxLink::register_all() {
    if (const auto create =
            slots_->core2_function<nvtxDomainCreateA_impl_fntype>(NVTX_CBID_CORE2_DomainCreateA))
        domain_ = create(nvtx::kDomain);
    if (const auto name = slots_->core2_function<nvtxDomainNameCategoryA_impl_fntype>(
            NVTX_CBID_CORE2_DomainNameCategoryA))
        for (std::uint32_t i = 0; i < nvtx::kCategories.size(); ++i)
            name(as_domain(domain_), i + 1, nvtx::kCategories[i]);
    for (std::size_t i = 0; i < nvtx::kNumWords; ++i) words_[i] = add_text(nvtx::kWords[i]);
    keeps_strings_ = words_[0]->handle != 0;
    if (!keeps_strings_) return;
    register_time();
    for (std::size_t i = 0; i < nvtx::kNumSchemas; ++i) register_schema(static_cast<Schema>(i));
}

// Marks carry 48 bits of %globaltimer, so times are not that clock's: the type is none, and sync
// points tell what they are.
void NvtxLink::register_time() {
    const auto scope = NvtxSlots::function<decltype(nvtxScopeRegister)>(
        slots_->payload, NVTX3EXT_CBID_nvtxScopeRegister);
    const auto time = NvtxSlots::function<decltype(nvtxTimeDomainRegister)>(
        slots_->payload, NVTX3EXT_CBID_nvtxTimeDomainRegister);
    const auto submit = NvtxSlots::function<decltype(nvtxEventSubmit)>(
        slots_->payload, NVTX3EXT_CBID_nvtxEventSubmit);
    const auto sync = NvtxSlots::function<decltype(nvtxTimeSyncPointTable)>(
        slots_->payload, NVTX3EXT_CBID_nvtxTimeSyncPointTable);
    if (!time || !submit || !sync) return;
    nvtxScopeAttr_t scope_of{};
    scope_of.structSize = sizeof scope_of;
    scope_of.path = nvtx::kTimeScope;
    scope_of.parentScope = NVTX_SCOPE_CURRENT_SW_PROCESS;
    nvtxTimeDomainAttr_t attributes{};
    attributes.scopeId = scope ? scope(as_domain(domain_), &scope_of) : NVTX_SCOPE_NONE;
    attributes.timestampTypeId = NVTX_TIMESTAMP_TYPE_NONE;
    attributes.timerFlags = NVTX_TIMER_FLAG_CLOCK_MONOTONIC;
    attributes.timerResolution = 1'000'000'000;
    attributes.timerStart = NVTX_TIMER_START_UNKNOWN;
    gpu_time_ = time(as_domain(domain_), &attributes);
}

void NvtxLink::register_schema(Schema schema) {
    const auto add = NvtxSlots::function<decltype(nvtxPayloadSchemaRegister)>(
        slots_->payload, NVTX3EXT_CBID_nvtxPayloadSchemaRegister);
    if (!add || (schema == Schema::kGpu && !takes_deferred())) return;
    const nvtx::SchemaInfo& info = nvtx::kSchemas[static_cast<std::size_t>(schema)];
    // What a tool may look at later stays.
    auto* const time =
        new nvtxSemanticsTime_t{{sizeof(nvtxSemanticsTime_t), NVTX_SEMANTIC_ID_TIME_V1,
                                 NVTX_TIME_SEMANTIC_VERSION, nullptr},
                                gpu_time_};
    auto* const entries = new nvtxPayloadSchemaEntry_t[info.entries.size()]{};
    for (std::size_t i = 0; i < info.entries.size(); ++i) {
        const nvtx::Entry& entry = info.entries[i];
        entries[i].type = is_text(entry.kind)
                              ? NVTX_PAYLOAD_ENTRY_TYPE_NVTX_REGISTERED_STRING_HANDLE
                              : NVTX_PAYLOAD_ENTRY_TYPE_INT64;
        entries[i].name = entry.name;
        entries[i].offset = i * sizeof(std::uint64_t);
        if (entry.kind == Kind::kMessage) entries[i].flags = NVTX_PAYLOAD_ENTRY_FLAG_EVENT_MESSAGE;
        if (entry.kind != Kind::kBegin && entry.kind != Kind::kEnd) continue;
        entries[i].flags = NVTX_PAYLOAD_ENTRY_FLAG_TIMESTAMP |
                           (entry.kind == Kind::kBegin ? NVTX_PAYLOAD_ENTRY_FLAG_RANGE_BEGIN
                                                       : NVTX_PAYLOAD_ENTRY_FLAG_RANGE_END);
        entries[i].semantics = &time->header;
    }
    nvtxPayloadSchemaAttr_t attributes{};
    attributes.fieldMask =
        NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_NAME | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_TYPE |
        NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_FLAGS | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_ENTRIES |
        NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_NUM_ENTRIES | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_STATIC_SIZE;
    attributes.name = info.name;
    attributes.type = NVTX_PAYLOAD_SCHEMA_TYPE_STATIC;
    attributes.flags = schema == Schema::kGpu ? NVTX_PAYLOAD_SCHEMA_FLAG_RANGE_STARTEND
                                              : NVTX_PAYLOAD_SCHEMA_FLAG_NONE;
    attributes.entries = entries;
    attributes.numEntries = info.entries.size();
    attributes.payloadStaticSize = info.entries.size() * sizeof(std::uint64_t);
    schemas_[static_cast<std::size_t>(schema)] = add(as_domain(domain_), &attributes);
}

const NvtxLink::Text* NvtxLink::add_text(std::string_view text) {
    Text& added = texts_.emplace_back(Text{std::string(text)});
    if (const auto add = slots_->core2_function<nvtxDomainRegisterStringA_impl_fntype>(
            NVTX_CBID_CORE2_DomainRegisterStringA))
        added.handle = reinterpret_cast<std::uint64_t>(add(as_domain(domain_), added.text.c_str()));
    return &added;
}

std::uint64_t NvtxLink::add_counter(const std::string& name, const nvtx::CounterInfo& info) {
    const auto add = NvtxSlots::function<decltype(nvtxCounterRegister)>(
        slots_->counters, NVTX3EXT_CBID_nvtxCounterRegister);
    if (!add || !NvtxSlots::function<decltype(nvtxCounterSampleInt64)>(
                    slots_->counters, NVTX3EXT_CBID_nvtxCounterSampleInt64))
        return 0;
    auto* const unit = new nvtxSemanticsCounter_t{};
    unit->header = {sizeof *unit, NVTX_SEMANTIC_ID_COUNTERS_V1, NVTX_COUNTER_SEMANTIC_VERSION,
                    nullptr};
    unit->flags = NVTX_COUNTER_FLAG_VALUETYPE_ABSOLUTE | NVTX_COUNTER_FLAG_INTERPOLATION_UNTIL_NEXT;
    unit->unit = info.unit;
    unit->unitScaleNumerator = unit->unitScaleDenominator = 1;
    nvtxCounterAttr_t attributes{};
    attributes.structSize = sizeof attributes;
    attributes.schemaId = NVTX_PAYLOAD_ENTRY_TYPE_INT64;
    attributes.name = name.c_str();
    attributes.description = info.description;
    attributes.scopeId = NVTX_SCOPE_CURRENT_SW_PROCESS;
    attributes.semantics = &unit->header;
    attributes.counterId = NVTX_COUNTER_ID_NONE;
    return add(as_domain(domain_), &attributes);
}

// Calls use(attributes) with an event that has the values as its payload, or in its message.
template <typename Use>
auto NvtxLink::with_event(Category category, const Text* name, Schema schema, Values values,
                          Use&& use) const {
    nvtxEventAttributes_t event{};
    event.version = NVTX_VERSION;
    event.size = NVTX_EVENT_ATTRIB_STRUCT_SIZE;
    event.category = static_cast<std::uint32_t>(category);
    if (id_of(schema) != 0) {
        std::array<std::uint64_t, nvtx::kMostEntries> encoded;
        const nvtxPayloadData_t data{id_of(schema), encode(encoded, values), encoded.data()};
        event.messageType = NVTX_MESSAGE_TYPE_REGISTERED;
        event.message.registered = reinterpret_cast<nvtxStringHandle_t>(name->handle);
        event.payloadType = NVTX_PAYLOAD_TYPE_EXT;
        event.reserved0 = 1;
        event.payload.ullValue = NVTX_POINTER_AS_PAYLOAD_ULLVALUE(&data);
        return use(&event);
    }
    char message[512];
    write_plain(message, name, schema, values);
    event.messageType = NVTX_MESSAGE_TYPE_ASCII;
    event.message.ascii = message;
    return use(&event);
}

std::uint64_t NvtxLink::start(Category category, const Text* name, Schema schema,
                              Values values) const {
    const NvtxCall call;
    const auto start = slots_->core2_function<nvtxDomainRangeStartEx_impl_fntype>(
        NVTX_CBID_CORE2_DomainRangeStartEx);
    if (!start) return 0;
    return with_event(category, name, schema, values, [&](const nvtxEventAttributes_t* event) {
        return start(as_domain(domain_), event);
    });
}

void NvtxLink::end(std::uint64_t range, Schema schema, Values values) const {
    if (range == 0) return;
    const NvtxCall call;
    const auto end_with = NvtxSlots::function<decltype(nvtxRangeEndPayload)>(
        slots_->payload, NVTX3EXT_CBID_nvtxRangeEndPayload);
    if (end_with && id_of(schema) != 0) {
        std::array<std::uint64_t, nvtx::kMostEntries> encoded;
        const nvtxPayloadData_t data{id_of(schema), encode(encoded, values), encoded.data()};
        end_with(as_domain(domain_), range, &data, 1);
    } else if (const auto end = slots_->core2_function<nvtxDomainRangeEnd_impl_fntype>(
                   NVTX_CBID_CORE2_DomainRangeEnd)) {
        end(as_domain(domain_), range);
    }
}

void NvtxLink::mark(Category category, const Text* name, Schema schema, Values values) const {
    const NvtxCall call;
    const auto mark =
        slots_->core2_function<nvtxDomainMarkEx_impl_fntype>(NVTX_CBID_CORE2_DomainMarkEx);
    if (!mark) return;
    with_event(category, name, schema, values,
               [&](const nvtxEventAttributes_t* event) { mark(as_domain(domain_), event); });
}

void NvtxLink::event(Values gpu) const {
    const NvtxCall call;
    const auto submit = NvtxSlots::function<decltype(nvtxEventSubmit)>(
        slots_->payload, NVTX3EXT_CBID_nvtxEventSubmit);
    if (!submit || id_of(Schema::kGpu) == 0) return;
    std::array<std::uint64_t, nvtx::kMostEntries> encoded;
    const nvtxPayloadData_t data{id_of(Schema::kGpu), encode(encoded, gpu), encoded.data()};
    submit(as_domain(domain_), &data, 1);
}

void NvtxLink::sync(std::span<const SyncPoint> points) const {
    const NvtxCall call;
    const auto sync = NvtxSlots::function<decltype(nvtxTimeSyncPointTable)>(
        slots_->payload, NVTX3EXT_CBID_nvtxTimeSyncPointTable);
    if (!sync || !takes_deferred()) return;
    std::vector<nvtxSyncPoint_t> table;
    for (const SyncPoint& point : points) table.push_back({point.gpu, point.host});
    sync(as_domain(domain_), gpu_time_, NVTX_TIMESTAMP_TYPE_CPU_CLOCK_GETTIME_MONOTONIC,
         table.data(), table.size());
}

void NvtxLink::sample(std::uint64_t counter, const Text* name, std::int64_t value) const {
    const NvtxCall call;
    if (counter != 0) {
        if (const auto sample = NvtxSlots::function<decltype(nvtxCounterSampleInt64)>(
                slots_->counters, NVTX3EXT_CBID_nvtxCounterSampleInt64))
            sample(as_domain(domain_), counter, value);
        return;
    }
    const auto mark =
        slots_->core2_function<nvtxDomainMarkEx_impl_fntype>(NVTX_CBID_CORE2_DomainMarkEx);
    if (!mark) return;
    nvtxEventAttributes_t event{};
    event.version = NVTX_VERSION;
    event.size = NVTX_EVENT_ATTRIB_STRUCT_SIZE;
    event.category = static_cast<std::uint32_t>(Category::kChain);
    event.messageType = NVTX_MESSAGE_TYPE_ASCII;
    event.message.ascii = text_of(name);
    event.payloadType = NVTX_PAYLOAD_TYPE_INT64;
    event.payload.llValue = value;
    mark(as_domain(domain_), &event);
}

void NvtxLink::name_thread(std::uint32_t id, const char* name) const {
    const NvtxCall call;
    if (const auto its =
            slots_->core_function<nvtxNameOsThreadA_impl_fntype>(NVTX_CBID_CORE_NameOsThreadA))
        its(id, name);
}

void NvtxLink::name_stream(void* stream, const char* name) const {
    const NvtxCall call;
    if (const auto its = reinterpret_cast<nvtxNameCuStreamA_fakeimpl_fntype>(
            slots_->cuda.functions[NVTX_CBID_CUDA_NameCuStreamA]))
        its(stream, name);
}

}  // namespace urgengo::observe
