// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/random_program.h"

#include <algorithm>

namespace twin {
namespace {

/// For each stream, how many of its operations are over, or have been issued.
using Clock = std::array<int, kNumStreams>;

/// One access to a word: the stream, and the operation's number there, from 1.
struct Access {
    int stream;
    int number;
};

struct Word {
    Access write{0, 0};
    std::vector<Access> reads{};  ///< since
};

void merge(Clock& into, const Clock& other) {
    for (std::size_t s = 0; s < into.size(); ++s) into[s] = std::max(into[s], other[s]);
}

bool is_non_blocking(int stream) {
    return stream >= kFirstNonBlockingStream && stream < kFirstPerThreadStream;
}

/// Whether the stream waits for the other one's earlier work without being told to.
bool waits_implicitly(int stream, int other) {
    const bool one_is_legacy = (stream == kLegacyStream) != (other == kLegacyStream);
    return one_is_legacy && !is_non_blocking(stream) && !is_non_blocking(other);
}

/// Whether the operation is certain to make those implicit waits.
bool surely_waits(const Operation& operation) {
    switch (operation.kind) {
        case Kind::kMix:
        case Kind::kStore:
        case Kind::kTiny:
        case Kind::kWide:
        case Kind::kMemset:
            return true;
        case Kind::kCopy:
            return operation.from >= kNumHostWords;
        case Kind::kReadBack:
            return operation.word >= kNumHostWords;
        default:
            return false;
    }
}

bool waits_for_stream(Kind kind) {
    return kind == Kind::kReadBack || kind == Kind::kStreamSync || kind == Kind::kEventSync ||
           kind == Kind::kPoll;
}

/// What unloading does to a capture is not documented.
bool waits_for_context(Kind kind) {
    return kind == Kind::kContextSync || kind == Kind::kLoadUnload;
}

bool reads(Kind kind) {
    return kind == Kind::kCopy || kind == Kind::kPool;
}

class Generator {
  public:
    Generator(std::uint64_t seed, bool forward_waits)
        : random_(seed), forward_waits_(forward_waits) {
        // Of tight and of loose chains, and of none: see test_random.cpp.
        static constexpr std::array kNames = {"twin",   "twin_0", "twin_1",   "twin_2", "twin_3",
                                              "twin_6", "twin_7", "twin_odd", "other",  "nobody"};
        program_.num_threads = 1 + below(kMaxThreads);
        for (std::string& name : program_.thread_names)
            name = kNames[std::size_t(below(int(kNames.size())))];
        const int num_streams = 2 + below(4);
        while (int(streams_.size()) < num_streams)
            streams_.push_back(below(kFirstPerThreadStream + program_.num_threads));
        for (auto& history : over_by_) history.push_back({});
        last_on_.fill(-1);
        last_of_.fill(-1);
        last_capture_.fill(-1);
        last_context_sync_.fill(-1);
    }

    Program make() {
        const int target = 30 + below(31);
        while (int(program_.operations.size()) < target) {
            if (pending_stream_ >= 0 && --pending_for_ < 0) write_awaited_flag();
            add_any();
        }
        if (pending_stream_ >= 0) write_awaited_flag();
        return std::move(program_);
    }

  private:
    // std::uniform_int_distribution differs between standard libraries.
    int below(int end) { return int(random_() % std::uint64_t(end)); }
    bool chance(int percent) { return below(100) < percent; }

    int some_stream() { return streams_[std::size_t(below(int(streams_.size())))]; }
    /// A thread that has the stream.
    int thread_for(int stream) {
        return stream >= kFirstPerThreadStream ? stream - kFirstPerThreadStream
                                               : below(program_.num_threads);
    }

    /// @returns what is over once the stream's operation of that number is
    const Clock& over_by(int stream, int number) const {
        return over_by_[std::size_t(stream)][std::size_t(number)];
    }
    int last_number(int stream) const { return int(over_by_[std::size_t(stream)].size()) - 1; }
    const Clock& over_by_last(int stream) const { return over_by(stream, last_number(stream)); }

