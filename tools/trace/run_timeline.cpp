// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_timeline.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "host/observe/miss_cause.h"
#include "host/observe/mode_word.h"
#include "tools/trace/run_kernels.h"
#include "tools/trace/run_pieces.h"
#include "tools/trace/run_summary.h"

namespace urgengo::trace {
namespace {

using Kind = RunSlice::Kind;

class Drawing {
  public:
    Drawing(const Run& run, const RunStory& story) : run_(run), story_(story) {}

    std::vector<Track> draw() {
        lay_out();
        for (const RunFrame& frame : story_.frames) draw_frame(frame);
        for (const RunSlice& slice : story_.slices) draw_slice(slice);
        for (const RunPiece& piece : pieces_) draw_piece(piece);
        for (const RunRecord& point : story_.points) draw_point(point);
        for (Track& track : tracks_)
            std::stable_sort(
                track.values.begin(), track.values.end(),
                [](const TrackValue& a, const TrackValue& b) { return a.time_ns < b.time_ns; });
        draw_arrows();
        return std::move(tracks_);
    }

  private:
    struct OfTask {
        int slices[5] = {};  ///< tracks: task, GPU, waits, held, gates
        int kernel = 0, laxity = 0, priority = 0, held = 0;
        std::size_t held_frame = kNoFrame;
        std::int64_t held_ns = 0;
    };
    struct Place {
        int track = -1;
        std::size_t slice = 0;
    };

    int add(const std::string& name, int parent, Track::Kind kind, const std::string& unit = "") {
        tracks_.push_back({name, parent, kind, unit, {}, {}, {}});
        return static_cast<int>(tracks_.size()) - 1;
    }
    Track& track(int index) { return tracks_[static_cast<std::size_t>(index)]; }

    void lay_out() {
        of_task_.resize(run_.tasks.size());
        frames_.resize(run_.chains.size());
        gates_.assign(run_.tasks.size(), -1);
        std::vector<std::vector<std::size_t>> tasks(run_.chains.size());
        for (std::size_t t = 0; t < run_.tasks.size(); ++t)
            if (run_.tasks[t].chain < tasks.size()) tasks[run_.tasks[t].chain].push_back(t);
        for (std::size_t c = 0; c < run_.chains.size(); ++c) {
            groups_.push_back(add(run_.chains[c].name, -1, Track::Kind::kGroup));
            frames_[c].push_back(add("frames", groups_[c], Track::Kind::kSlices));
            for (const std::size_t task : tasks[c]) lay_out_task(task, groups_[c]);
        }
        for (const RunSlice& slice : story_.slices)
            if (slice.kind == Kind::kHold && (slice.flags & abi::kRunGate)) gates_[slice.task] = 0;
        const GateSummary gates = summarize_gates(story_);
        if (gates.has_any() ||
            std::any_of(gates_.begin(), gates_.end(), [](int gate) { return gate == 0; })) {
            const int dispatcher = add("dispatcher", -1, Track::Kind::kGroup);
            for (std::size_t t = 0; t < run_.tasks.size(); ++t)
                if (gates_[t] == 0)
                    gates_[t] = add(task_name(run_, t), dispatcher, Track::Kind::kSlices);
            if (gates.host_rounds > 0) rounds_ = add("rounds", dispatcher, Track::Kind::kSlices);
            if (gates.openings_by_gpu > 0)
                gpu_rounds_ = add("rounds of the GPU", dispatcher, Track::Kind::kSlices);
            if (gates.parks > 0) parks_ = add("parks", dispatcher, Track::Kind::kSlices);
        }
        lay_out_streams();
        own_ = add("UrgenGo", -1, Track::Kind::kSlices);
    }

