// SPDX-License-Identifier: Apache-2.0
//
// Where in its plan a task is, told from its launches and waits alone, and so where its instances
// begin and end where no hint says so.
//
// A plan is a row of segments; each begins with a known kernel, has a known number of launches, and
// is closed by a wait. The tracker walks along it:
//
//   launch  in an open segment: the next position of it.
//           with none open: opens the next segment if the kernel fits its begin; if the first
//           segment fits better, the instance had ended already (a frame that skipped its last
//           segments); if another one does, segments were skipped.
//   closed  (a wait for all that was launched): if the number of launches is one that the profile
//           has seen, the segment is done; after the last one, the instance. If it is not: too few,
//           and not the kind of wait that closes this segment: the segment goes on. Too many:
//           the segments that they make up are done. Else the segment is done all the same.
//
// So a count that does not fit never shifts what comes after: every begin is checked against the
// first kernel. Whatever did not fit is told by fits(), for the task's confidence. Without segments
// in the plan, an instance is what is launched up to a wait for it.
//
// Owner thread only.
#pragma once

#include <string_view>

#include "host/model/task_plan.h"

namespace urgengo::model {

class InstanceTracker {
  public:
    enum class Step { kContinue, kBegin, kEndAndBegin };

    InstanceTracker() = default;
    explicit InstanceTracker(const TaskPlan& plan) : plan_(&plan) {}

    /// A launch is about to happen.
    /// @returns whether a new instance begins with it, or even the last one had ended before
    Step launch(const KernelKey& key);

    /// So many launches more in the segment at hand, each the one that the plan has there.
    void advance(std::uint32_t launches) {
        launches_ += launches;
        total_ += launches;
    }

    /// A wait of this kind (SegmentProfile::closed_by) for all that was launched has ended.
    /// @returns whether the instance ended with it
    bool closed(std::string_view kind);

    /// @returns how well the kernel fits what the tracker expects next
    Fit expects(const KernelKey& key) const;

    bool in_instance() const { return in_instance_; }
    bool in_segment() const { return launches_ > 0; }
    /// Position in the plan of the next launch.
    std::size_t position() const;
    /// Position behind the segment at hand; position() if nothing is planned there.
    std::size_t segment_end() const;
    /// The one at hand, or the next one; 0 without segments in the plan.
    std::size_t segment() const { return segment_; }
    /// Whether everything since the instance's begin was as planned.
    bool fits() const { return fits_; }

  private:
    bool planned() const { return plan_ && !plan_->segments().empty(); }
    void begin(std::size_t segment, bool fits);
    bool end_if_past_last();

    const TaskPlan* plan_ = nullptr;
    std::size_t segment_ = 0;     // at hand, or the next one
    std::uint32_t launches_ = 0;  // in the segment at hand
    std::size_t total_ = 0;       // in the instance
    bool in_instance_ = false;
    bool fits_ = true;
};

}  // namespace urgengo::model