    /// @returns what is over when an operation that the thread adds to the stream begins
    Clock known_before(const Operation& operation) const {
        const int thread = operation.thread, stream = operation.stream;
        Clock clock = over_by_last(stream), issued = issued_[std::size_t(thread)];
        merge(clock, known_[std::size_t(thread)]);
        if (const int last = last_on_[std::size_t(stream)]; last >= 0) {
            merge(clock, known_by_[std::size_t(last)]);
            merge(issued, issued_by_[std::size_t(last)]);
        }
        if (surely_waits(operation))
            for (int other = 0; other < kNumStreams; ++other) {
                if (waits_implicitly(stream, other))
                    merge(clock, over_by(other, issued[std::size_t(other)]));
            }
        return clock;
    }

    /// Makes the operation come after an earlier one, whose thread's knowledge its own gets.
    void come_after(Operation& operation, int earlier) {
        if (earlier < 0) return;
        const auto thread = std::size_t(operation.thread);
        merge(issued_[thread], issued_by_[std::size_t(earlier)]);
        merge(known_[thread], known_by_[std::size_t(earlier)]);
        const bool other_thread =
            program_.operations[std::size_t(earlier)].thread != operation.thread;
        std::vector<int>& after = operation.after;
        if (other_thread && std::find(after.begin(), after.end(), earlier) == after.end())
            after.push_back(earlier);
    }

    /// Threads capture at the same time, and wait for the context, but do not do both.
    void keep_captures_from_context_syncs(Operation& operation) {
        if (waits_for_context(operation.kind))
            for (int last : last_capture_) come_after(operation, last);
        if (operation.kind == Kind::kGraph)
            for (int last : last_context_sync_) come_after(operation, last);
    }

    /// Appends an operation. @param also_over  what is over when it ends, besides what is known
    void add(Operation operation, bool enqueues, const Clock& also_over = {}) {
        const int index = int(program_.operations.size());
        const auto thread = std::size_t(operation.thread), stream = std::size_t(operation.stream);
        come_after(operation, last_on_[stream]);
        keep_captures_from_context_syncs(operation);
        if (operation.kind == Kind::kGraph) last_capture_[thread] = index;
        if (waits_for_context(operation.kind)) last_context_sync_[thread] = index;
        if (enqueues) {
            Clock clock = known_before(operation);
            merge(clock, also_over);
            clock[stream] = last_number(operation.stream) + 1;
            over_by_[stream].push_back(clock);
            issued_[thread][stream] = clock[stream];
            last_on_[stream] = index;
            if (operation.kind == Kind::kHostMix) add_host_function(index, clock);
        }
        if (waits_for_stream(operation.kind)) learn(operation, over_by_last(operation.stream));
        if (operation.kind == Kind::kContextSync)
            for (int s = 0; s < kNumStreams; ++s)
                learn(operation, over_by(s, issued_[thread][std::size_t(s)]));
        program_.operations.push_back(std::move(operation));
        issued_by_.push_back(issued_[thread]);
        known_by_.push_back(known_[thread]);
        last_of_[thread] = index;
    }

    /// The operation's thread knows that this is over when the call returns.
    void learn(Operation& operation, const Clock& over) {
        Clock& known = known_[std::size_t(operation.thread)];
        for (const auto& [function, access] : host_functions_) {
            const auto stream = std::size_t(access.stream);
            if (over[stream] >= access.number && known[stream] < access.number)
                operation.waits_for.push_back(function);
        }
        merge(known, over);
    }

    void add_host_function(int index, const Clock& clock) {
        for (int s = 0; s < kNumStreams; ++s) {
            const auto last = std::find_if(
                host_functions_.rbegin(), host_functions_.rend(), [&](const auto& function) {
                    const Access& its = function.second;
                    return its.stream == s && its.number <= clock[std::size_t(s)];
                });
            if (last != host_functions_.rend()) program_.in_order.emplace_back(last->first, index);
        }
        const int stream =
            int(std::find(last_on_.begin(), last_on_.end(), index) - last_on_.begin());
        host_functions_.push_back({index, {stream, clock[std::size_t(stream)]}});
    }

