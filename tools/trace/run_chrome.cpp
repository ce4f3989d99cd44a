// SPDX-License-Identifier: Apache-2.0
#include <nlohmann/json.hpp>

#include "tools/trace/run_export.h"
#include "tools/trace/run_timeline.h"

namespace urgengo::trace {
namespace {

using json = nlohmann::ordered_json;

double to_us(std::int64_t ns) {
    return 1e-3 * static_cast<double>(ns);
}

class ChromeWriter {
  public:
    std::string write(const Run& run, const std::vector<Track>& tracks) {
        const std::int64_t origin = run.begin_ns;
        process_ = run.process;
        text_ = "{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n";
        add({{"ph", "M"},
             {"name", "process_name"},
             {"pid", process_},
             {"args", {{"name", run.program}}}});
        for (std::size_t i = 0; i < tracks.size(); ++i) write(tracks, i, origin);
        text_ += "\n]}\n";
        return std::move(text_);
    }

  private:
    void add(const json& event) {
        if (!is_first_) text_ += ",\n";
        is_first_ = false;
        text_ += event.dump(-1, ' ', false, json::error_handler_t::replace);
    }
    json event(const char* phase, std::size_t track, std::int64_t ns) const {
        return {{"ph", phase}, {"pid", process_}, {"tid", track + 1}, {"ts", to_us(ns)}};
    }

    void write(const std::vector<Track>& tracks, std::size_t index, std::int64_t origin) {
        const Track& track = tracks[index];
        if (track.kind == Track::Kind::kGroup) return;
        std::string name = track.name;
        if (track.parent >= 0)
            name = tracks[static_cast<std::size_t>(track.parent)].name + "/" + name;
        if (track.kind == Track::Kind::kCounter) {
            for (const TrackValue& value : track.values) {
                json counter = event("C", index, value.time_ns - origin);
                counter["name"] = name;
                counter["args"] = {{track.unit.empty() ? "value" : track.unit, value.value}};
                add(counter);
            }
            return;
        }
        for (const auto& [what, value] :
             {std::pair<const char*, json>{"thread_name", {{"name", name}}},
              std::pair<const char*, json>{"thread_sort_index", {{"sort_index", index}}}})
            add({{"ph", "M"},
                 {"name", what},
                 {"pid", process_},
                 {"tid", index + 1},
                 {"args", value}});
        for (const TrackSlice& slice : track.slices) write(slice, index, origin);
        for (const TrackInstant& instant : track.instants) {
            json told = event("i", index, instant.time_ns - origin);
            told["name"] = instant.name;
            told["s"] = "t";
            add(told);
        }
    }

    void write(const TrackSlice& slice, std::size_t track, std::int64_t origin) {
        json told = event("X", track, slice.begin_ns - origin);
        told["dur"] = to_us(slice.end_ns - slice.begin_ns);
        told["name"] = slice.name;
        told["cat"] = slice.category;
        for (const auto& [name, value] : slice.arguments)
            std::visit([&, &key = name](const auto& its) { told["args"][key] = its; }, value);
        add(told);
        const auto arrow = [&](const char* phase, std::uint64_t number) {
            json end = event(phase, track, slice.begin_ns - origin);
            end["name"] = end["cat"] = "behind";
            end["id"] = number;
            if (*phase == 'f') end["bp"] = "e";
            add(end);
        };
        for (const std::uint64_t number : slice.arrows_out) arrow("s", number);
        if (slice.arrow_in != 0) arrow("f", slice.arrow_in);
    }

    std::string text_;
    std::uint32_t process_ = 0;
    bool is_first_ = true;
};

}  // namespace

std::string to_chrome(const Run& run, const RunStory& story) {
    return ChromeWriter().write(run, timeline(run, story));
}

}  // namespace urgengo::trace
