// SPDX-License-Identifier: Apache-2.0
//
// The ends of batches (progress/batch_tracking.h), seen by events of ours.
#pragma once

#include <optional>

#include "host/exec/own_events.h"
#include "host/progress/batch_tracking.h"
#include "host/sched/governor.h"

namespace urgengo::exec {

/// Where the task launches, for as long as a batch is ended or waited for.
class BatchEvents final : public progress::BatchEnds {
  public:
    using Events = OwnEvents<2>;  ///< a task's; batches take turns

    /// @param context  the current one
    /// @param task     the caller has it
    BatchEvents(const DriverApi& driver, const sched::Governor& governor,
                const sched::GovernedTask& task, Events& events, const MarkContext* context,
                CUstream stream, StreamFlavor flavor)
        : driver_(driver),
          governor_(governor),
          task_(task),
          events_(events),
          context_(context),
          stream_(stream),
          flavor_(flavor) {}

    bool record(std::uint32_t batch) override {
        const CUevent event = event_of(batch);
        return event && record_event(driver_, event, stream_, flavor_);
    }
    Seen ask(std::uint32_t batch) override {
        if (!relaxed_) relaxed_.emplace(driver_);
        const CUresult result = driver_.cuEventQuery(event_of(batch));
        if (result == CUDA_ERROR_NOT_READY) return Seen::kNotYet;
        return result == CUDA_SUCCESS ? Seen::kYes : Seen::kRefused;
    }
    bool are_wanted() override {
        return governor_.acts() && task_.chain->may_act() && !task_.run.only_decides;
    }

  private:
    CUevent event_of(std::uint32_t batch) { return events_.at(driver_, context_, batch % 2); }

    const DriverApi& driver_;
    const sched::Governor& governor_;
    const sched::GovernedTask& task_;
    Events& events_;
    const MarkContext* const context_;
    const CUstream stream_;
    const StreamFlavor flavor_;
    std::optional<RelaxedCaptureMode> relaxed_;  ///< for all questions
};

}  // namespace urgengo::exec