    void lay_out_task(std::size_t task, int group) {
        OfTask& its = of_task_[task];
        const std::string& name = run_.tasks[task].name;
        its.slices[0] = add(name, group, Track::Kind::kSlices);
        its.slices[1] = add(name + ": GPU", group, Track::Kind::kSlices);
        its.slices[2] = add(name + ": waits", group, Track::Kind::kSlices);
        its.slices[3] = add(name + ": held", group, Track::Kind::kSlices);
        its.kernel = add(name + ": kernel", group, Track::Kind::kCounter, "");
        its.laxity = add(name + ": laxity", group, Track::Kind::kCounter, "ms");
        its.priority = add(name + ": priority", group, Track::Kind::kCounter, "");
        its.held = add(name + ": held so far", group, Track::Kind::kCounter, "ms");
    }

    /// Of records without them there is one for each task.
    void lay_out_streams() {
        if (pieces_.empty()) return;
        streams_group_ = add("streams", -1, Track::Kind::kGroup);
        for (const RunPiece& piece : pieces_) streams_[key_of(piece)];
        for (auto& [key, lanes] : streams_)
            lanes.push_back(add(stream_name(key), streams_group_, Track::Kind::kSlices));
    }
    using StreamKey =
        std::pair<std::uint16_t, std::size_t>;  ///< stream; task, if that is not known
    static StreamKey key_of(const RunPiece& piece) {
        return {piece.stream, piece.stream == 0 ? piece.task : 0};
    }
    std::string stream_name(const StreamKey& key) const {
        if (key.first == 0) return task_name(run_, key.second);
        if (key.first == abi::kRunLegacyStream) return "default stream";
        return fmt::format("stream {}", key.first);
    }

    /// @returns the first of the tracks that is free then; another one like them, if none is
    int lane_at(std::int64_t begin_ns, std::vector<int>& lanes, const std::string& name,
                int parent) {
        for (const int lane : lanes)
            if (track(lane).slices.empty() || track(lane).slices.back().end_ns <= begin_ns)
                return lane;
        // One behind the other, as well as can be.
        if (lanes.size() < kMostLanes) lanes.push_back(add(name, parent, Track::Kind::kSlices));
        return lanes.back();
    }

    void draw_frame(const RunFrame& frame) {
        const int lane =
            lane_at(frame.arrival_ns, frames_[frame.chain], "frames", groups_[frame.chain]);
        TrackSlice slice;
        slice.begin_ns = frame.arrival_ns;
        slice.end_ns = frame.end_ns;
        slice.name = frame_name(run_, frame);
        slice.category = "chain";
        const std::int64_t deadline = run_.chains[frame.chain].deadline_ns;
        slice.arguments = {{"deadline_ms", to_ms(deadline)}};
        if (frame.has_ended) {
            slice.arguments.emplace_back("latency_ms", to_ms(frame.latency_ns));
            if (frame.is_late()) {
                slice.name += frame.exited ? " ended early" : " late";
                slice.arguments.emplace_back(
                    "cause", observe::in_words(frame.cause, chain_name(run_, frame.behind),
                                               frame.cause_detail));
                slice.arguments.emplace_back("late_ms", to_ms(frame.latency_ns - deadline));
                slice.arguments.emplace_back("cause_ms", to_ms(frame.amount_ns));
            }
        } else {
            slice.name += " (no end)";
        }
        put(lane, std::move(slice));
    }

    void draw_piece(const RunPiece& piece) {
        const StreamKey key = key_of(piece);
        TrackSlice slice;
        slice.begin_ns = piece.begin_ns;
        slice.end_ns = piece.end_ns;
        const std::string kernels = kernels_.of(piece);
        slice.name = task_name(run_, piece.task) + ": " +
                     (kernels.empty() ? launches_words(piece) : kernels);
        slice.category = "gpu";
        if (piece.frame != kNoFrame)
            slice.arguments.emplace_back("frame", frame_name(run_, story_.frames[piece.frame]));
        slice.arguments.emplace_back("first_launch", std::int64_t{piece.first_launch});
        slice.arguments.emplace_back("end_launch", std::int64_t{piece.end_launch});
        slice.arguments.emplace_back("end_by", piece.is_on_gpu_clock ? "GPU's clock" : "host");
        put(lane_at(piece.begin_ns, streams_[key], stream_name(key), streams_group_),
            std::move(slice));
    }