    // Orders.

    /// Makes what is on stream `other` come before what the thread adds to `stream` from now on.
    /// @returns false if that cannot be
    bool order(int other, int thread, int stream) {
        if (other == pending_stream_) return false;
        const Clock over = over_by_last(other);
        const int way = below(100);
        const bool forward = forward_waits_ && pending_stream_ < 0 && is_non_blocking(stream) &&
                             is_non_blocking(other);
        if (forward && way < 20) {
            wait_for_later_flag(other, thread, stream, over);
        } else if (way < 50) {
            const auto event = std::uint64_t(program_.num_events++);
            add({Kind::kRecord, thread_for(other), other, -1, -1, event, unsigned(below(2))}, true);
            Operation wait{Kind::kWaitEvent, thread, stream, -1, -1, event};
            come_after(wait, last_on_[std::size_t(other)]);
            add(wait, true, over);
        } else if (way < 70) {
            const auto flag = std::uint64_t(program_.num_flags++);
            add({Kind::kWriteFlag, thread_for(other), other, -1, -1, flag}, true);
            Operation wait{Kind::kWaitFlag, thread, stream, -1, -1, flag, unsigned(below(2))};
            come_after(wait, last_on_[std::size_t(other)]);
            add(wait, true, over);
        } else {
            wait_in_thread(other, thread);
        }
        return true;
    }

    void wait_in_thread(int stream, int thread) {
        const bool has_it =
            stream < kFirstPerThreadStream || stream == kFirstPerThreadStream + thread;
        if (has_it && chance(60)) {
            add({chance(60) ? Kind::kStreamSync : Kind::kPoll, thread, stream}, false);
        } else if (pending_stream_ < 0 && chance(40)) {
            add({Kind::kContextSync, thread, stream}, false);
        } else {
            const auto event = std::uint64_t(program_.num_events++);
            add({Kind::kRecord, thread_for(stream), stream, -1, -1, event, unsigned(below(2))},
                true);
            add({Kind::kEventSync, thread, stream, -1, -1, event}, false);
        }
    }

    /// As no thread may already wait for the stream when it is blocked, or be about to, the wait
    /// is issued after all that stands before it.
    void wait_for_later_flag(int writer, int thread, int stream, const Clock& over) {
        Operation wait{
            Kind::kWaitFlag, thread, stream, -1, -1, std::uint64_t(program_.num_flags++)};
        for (int last : last_of_) come_after(wait, last);
        pending_stream_ = stream;
        pending_writer_ = writer;
        pending_flag_ = wait.value;
        pending_for_ = below(6);
        add(wait, true, over);
    }

    void write_awaited_flag() {
        add({Kind::kWriteFlag, thread_for(pending_writer_), pending_writer_, -1, -1, pending_flag_},
            true);
        pending_stream_ = -1;
    }

    // Work.

    /// @returns a stream whose accesses conflict with the operation's and may not be over; or -1
    int find_conflict(const Operation& operation) const {
        const Clock over = known_before(operation);
        const auto races = [&](const Access& access) {
            return access.number > over[std::size_t(access.stream)];
        };
        for (const int index : {operation.word, operation.from}) {
            if (index < 0) continue;
            const Word& word = words_[std::size_t(index)];
            if (races(word.write)) return word.write.stream;
            if (index == operation.from && reads(operation.kind)) continue;
            for (const Access& access : word.reads)
                if (races(access)) return access.stream;
        }
        return -1;
    }

    void add_access(const Operation& operation) {
        const Access access{operation.stream, last_number(operation.stream)};
        for (const int index : {operation.word, operation.from}) {
            if (index < 0) continue;
            Word& word = words_[std::size_t(index)];
            if ((index == operation.from && reads(operation.kind)) ||
                operation.kind == Kind::kReadBack)
                word.reads.push_back(access);
            else
                word = {access};
        }
    }

