// SPDX-License-Identifier: Apache-2.0
//
// Field numbers are those of protos/perfetto/trace/{trace,trace_packet}.proto and of
// track_event/{track_event,track_descriptor,debug_annotation}.proto, which never change.
#include <algorithm>
#include <protozero/pbf_writer.hpp>

#include "host/model/gpu_clock.h"
#include "tools/trace/run_export.h"
#include "tools/trace/run_timeline.h"

namespace urgengo::trace {
namespace {

namespace packet {
constexpr protozero::pbf_tag_type kOfTrace = 1, kClockSnapshot = 6, kTimestamp = 8, kSequence = 10,
                                  kTrackEvent = 11, kSequenceFlags = 13, kClock = 58,
                                  kTrackDescriptor = 60;
}
namespace descriptor {
constexpr protozero::pbf_tag_type kUuid = 1, kName = 2, kProcess = 3, kParent = 5, kCounter = 8,
                                  kOrdering = 11, kRank = 12;
constexpr protozero::pbf_tag_type kProcessId = 1, kProcessName = 6;
constexpr protozero::pbf_tag_type kUnit = 3, kUnitName = 6;
constexpr std::int32_t kCount = 2;
constexpr std::int32_t kExplicit = 3;  ///< children in the order of their ranks
}  // namespace descriptor
namespace event {
constexpr protozero::pbf_tag_type kArgument = 4, kType = 9, kTrack = 11, kCategory = 22, kName = 23,
                                  kDouble = 44, kFlow = 47, kLastFlow = 48;
enum Type : std::int32_t { kBegin = 1, kEnd = 2, kInstant = 3, kCounter = 4 };
}  // namespace event
namespace argument {
constexpr protozero::pbf_tag_type kInt = 4, kDouble = 5, kString = 6, kName = 10;
}

constexpr std::uint32_t kMonotonic = 3, kRealtime = 1;  // BuiltinClock
constexpr std::uint32_t kGpuClock = 64;  ///< the first that a sequence may call its own
constexpr std::uint32_t kOurSequence = 1;
constexpr std::uint64_t kProcessTrack = 1;

std::uint64_t uuid_of(std::size_t track) {
    return kProcessTrack + 1 + track;
}

/// What is at a time on a track.
struct Moment {
    std::int64_t time_ns;
    event::Type type;
    std::size_t track;
    const TrackSlice* slice = nullptr;
    const TrackInstant* instant = nullptr;
    double value = 0;
};

class PerfettoWriter {
  public:
    std::string write(const Run& run, const RunStory& story, const std::vector<Track>& tracks) {
        clocks(run);
        gpu_clocks(story);
        process(run);
        for (std::size_t i = 0; i < tracks.size(); ++i) describe(tracks[i], i);
        for (const Moment& moment : in_order(tracks)) tell(moment);
        return std::move(trace_);
    }

  private:
    template <typename Fill>
    void add(Fill&& fill) {
        std::string bytes;
        protozero::pbf_writer writer(bytes);
        fill(writer);
        writer.add_uint32(packet::kSequence, kOurSequence);
        if (is_first_) writer.add_uint32(packet::kSequenceFlags, 1);  // state begins here
        is_first_ = false;
        protozero::pbf_writer(trace_).add_message(packet::kOfTrace, bytes);
    }

    void snapshot(std::int64_t monotonic_ns, std::uint32_t other, std::int64_t other_ns) {
        add([&](protozero::pbf_writer& writer) {
            protozero::pbf_writer snapshot(writer, packet::kClockSnapshot);
            const auto clock = [&](std::uint32_t id, std::int64_t ns) {
                protozero::pbf_writer one(snapshot, 1);
                one.add_uint32(1, id);
                one.add_uint64(2, static_cast<std::uint64_t>(ns));
            };
            clock(kMonotonic, monotonic_ns);
            clock(other, other_ns);
            snapshot.add_uint32(2, kMonotonic);  // the trace's clock
        });
    }
    void clocks(const Run& run) { snapshot(run.begin_ns, kRealtime, run.begin_realtime_ns); }

    /// What records have of the GPU's clock wraps every 78 hours. A clock that went back began
    /// anew, or was told by another thread a little late: a decoder would not take that.
    void gpu_clocks(const RunStory& story) {
        std::int64_t gpu_ns = 0, host_ns = 0;
        std::uint64_t stamp = 0;
        bool is_known = false;
        for (const RunRecord& point : story.points) {
            if (point.kind != RunKind::kClock) continue;
            const std::int64_t later = is_known ? model::stamp_difference(point.clock.gpu_ns, stamp)
                                                : static_cast<std::int64_t>(point.clock.gpu_ns);
            if (is_known && (later <= 0 || point.clock.host_ns <= host_ns)) continue;
            if (point.clock.host_ns <= 0) continue;
            is_known = true;
            stamp = point.clock.gpu_ns;
            host_ns = point.clock.host_ns;
            gpu_ns += later;
            snapshot(host_ns, kGpuClock, gpu_ns);
        }
    }

