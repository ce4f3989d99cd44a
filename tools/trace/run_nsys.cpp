// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_nsys.h"

#include "tools/trace/nvtxw.h"

#include <fmt/format.h>
#include <nvtx3/nvToolsExtSemanticsCounters.h>

#include <algorithm>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "host/observe/miss_cause.h"
#include "host/observe/mode_word.h"
#include "tools/trace/run_pieces.h"

namespace urgengo::trace {
namespace {

using nvtxw::Kind;
using nvtxw::Schema;
using observe::nvtx::Category;
using observe::nvtx::Counter;
using observe::nvtx::Word;

/// Of one stream, by its time.
struct Written {
    std::int64_t time_ns = 0;
    std::function<void()> write;
};

class NsysWriter {
  public:
    NsysWriter(const Run& run, const RunStory& story, const nvtxw::Interface& backend)
        : run_(run), story_(story), backend_(backend), of_stream_(run.chains.size() + 1) {}

    Result<std::size_t> write(const std::string& name) {
        check_functions();
        nvtxw::SessionAttributes session;
        session.name = name.c_str();
        call("SessionBegin", backend_.session_begin, &session, &session_);
        nvtxw::DomainAttributes domain;
        domain.name = observe::nvtx::kDomain;
        call("DomainRegister", backend_.domain_register, session_, &domain, &domain_);
        register_all();
        for (const RunFrame& frame : story_.frames) add_frame(frame);
        for (const RunSlice& slice : story_.slices) add_slice(slice);
        for (const RunPiece& piece : gpu_pieces(run_, story_)) add_piece(piece);
        for (const RunRecord& point : story_.points) add_point(point);
        for (std::size_t i = 0; i < of_stream_.size() && wrong_.empty(); ++i) write_stream(i);
        call("SessionEnd", backend_.session_end, session_);
        if (!wrong_.empty()) return Error{wrong_};
        return num_events_;
    }

  private:
    /// After the first refusal nothing more is called.
    template <typename Function, typename... Args>
    void call(const char* name, Function function, Args... args) {
        if (!wrong_.empty()) return;
        const nvtxw::Code code = function(args...);
        if (code == nvtxw::kSuccess) return;
        wrong_ = fmt::format("the backend of NVTXW refuses {}: {}", name, nvtxw::code_words(code));
    }

    void check_functions() {
        const nvtxw::Interface& b = backend_;
        if (!b.session_begin || !b.session_end || !b.domain_register || !b.string_register ||
            !b.schema_register || !b.stream_open || !b.stream_close || !b.event_write)
            wrong_ =
                "the backend of NVTXW lacks functions, accepted: sessions, domains, strings, "
                "schemas, streams and events";
    }

    void register_all() {
        for (std::uint32_t i = 0;
             backend_.category_register && i < observe::nvtx::kCategories.size(); ++i)
            call("CategoryRegister", backend_.category_register, domain_, i + 1,
                 observe::nvtx::kCategories[i]);
        for (std::size_t i = 0; i < nvtxw::kSchemas.size(); ++i) register_schema(i);
        has_counters_ = backend_.counter_register && backend_.counter_write;
        counters_.resize(run_.chains.size());
        for (std::size_t c = 0; has_counters_ && c < run_.chains.size(); ++c)
            for (std::size_t i = 0; i < observe::nvtx::kNumCounters; ++i) register_counter(c, i);
    }