    void choose_words(Operation& operation) {
        switch (operation.kind) {
            case Kind::kTiny:
            case Kind::kWide:
                return;
            case Kind::kHostMix:
                operation.word = below(kNumHostWords);
                return;
            case Kind::kCopy:
            case Kind::kPool:
            case Kind::kGraph:
                operation.from = below(kNumWords);
                operation.word = (operation.from + 1 + below(kNumWords - 1)) % kNumWords;
                return;
            default:
                operation.word = below(kNumWords);
        }
    }

    void add_work(Kind kind) {
        Operation operation{kind, 0, some_stream()};
        operation.thread = thread_for(operation.stream);
        if (kind == Kind::kReadBack) {
            operation.stream =
                chance(50) ? kLegacyStream : kFirstPerThreadStream + operation.thread;
        }
        operation.value = random_() >> 8;
        operation.variant = unsigned(random_() % 1024);
        choose_words(operation);
        for (int tries = 12; tries > 0; --tries) {
            const int conflict = find_conflict(operation);
            if (conflict < 0) {
                add(operation, true);
                add_access(operation);
                return;
            }
            // An order is worth more than words that need none, but must not be all there is.
            if (chance(40) || !order(conflict, operation.thread, operation.stream))
                choose_words(operation);
        }
    }

    void add_any() {
        const int which = below(100);
        const int stream = some_stream(), thread = thread_for(stream);
        if (which < 22) return add_work(Kind::kMix);
        if (which < 27) return add_work(Kind::kStore);
        if (which < 30) return add_work(Kind::kTiny);
        if (which < 40) return add_work(Kind::kWide);
        if (which < 53) return add_work(Kind::kCopy);
        if (which < 59) return add_work(Kind::kMemset);
        if (which < 64) return add_work(Kind::kWriteValue);
        if (which < 75) return add_work(Kind::kHostMix);
        if (which < 79) return add_work(Kind::kPool);
        if (which < 84) return add_work(Kind::kGraph);
        if (which < 88) return add_work(Kind::kReadBack);
        if (which < 93) {
            if (stream != pending_stream_) wait_in_thread(stream, thread);
        } else if (which < 95) {
            constexpr std::array kKinds = {Kind::kAllocFree, Kind::kRegister, Kind::kLoadUnload};
            const Kind kind = kKinds[std::size_t(below(int(kKinds.size())))];
            if (pending_stream_ < 0) add({kind, thread, stream}, false);
        } else if (which < 98) {
            add({Kind::kQuery, thread, stream}, false);
        } else {
            add({Kind::kRefused, thread, stream, -1, -1, 0, unsigned(below(3))}, false);
        }
    }

    std::mt19937_64 random_;
    const bool forward_waits_;
    Program program_;
    std::vector<int> streams_;  ///< that this program uses; one may be there twice

    std::array<std::vector<Clock>, kNumStreams> over_by_;  ///< by number on the stream
    std::array<int, kNumStreams> last_on_;                 ///< operations; -1 for none
    std::array<int, kMaxThreads> last_of_;
    std::array<int, kMaxThreads> last_capture_, last_context_sync_;
    std::array<Clock, kMaxThreads> known_{};   ///< is over, as each thread knows
    std::array<Clock, kMaxThreads> issued_{};  ///< has been issued, likewise
    std::vector<Clock> known_by_, issued_by_;  ///< those of its thread after each operation
    std::vector<std::pair<int, Access>> host_functions_;
    std::array<Word, kNumWords> words_;

    int pending_stream_ = -1;  ///< waits for a flag that nobody writes yet
    int pending_writer_ = -1;
    std::uint64_t pending_flag_ = 0;
    int pending_for_ = 0;  ///< further additions until it is written
};

}  // namespace

Program make_program(std::uint64_t seed, bool forward_waits) {
    return Generator(seed, forward_waits).make();
}

}  // namespace twin
