// SPDX-License-Identifier: Apache-2.0
//
// A task's launches as a small graph over streams, as the program makes it: by launches, events
// that it records and waits for, and the order of the legacy default stream.
//
//   1 Every stream that carries the task's work is a branch. A branch knows which launches come
//     before what is next on it (a vector clock over the branches: Coverage).
//   2 An event takes the coverage of its stream along; a stream that waits for it covers that, too.
//   3 The legacy stream comes after whatever is on blocking streams, and those after it.
//   4 A wait of the host covers what its stream or event covers. Several add up.
//   5 A mark vouches for everything only on a stream that covers all that has not executed yet:
//     vouches() says so of the stream of the last launch.
//
// What is not seen is not believed: a stream that is not known covers nothing. Branches are used
// again once nothing of theirs is open and they cover nothing that is; a task that has more at a
// time is lost sight of until all its work is known to have executed.
//
// Launches that stay on one stream cost nothing here: they are counted when they are asked for
// (settle()).
//
// @threads one at a time: the one that has the task
#pragma once

#include "host/progress/coverage.h"

namespace urgengo::progress {

enum class StreamKind : std::uint8_t { kNonBlocking, kBlocking, kLegacy };

/// Whatever tells streams apart. 0: none.
using StreamId = std::uint64_t;

class StreamGraph {
  public:
    /// @returns whether a mark on the stream of the last launch, before or behind that launch,
    ///          vouches for all that the task has launched
    bool vouches() const { return vouches_; }
    /// @returns whether launches went to more streams at a time than can be followed
    bool is_lost() const { return is_lost_; }
    /// @returns the stream that launches are counted for; a launch on another one needs move_to()
    StreamId current() const {
        return current_ >= 0 ? branches_[static_cast<std::size_t>(current_)].stream : 0;
    }
    /// @returns that of the last launch; negative: not known
    int branch() const { return current_; }
    /// @returns whether open work, or the order behind it, may be on several streams
    bool is_forked() const { return is_forked_; }
    bool knows(StreamId stream) const { return find(stream) >= 0; }

    // Everywhere, `launched` is how many launches the task has made so far.

    /// The next launches go to this stream.
    /// @param kind  of no matter if the stream is known
    void move_to(StreamId stream, StreamKind kind, std::uint64_t launched);
    /// What comes next on `stream` waits for what is covered.
    void waits_for(StreamId stream, StreamKind kind, const Coverage& covered,
                   std::uint64_t launched);
    /// @returns which launches come before what is next on `stream`
    Coverage covered_by(StreamId stream, StreamKind kind, std::uint64_t launched);
    /// @returns whether what is covered, and has executed, is all that the task has launched
    bool covers_all(const Coverage& covered, std::uint64_t launched);
    /// What is covered is known to have executed.
    void executed(const Coverage& covered, std::uint64_t launched);
    void all_executed(std::uint64_t launched) { executed({.all = launched, .on = {}}, launched); }
    /// @returns whether `covered` has any launch that is not known to have executed
    bool has_open(const Coverage& covered) const;
    /// The stream is gone, and its handle may come to mean another one. Its work may not be done.
    void forget(StreamId stream, std::uint64_t launched);
    void forget_streams(std::uint64_t launched);

  private:
    struct Branch {
        StreamId stream = 0;  ///< 0: it is gone
        StreamKind kind = StreamKind::kNonBlocking;
        std::uint64_t last = 0;  ///< the last launch on it
        Coverage covered;        ///< before what is next on it
    };

    int find(StreamId stream) const;
    int find_or_add(StreamId stream, StreamKind kind);
    bool is_open(int branch) const;
    void settle(std::uint64_t launched);
    void see_whether_it_vouches();
    void gather(Coverage& covered) const;
    void spread(const Coverage& covered);

    std::array<Branch, kMaxStreams> branches_{};
    int num_branches_ = 0;
    int current_ = -1;  ///< branch of the last launch; -1: not known
    bool vouches_ = true;
    bool is_lost_ = false;
    bool is_forked_ = false;
    std::uint64_t settled_ = 0;  ///< launches that the branches know of
    Coverage executed_;
};

}  // namespace urgengo::progress