    void draw_slice(const RunSlice& from) {
        OfTask& its = of_task_[from.task];
        TrackSlice slice;
        slice.begin_ns = from.begin_ns;
        slice.end_ns = from.end_ns;
        int on = 0;
        switch (from.kind) {
            case Kind::kTask:
                on = its.slices[0];
                slice.category = "task";
                slice.name = run_.tasks[from.task].name;
                if (from.flags & abi::kRunObserved) slice.name += " (observed)";
                break;
            case Kind::kSegment:
                on = its.slices[1];
                slice.category = "gpu";
                slice.name = "GPU segment";
                slice.arguments.emplace_back("planned_ms", to_ms(from.estimate_ns));
                break;
            case Kind::kWait:
                on = its.slices[2];
                slice.category = "wait";
                slice.name = "waits for the GPU";
                break;
            case Kind::kHold:
                on = (from.flags & abi::kRunGate) ? gates_[from.task] : its.slices[3];
                slice.category = "hold";
                slice.name = hold_words(run_, from);
                slice.arguments.emplace_back("why", std::string(in_words(from.why)));
                if (from.behind_task >= 0)
                    slice.arguments.emplace_back(
                        "behind", task_name(run_, static_cast<std::size_t>(from.behind_task)));
                break;
        }
        if (from.frame != kNoFrame)
            slice.arguments.emplace_back("frame", frame_name(run_, story_.frames[from.frame]));
        if (from.is_open) slice.arguments.emplace_back("no_end", std::int64_t{1});
        const Place place = put(on, std::move(slice));
        if (from.kind == Kind::kHold && !from.is_paced()) count_held(its, from);
        if (from.kind == Kind::kHold && from.behind_task >= 0 && !from.is_paced())
            held_.push_back({&from, place});
        if (from.kind == Kind::kSegment || from.kind == Kind::kTask)
            work_.push_back({&from, place});
    }

    void count_held(OfTask& its, const RunSlice& hold) {
        if (std::exchange(its.held_frame, hold.frame) != hold.frame) its.held_ns = 0;
        const auto tell = [&](std::int64_t at) {
            track(its.held).values.push_back({at, to_ms(its.held_ns)});
        };
        tell(hold.begin_ns);
        its.held_ns += hold.length_ns();
        tell(hold.end_ns);
    }

    /// Slices of one track come in the order of their begins.
    Place put(int on, TrackSlice slice) {
        std::vector<TrackSlice>& slices = track(on).slices;
        if (!slices.empty()) slice.begin_ns = std::max(slice.begin_ns, slices.back().end_ns);
        slice.end_ns = std::max(slice.end_ns, slice.begin_ns + 1);
        slices.push_back(std::move(slice));
        return {on, slices.size() - 1};
    }

    void draw_point(const RunRecord& point) {
        if (point.kind == RunKind::kMode)
            return track(own_).instants.push_back(
                {point.time_ns, std::string("mode: ") + observe::to_word(point.mode)});
        if (point.kind == RunKind::kTrip)
            return track(own_).instants.push_back({point.time_ns, "switched itself off"});
        if (point.kind == RunKind::kReload)
            return track(own_).instants.push_back({point.time_ns, "another config"});
        if (point.kind == RunKind::kChainMode || point.kind == RunKind::kGuard)
            return track(own_).instants.push_back({point.time_ns, steered_words(run_, point)});
        if (point.kind == RunKind::kFrameDropped)
            return track(frames_[static_cast<std::size_t>(point.chain)][0])
                .instants.push_back({point.time_ns, "a frame never came to its end"});
        if (point.kind == RunKind::kPark) return draw_park(point);
        if (point.kind == RunKind::kRound) return draw_round(point);
        if (point.task < 0) return;
        OfTask& its = of_task_[static_cast<std::size_t>(point.task)];
        if (point.kind == RunKind::kPriority) {
            track(its.priority)
                .values.push_back({point.time_ns, static_cast<double>(point.priority.now)});
        } else if (point.kind == RunKind::kMark) {
            const std::int64_t time = point.begin_ns != 0 ? point.begin_ns : point.time_ns;
            track(its.kernel).values.push_back({time, static_cast<double>(point.mark.position)});
            track(its.laxity).values.push_back({point.time_ns, to_ms(point.mark.laxity_ns)});
        }
    }