    void process(const Run& run) {
        add([&](protozero::pbf_writer& writer) {
            protozero::pbf_writer track(writer, packet::kTrackDescriptor);
            track.add_uint64(descriptor::kUuid, kProcessTrack);
            {
                protozero::pbf_writer process(track, descriptor::kProcess);
                process.add_int32(descriptor::kProcessId, static_cast<std::int32_t>(run.process));
                process.add_string(descriptor::kProcessName, run.program);
            }
            track.add_enum(descriptor::kOrdering, descriptor::kExplicit);
        });
    }

    void describe(const Track& from, std::size_t index) {
        add([&](protozero::pbf_writer& writer) {
            protozero::pbf_writer track(writer, packet::kTrackDescriptor);
            track.add_uint64(descriptor::kUuid, uuid_of(index));
            track.add_uint64(
                descriptor::kParent,
                from.parent < 0 ? kProcessTrack : uuid_of(static_cast<std::size_t>(from.parent)));
            track.add_string(descriptor::kName, from.name);
            track.add_enum(descriptor::kOrdering, descriptor::kExplicit);
            track.add_int32(descriptor::kRank, static_cast<std::int32_t>(index));
            if (from.kind == Track::Kind::kCounter) {
                protozero::pbf_writer counter(track, descriptor::kCounter);
                // Without a field there would be no message, and the track no counter.
                counter.add_enum(descriptor::kUnit, descriptor::kCount);
                if (!from.unit.empty()) counter.add_string(descriptor::kUnitName, from.unit);
            }
        });
    }

    /// On one track an end comes before a begin at the same time.
    static std::vector<Moment> in_order(const std::vector<Track>& tracks) {
        std::vector<Moment> all;
        for (std::size_t i = 0; i < tracks.size(); ++i) {
            for (const TrackSlice& slice : tracks[i].slices) {
                all.push_back({slice.begin_ns, event::kBegin, i, &slice});
                all.push_back({slice.end_ns, event::kEnd, i});
            }
            for (const TrackInstant& instant : tracks[i].instants)
                all.push_back({instant.time_ns, event::kInstant, i, nullptr, &instant});
            for (const TrackValue& value : tracks[i].values)
                all.push_back({value.time_ns, event::kCounter, i, nullptr, nullptr, value.value});
        }
        const auto rank = [](const Moment& m) { return m.type == event::kEnd ? 0 : 1; };
        std::stable_sort(all.begin(), all.end(), [&](const Moment& a, const Moment& b) {
            return a.time_ns != b.time_ns ? a.time_ns < b.time_ns : rank(a) < rank(b);
        });
        return all;
    }

    void tell(const Moment& moment) {
        add([&](protozero::pbf_writer& writer) {
            writer.add_uint64(packet::kTimestamp, static_cast<std::uint64_t>(moment.time_ns));
            writer.add_uint32(packet::kClock, kMonotonic);
            protozero::pbf_writer told(writer, packet::kTrackEvent);
            told.add_enum(event::kType, moment.type);
            told.add_uint64(event::kTrack, uuid_of(moment.track));
            if (moment.instant) told.add_string(event::kName, moment.instant->name);
            if (moment.type == event::kCounter) told.add_double(event::kDouble, moment.value);
            if (!moment.slice) return;
            told.add_string(event::kName, moment.slice->name);
            told.add_string(event::kCategory, moment.slice->category);
            for (const TrackArgument& each : moment.slice->arguments) tell(told, each);
            for (const std::uint64_t arrow : moment.slice->arrows_out)
                told.add_fixed64(event::kFlow, arrow);
            if (moment.slice->arrow_in != 0)
                told.add_fixed64(event::kLastFlow, moment.slice->arrow_in);
        });
    }

    static void tell(protozero::pbf_writer& event, const TrackArgument& from) {
        protozero::pbf_writer writer(event, event::kArgument);
        writer.add_string(argument::kName, from.first);
        if (const auto* number = std::get_if<std::int64_t>(&from.second))
            writer.add_int64(argument::kInt, *number);
        else if (const auto* real = std::get_if<double>(&from.second))
            writer.add_double(argument::kDouble, *real);
        else
            writer.add_string(argument::kString, std::get<std::string>(from.second));
    }

    std::string trace_;
    bool is_first_ = true;
};

}  // namespace

std::string to_perfetto(const Run& run, const RunStory& story) {
    return PerfettoWriter().write(run, story, timeline(run, story));
}

}  // namespace urgengo::trace