    void register_schema(std::size_t index) {
        const nvtxw::SchemaInfo& info = nvtxw::kSchemas[index];
        std::vector<nvtxPayloadSchemaEntry_t> entries(info.entries.size());
        for (std::size_t i = 0; i < entries.size(); ++i) {
            nvtxPayloadSchemaEntry_t& entry = entries[i];
            entry.name = info.entries[i].name;
            entry.offset = i * sizeof(std::uint64_t);
            entry.type = NVTX_PAYLOAD_ENTRY_TYPE_INT64;
            switch (info.entries[i].kind) {
                case Kind::kBegin:
                    entry.flags =
                        NVTX_PAYLOAD_ENTRY_FLAG_TIMESTAMP | NVTX_PAYLOAD_ENTRY_FLAG_RANGE_BEGIN;
                    break;
                case Kind::kEnd:
                    entry.flags =
                        NVTX_PAYLOAD_ENTRY_FLAG_TIMESTAMP | NVTX_PAYLOAD_ENTRY_FLAG_RANGE_END;
                    break;
                case Kind::kAt:
                    entry.flags = NVTX_PAYLOAD_ENTRY_FLAG_TIMESTAMP | NVTX_PAYLOAD_ENTRY_FLAG_MARK;
                    break;
                case Kind::kMessage:
                    entry.flags = NVTX_PAYLOAD_ENTRY_FLAG_EVENT_MESSAGE;
                    [[fallthrough]];
                case Kind::kText:
                    entry.type = NVTX_PAYLOAD_ENTRY_TYPE_NVTX_REGISTERED_STRING_HANDLE;
                    break;
                case Kind::kCategory:
                    entry.type = NVTX_PAYLOAD_ENTRY_TYPE_CATEGORY;
                    break;
                case Kind::kNumber:
                    break;
            }
        }
        nvtxPayloadSchemaAttr_t attributes{};
        attributes.fieldMask =
            NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_NAME | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_TYPE |
            NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_FLAGS | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_ENTRIES |
            NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_NUM_ENTRIES | NVTX_PAYLOAD_SCHEMA_ATTR_FIELD_STATIC_SIZE;
        attributes.name = info.name;
        attributes.type = NVTX_PAYLOAD_SCHEMA_TYPE_STATIC;
        attributes.flags = info.entries[0].kind == Kind::kAt
                               ? NVTX_PAYLOAD_SCHEMA_FLAG_MARK
                               : NVTX_PAYLOAD_SCHEMA_FLAG_RANGE_STARTEND;
        attributes.entries = entries.data();
        attributes.numEntries = entries.size();
        attributes.payloadStaticSize = entries.size() * sizeof(std::uint64_t);
        call("SchemaRegister", backend_.schema_register, domain_, &attributes, &schemas_[index]);
    }

    void register_counter(std::size_t chain, std::size_t index) {
        const observe::nvtx::CounterInfo& info = observe::nvtx::kCounters[index];
        nvtxSemanticsCounter_t unit{};
        unit.header = {sizeof unit, NVTX_SEMANTIC_ID_COUNTERS_V1, NVTX_COUNTER_SEMANTIC_VERSION,
                       nullptr};
        unit.flags =
            NVTX_COUNTER_FLAG_VALUETYPE_ABSOLUTE | NVTX_COUNTER_FLAG_INTERPOLATION_UNTIL_NEXT;
        unit.unit = info.unit;
        unit.unitScaleNumerator = unit.unitScaleDenominator = 1;
        const std::string name = run_.chains[chain].name + " " + info.name;
        nvtxCounterAttr_t attributes{};
        attributes.structSize = sizeof attributes;
        attributes.schemaId = NVTX_PAYLOAD_ENTRY_TYPE_INT64;
        attributes.name = name.c_str();
        attributes.description = info.description;
        attributes.scopeId = NVTX_SCOPE_NONE;
        attributes.semantics = &unit.header;
        attributes.counterId = NVTX_COUNTER_ID_NONE;
        call("CounterRegister", backend_.counter_register, domain_, &attributes,
             &counters_[chain][index]);
    }

    /// Each text is registered once.
    std::int64_t text(const std::string& words) {
        if (words.empty()) return 0;
        const auto [found, is_new] = texts_.try_emplace(words, nullptr);
        if (is_new)
            call("StringRegister", backend_.string_register, domain_, words.c_str(),
                 &found->second);
        return reinterpret_cast<std::int64_t>(found->second);
    }
    std::int64_t text(Word word) {
        return text(std::string(observe::nvtx::kWords[static_cast<std::size_t>(word)]));
    }
    std::int64_t chain_text(int chain) { return text(chain_name(run_, chain)); }

