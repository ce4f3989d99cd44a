// SPDX-License-Identifier: Apache-2.0
#include "host/model/instance_tracker.h"

#include <algorithm>

namespace urgengo::model {

void InstanceTracker::begin(std::size_t segment, bool fits) {
    in_instance_ = true;
    segment_ = segment;
    total_ = 0;
    fits_ = fits;
}

InstanceTracker::Step InstanceTracker::launch(const KernelKey& key) {
    Step step = Step::kContinue;
    if (!planned()) {
        if (!in_instance_) {
            begin(0, true);
            step = Step::kBegin;
        }
    } else if (launches_ == 0) {
        const std::size_t expected = in_instance_ ? segment_ : 0;
        std::size_t best = expected;
        Fit best_fit = plan_->begins_segment(expected, key);
        // On equal terms the expected one, then the first: then any other.
        for (std::size_t s = 0; s < plan_->segments().size() && best_fit != Fit::kExact; ++s) {
            const Fit fit = plan_->begins_segment(s, key);
            if (fit > best_fit) {
                best = s;
                best_fit = fit;
            }
        }
        const bool as_planned = best == expected && best_fit != Fit::kNone;
        if (!in_instance_) {
            begin(best, as_planned);
            step = Step::kBegin;
            // Known by a later kernel of its first segment: those before it were taken for a
            // bystander's.
            const auto later = as_planned ? std::nullopt : plan_->find_near_begin(key);
            if (best == 0 && later) {
                fits_ = true;
                launches_ = static_cast<std::uint32_t>(*later);
                total_ = *later;
            }
        } else if (best < expected) {
            begin(best, best == 0);
            step = Step::kEndAndBegin;
        } else {
            segment_ = best;
            fits_ = fits_ && as_planned;
        }
    }
    ++launches_;
    ++total_;
    return step;
}

bool InstanceTracker::closed(std::string_view kind) {
    if (!in_instance_ || launches_ == 0) return false;
    const std::uint32_t launches = launches_;
    if (!planned()) {
        launches_ = 0;
        in_instance_ = false;
        return true;
    }
    const auto& segments = plan_->segments();
    const PlannedSegment& at_hand = segments[segment_];
    const bool seen = launches >= at_hand.min_launches && launches <= at_hand.max_launches;
    // Too early and of another kind, as when an allocator asks for its events: it closes nothing.
    if (launches < at_hand.min_launches && kind != at_hand.closed_by) return false;
    if (!seen) {
        fits_ = false;
        std::uint32_t made_up = at_hand.num_launches;
        while (made_up < launches && segment_ + 1 < segments.size())
            made_up += segments[++segment_].num_launches;
    }
    launches_ = 0;
    ++segment_;
    return end_if_past_last();
}

bool InstanceTracker::end_if_past_last() {
    if (segment_ < plan_->segments().size()) return false;
    in_instance_ = false;
    segment_ = 0;
    return true;
}

Fit InstanceTracker::expects(const KernelKey& key) const {
    if (!planned()) return Fit::kNone;
    if (launches_ > 0) return Fit::kExact;
    return plan_->begins_segment(in_instance_ ? segment_ : 0, key);
}

std::size_t InstanceTracker::position() const {
    if (!planned()) return total_;
    if (segment_ >= plan_->segments().size()) return plan_->num_kernels();
    const PlannedSegment& s = plan_->segments()[segment_];
    // More launches than planned stay at the segment's end.
    return s.begin + std::min(launches_, s.num_launches);
}

std::size_t InstanceTracker::segment_end() const {
    if (!planned() || segment_ >= plan_->segments().size()) return position();
    const PlannedSegment& s = plan_->segments()[segment_];
    return s.begin + s.num_launches;
}

}  // namespace urgengo::model
