// SPDX-License-Identifier: Apache-2.0
#include "host/progress/stream_graph.h"

namespace urgengo::progress {
namespace {

std::size_t at(int branch) {
    return static_cast<std::size_t>(branch);
}

}  // namespace

int StreamGraph::find(StreamId stream) const {
    for (int i = 0; i < num_branches_; ++i)
        if (branches_[at(i)].stream == stream) return i;
    return -1;
}

bool StreamGraph::is_open(int branch) const {
    return !executed_.covers(branch, branches_[at(branch)].last);
}

bool StreamGraph::has_open(const Coverage& covered) const {
    for (int i = 0; i < num_branches_; ++i) {
        const auto least = std::max(covered.all, covered.on[at(i)]);
        if (is_open(i) && !executed_.covers(i, least)) return true;
    }
    return false;
}

// Where one is used again, what others cover on it are launches of old, which come before those
// that it will have.
int StreamGraph::find_or_add(StreamId stream, StreamKind kind) {
    int branch = find(stream);
    if (branch >= 0) return branch;
    if (num_branches_ < kMaxStreams) {
        branch = num_branches_++;
    } else {
        for (int i = 0; i < num_branches_ && branch < 0; ++i)
            if (i != current_ && !is_open(i) && !has_open(branches_[at(i)].covered)) branch = i;
        if (branch < 0) return -1;
    }
    Branch& b = branches_[at(branch)];
    b = {.stream = stream, .kind = kind, .last = b.last, .covered = {}};
    if (kind == StreamKind::kBlocking)
        for (int i = 0; i < num_branches_; ++i)
            if (branches_[at(i)].kind == StreamKind::kLegacy && branches_[at(i)].stream)
                b.covered.add(branches_[at(i)].covered);
    return branch;
}

// What is on blocking streams comes before what is next on the legacy one,
void StreamGraph::gather(Coverage& covered) const {
    for (int i = 0; i < num_branches_; ++i)
        if (branches_[at(i)].stream && branches_[at(i)].kind == StreamKind::kBlocking)
            covered.add(branches_[at(i)].covered);
}

// and what is on that before whatever is next on those.
void StreamGraph::spread(const Coverage& covered) {
    for (int i = 0; i < num_branches_; ++i)
        if (branches_[at(i)].stream && branches_[at(i)].kind == StreamKind::kBlocking)
            branches_[at(i)].covered.add(covered);
}

// All launches since the last time were on one stream.
void StreamGraph::settle(std::uint64_t launched) {
    if (launched == settled_) return;
    settled_ = launched;
    if (current_ < 0) return;
    Branch& b = branches_[at(current_)];
    b.last = b.covered.on[at(current_)] = launched;
    if (vouches_) b.covered.all = launched;
    if (b.kind == StreamKind::kLegacy && b.stream) spread(b.covered);
}

void StreamGraph::see_whether_it_vouches() {
    vouches_ = !is_lost_ && current_ >= 0 && covers_all(branches_[at(current_)].covered, settled_);
}

void StreamGraph::move_to(StreamId stream, StreamKind kind, std::uint64_t launched) {
    settle(launched);
    if (current() == stream) return;
    is_forked_ |= !executed_.covers_all(settled_);
    current_ = find_or_add(stream, kind);
    if (current_ < 0) {
        is_lost_ = true;
        vouches_ = false;
        return;
    }
    Branch& b = branches_[at(current_)];
    if (b.kind == StreamKind::kLegacy) gather(b.covered);
    see_whether_it_vouches();
}

void StreamGraph::waits_for(StreamId stream, StreamKind kind, const Coverage& covered,
                            std::uint64_t launched) {
    settle(launched);
    if (!has_open(covered)) return;
    is_forked_ |= current() != stream;
    const int branch = find_or_add(stream, kind);
    if (branch < 0) return;
    Branch& b = branches_[at(branch)];
    if (b.kind == StreamKind::kLegacy) gather(b.covered);
    b.covered.add(covered);
    if (b.kind == StreamKind::kLegacy) spread(b.covered);
    if (!vouches_) see_whether_it_vouches();
}

Coverage StreamGraph::covered_by(StreamId stream, StreamKind kind, std::uint64_t launched) {
    settle(launched);
    const int branch = find(stream);
    Coverage covered = branch >= 0 ? branches_[at(branch)].covered : Coverage{};
    if (kind == StreamKind::kLegacy) gather(covered);
    return covered;
}

bool StreamGraph::covers_all(const Coverage& covered, std::uint64_t launched) {
    settle(launched);
    if (covered.covers_all(launched)) return true;
    if (is_lost_) return false;
    for (int i = 0; i < num_branches_; ++i)
        if (is_open(i) && !covered.covers(i, branches_[at(i)].last)) return false;
    return true;
}

void StreamGraph::executed(const Coverage& covered, std::uint64_t launched) {
    settle(launched);
    executed_.add(covered);
    if (!covered.covers_all(launched)) {
        if (!vouches_) see_whether_it_vouches();
        return;
    }
    is_lost_ = is_forked_ = false;
    vouches_ = true;
}

// Its branch stays for as long as it has open work.
void StreamGraph::forget(StreamId stream, std::uint64_t launched) {
    settle(launched);
    const int branch = find(stream);
    if (branch < 0) return;
    branches_[at(branch)].stream = 0;
    branches_[at(branch)].covered = {};
    if (branch != current_) return;
    // A launch on a stream of the same handle is to be seen as a move.
    current_ = -1;
    vouches_ = false;
}

void StreamGraph::forget_streams(std::uint64_t launched) {
    for (int i = 0; i < num_branches_; ++i)
        if (branches_[at(i)].stream) forget(branches_[at(i)].stream, launched);
}

}  // namespace urgengo::progress