    void add(std::size_t stream, Schema schema, std::int64_t time_ns,
             std::vector<std::int64_t> values) {
        of_stream_[stream].push_back(
            {time_ns, [this, stream, schema, values = std::move(values)] {
                 const nvtxPayloadData_t payload{schemas_[static_cast<std::size_t>(schema)],
                                                 values.size() * sizeof values[0], values.data()};
                 call("EventWrite", backend_.event_write, stream_, &payload, std::size_t{1});
                 ++num_events_;
             }});
    }
    void sample(std::size_t chain, Counter counter, std::int64_t time_ns, std::int64_t value) {
        if (!has_counters_) return;
        of_stream_[chain].push_back({time_ns, [this, chain, counter, time_ns, value] {
                                         call("CounterWrite", backend_.counter_write, stream_,
                                              time_ns,
                                              counters_[chain][static_cast<std::size_t>(counter)],
                                              static_cast<const void*>(&value), sizeof value);
                                     }});
    }

    static std::int64_t id(Category category) { return static_cast<std::int64_t>(category); }
    std::int64_t number_of(std::size_t frame) const {
        return frame == kNoFrame ? 0 : story_.frames[frame].number;
    }

    void add_frame(const RunFrame& frame) {
        const int chain = static_cast<int>(frame.chain);
        const bool is_late = frame.has_ended && frame.is_late();
        const Word outcome = !frame.has_ended ? Word::kUnderWay
                             : frame.exited   ? Word::kExited
                             : is_late        ? Word::kLate
                                              : Word::kInTime;
        const std::int64_t reason = is_late ? text(observe::to_word(frame.cause)) : 0;
        const std::int64_t behind = is_late ? chain_text(frame.behind) : 0;
        add(frame.chain, Schema::kFrame, frame.arrival_ns,
            {frame.arrival_ns, std::max(frame.arrival_ns, frame.end_ns), chain_text(chain),
             id(Category::kChain), chain_text(chain), frame.number,
             frame.arrival_ns + run_.chains[frame.chain].deadline_ns, text(outcome), reason,
             behind});
        if (is_late)
            add(frame.chain, Schema::kMiss, frame.end_ns,
                {frame.end_ns, text(frame.exited ? Word::kEarlyExit : Word::kMiss),
                 id(Category::kChain), chain_text(chain), frame.number, reason, behind});
    }

    void add_slice(const RunSlice& slice) {
        const std::int64_t chain = chain_text(static_cast<int>(slice.chain));
        const std::int64_t task = text(run_.tasks[slice.task].name);
        const std::int64_t frame = number_of(slice.frame);
        if (slice.kind == RunSlice::Kind::kTask) {
            add(slice.chain, Schema::kTask, slice.begin_ns,
                {slice.begin_ns, slice.end_ns, task, id(Category::kLaunch), chain, task, frame});
        } else if (slice.kind == RunSlice::Kind::kHold) {
            // The words of reasons are in the order of abi::Why.
            const auto why = static_cast<std::size_t>(slice.why);
            const auto first = static_cast<std::size_t>(Word::kRank);
            add(slice.chain, Schema::kHold, slice.begin_ns,
                {slice.begin_ns, slice.end_ns, text(slice.is_paced() ? Word::kPaced : Word::kHold),
                 id(Category::kHold), chain, task, frame, chain_text(slice.behind_chain),
                 why == 0 ? 0 : text(static_cast<Word>(first + why - 1))});
            if (!slice.is_paced()) add_held(slice);
        }
    }

    void add_held(const RunSlice& slice) {
        Held& held = held_[slice.task];
        if (held.frame != slice.frame) held = {slice.frame, 0};
        held.ns += slice.length_ns();
        sample(slice.chain, Counter::kHeld, slice.end_ns, held.ns);
    }

    void add_piece(const RunPiece& piece) {
        const std::size_t chain = run_.tasks[piece.task].chain;
        const std::int64_t task = text(run_.tasks[piece.task].name);
        add(chain, Schema::kLaunches, piece.begin_ns,
            {piece.begin_ns, piece.end_ns, task, id(Category::kLaunch),
             chain_text(static_cast<int>(chain)), task, number_of(piece.frame), piece.stream,
             piece.first_launch, piece.end_launch});
    }

