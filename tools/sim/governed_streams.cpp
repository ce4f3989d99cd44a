// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/governed_streams.h"

namespace urgengo::sim::streams {
namespace {

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