    void draw_park(const RunRecord& park) {
        TrackSlice slice{park.begin_ns, park.time_ns, "no gate is closed", "dispatch", {}, {}, 0};
        slice.arguments = {{"gated_tasks", std::int64_t{park.park.gated}},
                           {"opening_ms", to_ms(park.park.opening_ns)},
                           {"held_in_threads", std::int64_t{park.park.refused}}};
        put(parks_, std::move(slice));
    }

    // When the GPU's were is known no better than between two looks: they have no length here.
    void draw_round(const RunRecord& round) {
        const std::int64_t opened = round.round.opened;
        if (round.flags & abi::kRunByGpu) {
            if (gpu_rounds_ < 0) return;  // none opened any
            return track(gpu_rounds_)
                .instants.push_back({round.time_ns, fmt::format("opened {} times in {} rounds",
                                                                opened, round.round.rounds)});
        }
        TrackSlice slice{round.begin_ns, round.time_ns, "opens gates", "dispatch", {}, {}, 0};
        slice.arguments = {{"gates", opened}};
        put(rounds_, std::move(slice));
    }

    // From the segment of the task that a launch was held behind, else from its work on the frame.
    void draw_arrows() {
        std::uint64_t number = 0;
        std::vector<std::vector<const Drawn*>> of_task(run_.tasks.size());
        for (const Drawn& drawn : work_) of_task[drawn.from->task].push_back(&drawn);
        for (const Drawn& held : held_) {
            const Drawn* found = nullptr;
            const auto& works = of_task[static_cast<std::size_t>(held.from->behind_task)];
            auto next = std::upper_bound(
                works.begin(), works.end(), held.from->begin_ns,
                [](std::int64_t time, const Drawn* d) { return time < d->from->begin_ns; });
            for (int looks = 0; next != works.begin() && looks < kLooks; ++looks) {
                const Drawn* const work = *--next;
                if (work->from->end_ns < held.from->begin_ns) continue;
                if (!found || work->from->kind == Kind::kSegment) found = work;
                if (found->from->kind == Kind::kSegment) break;
            }
            if (!found) continue;
            ++number;
            slice_at(found->place).arrows_out.push_back(number);
            slice_at(held.place).arrow_in = number;
        }
    }
    TrackSlice& slice_at(const Place& place) { return track(place.track).slices[place.slice]; }

    /// Of one chain or stream, of what is under way at once.
    static constexpr std::size_t kMostLanes = 64;
    static constexpr int kLooks = 16;
    struct Drawn {
        const RunSlice* from;
        Place place;
    };

    const Run& run_;
    const RunStory& story_;
    const std::vector<RunPiece> pieces_ = gpu_pieces(run_, story_);
    const PlannedKernelNames kernels_{run_};
    std::vector<Track> tracks_;
    std::vector<OfTask> of_task_;
    std::vector<int> groups_, gates_;
    std::vector<std::vector<int>> frames_;
    std::map<StreamKey, std::vector<int>> streams_;
    int streams_group_ = -1, own_ = 0;
    int rounds_ = -1, gpu_rounds_ = -1, parks_ = -1;
    std::vector<Drawn> held_, work_;
};

}  // namespace

std::vector<Track> timeline(const Run& run, const RunStory& story) {
    return Drawing(run, story).draw();
}

}  // namespace urgengo::trace