    void add_point(const RunRecord& point) {
        const auto chain = static_cast<std::size_t>(std::max<int>(point.chain, 0));
        const std::size_t none = run_.chains.size();
        switch (point.kind) {
            case RunKind::kMark:
                sample(chain, Counter::kExecuting,
                       point.begin_ns != 0 ? point.begin_ns : point.time_ns, point.mark.position);
                sample(chain, Counter::kLaxity, point.time_ns, point.mark.laxity_ns);
                break;
            case RunKind::kPriority:
                sample(chain, Counter::kPriority, point.time_ns, point.priority.now);
                break;
            case RunKind::kFrameDropped:
                add(chain, Schema::kMiss, point.time_ns,
                    {point.time_ns, text(Word::kDropped), id(Category::kChain),
                     chain_text(point.chain), 0, text(observe::to_word(abi::MissCause::kDropped)),
                     0});
                break;
            case RunKind::kMode:
                add(none, Schema::kMode, point.time_ns,
                    {point.time_ns, text(Word::kMode), id(Category::kDispatch),
                     text(observe::to_word(point.mode))});
                break;
            case RunKind::kTrip:
                add(none, Schema::kMode, point.time_ns,
                    {point.time_ns, text(Word::kTrip), id(Category::kDispatch), text(Word::kOff)});
                break;
            default:
                break;
        }
    }

    void write_stream(std::size_t index) {
        std::vector<Written>& events = of_stream_[index];
        std::stable_sort(events.begin(), events.end(),
                         [](const Written& a, const Written& b) { return a.time_ns < b.time_ns; });
        const bool is_of_chain = index < run_.chains.size();
        // Names of two chains may be the same, as the file is not to be believed.
        const std::string name = is_of_chain
                                     ? fmt::format("{} {}", index + 1, run_.chains[index].name)
                                     : std::string(observe::nvtx::kDomain);
        nvtxw::StreamAttributes attributes;
        attributes.name = name.c_str();
        attributes.domain = domain_;
        attributes.time_domain = NVTX_TIMESTAMP_TYPE_CPU_CLOCK_GETTIME_MONOTONIC;
        attributes.order = nvtxw::Order::kByBegin;
        call("StreamOpen", backend_.stream_open, session_, &attributes, &stream_);
        if (!is_of_chain && backend_.time_sync_point_write && run_.begin_realtime_ns > 0)
            call("TimeSyncPointWrite", backend_.time_sync_point_write, stream_,
                 std::uint64_t{NVTX_TIMESTAMP_TYPE_CPU_CLOCK_GETTIME_MONOTONIC},
                 std::uint64_t{NVTX_TIMESTAMP_TYPE_CPU_CLOCK_GETTIME_REALTIME}, run_.begin_ns,
                 run_.begin_realtime_ns);
        for (const Written& event : events) event.write();
        call("StreamClose", backend_.stream_close, stream_);
    }

    struct Held {
        std::size_t frame = kNoFrame;
        std::int64_t ns = 0;
    };

    const Run& run_;
    const RunStory& story_;
    const nvtxw::Interface& backend_;
    nvtxw::Session session_ = nullptr;
    nvtxw::Stream stream_ = nullptr;
    nvtxDomainHandle_t domain_ = nullptr;
    std::array<std::uint64_t, nvtxw::kSchemas.size()> schemas_{};
    std::vector<std::array<std::uint64_t, observe::nvtx::kNumCounters>> counters_;
    bool has_counters_ = false;
    std::map<std::string, nvtxStringHandle_t> texts_;
    std::map<std::size_t, Held> held_;             ///< by task
    std::vector<std::vector<Written>> of_stream_;  ///< by chain, and of none
    std::size_t num_events_ = 0;
    std::string wrong_;
};

}  // namespace

Result<std::size_t> write_nsys(const Run& run, const RunStory& story,
                               const nvtxw::Interface& backend, const std::string& name) {
    return NsysWriter(run, story, backend).write(name);
}

}  // namespace urgengo::trace
