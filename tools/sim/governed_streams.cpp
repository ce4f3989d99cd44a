// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/governed_streams.h"

namespace urgengo::sim::streams {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
/// What libraries make.
constexpr auto kKind = progress::StreamKind::kNonBlocking;

progress::StreamId id_of(int branch) {
    return static_cast<progress::StreamId>(branch) + 1;
}

}  // namespace

void begin_run(SimTask& task) {
    task.graph.executed({.all = task.launches_at_begin, .on = {}}, task.num_launches);
    task.launches_at_begin = task.num_launches;
}

void follow(SimTask& task, int branch) {
    task.has_moved = task.branch != branch;
    task.branch = branch;
    if (task.graph.current() != id_of(branch))
        task.graph.move_to(id_of(branch), kKind, task.num_launches);
}

void launched(SimTask& task) {
    ++task.num_launches;
}

void note_unmarked(SimTask& task, bool follows_marks, bool is_first, nanoseconds now) {
    std::atomic<std::int64_t>& until_ns = task.slot->unmarked_until_ns;
    if (!follows_marks || task.graph.vouches()) {
        if (until_ns.load(kRelaxed) == 0) return;
        task.unmarked = {};
    } else {
        const double factor = task.factor.value();
        const auto open = nanoseconds(static_cast<std::int64_t>(
            factor * static_cast<double>((task.launched - task.marked).count())));
        task.unmarked.launched(now, open, is_first);
    }
    until_ns.store(task.unmarked.until().count(), kRelaxed);
}

void joined(SimTask& task, int branch, int other) {
    const auto covered = task.graph.covered_by(id_of(other), kKind, task.num_launches);
    task.graph.waits_for(id_of(branch), kKind, covered, task.num_launches);
}

bool covers_all(SimTask& task, int branch) {
    if (!task.graph.is_forked()) return task.branch == branch;
    const auto covered = task.graph.covered_by(id_of(branch), kKind, task.num_launches);
    return task.graph.covers_all(covered, task.num_launches);
}

void waited(SimTask& task, int branch) {
    const auto covered = task.graph.covered_by(id_of(branch), kKind, task.num_launches);
    task.graph.executed(covered, task.num_launches);
}

bool vouches(const SimTask& task, bool follows_marks) {
    return follows_marks ? task.graph.vouches() : !task.has_moved;
}

}  // namespace urgengo::sim::streams
