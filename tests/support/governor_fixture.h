// SPDX-License-Identifier: Apache-2.0
//
// A Governor over a page of its own, without a driver: chains of one task each, whose slots and
// marks a test writes as the launching threads and the GPU would.
#pragma once

#include <memory>
#include <vector>

#include "host/sched/governor.h"

namespace urgengo::testing {

using namespace std::chrono_literals;
using std::chrono::nanoseconds;

class GovernorFixture final : sched::ProgressListener {
  public:
    static constexpr nanoseconds kStart{1'000'000'000};

    /// @param deadlines  of the chains, which are their periods, too
    explicit GovernorFixture(const std::vector<nanoseconds>& deadlines,
                             const config::Scheduler& scheduler = {})
        : lines_(deadlines.size()),
          governor(scheduler, configs_of(deadlines), config::Mode::kEnforce, *page, *this, kStart) {
        for (std::size_t i = 0; i < deadlines.size(); ++i) add(i, configs_of(deadlines)[i]);
    }

    sched::GovernedTask& task(int index) { return governor.tasks()[index]; }
    abi::TaskSlot& slot(int index) { return page->tasks[index]; }

    /// A bystander launches until it is seen to keep the GPU busy.
    void bystander_gets_busy() {
        for (int window = 0; window < 30; ++window) {
            governor.bystanders().launched();
            now += sched::Bystanders::kWindow;
            governor.look_for_bystanders(now);
        }
    }
    /// Frames of the chain come, a period apart, and launch at once.
    void frames_come(int index, int number = 3) {
        sched::GovernedChain& chain = *task(index).chain;
        for (int frame = 0; frame < number; ++frame) {
            now += chain.period();
            chain.expectation.arrived(now, chain.period());
            chain.expectation.launched(now, now);
        }
    }
    /// An instance of so much GPU work begins, and comes to the GPU.
    void begin(int index, nanoseconds gpu, double utilization = 1) {
        abi::TaskSlot& s = slot(index);
        s.deadline_ns = (now + task(index).chain->config.deadline).count();
        s.head_remaining_ns = gpu.count();
        s.head_utilization_ppm = static_cast<std::uint32_t>(utilization * 1e6);
        s.state = abi::TaskState::kGpu;
        s.look_ns = s.progress_ns = now.count();
        page->active[index / 64].fetch_or(std::uint64_t{1} << index % 64);
        governor.comes_to_gpu(task(index), now);
        task(index).run.on_gpu = true;
    }

    /// So much of it is launched, with a mark behind it.
    void launch(int index, nanoseconds gpu) {
        abi::TaskSlot& s = slot(index);
        sched::GovernedTask& t = task(index);
        t.work.launched += gpu;
        ++t.run.position;
        s.launched_ns = t.work.launched.count();
        s.head_remaining_ns = s.head_remaining_ns - gpu.count();
        s.launch_ns = s.look_ns = now.count();
        s.started = 1;
        mark(index);
    }
    void mark(int index) {
        abi::TaskSlot& s = slot(index);
        sched::GovernedTask& t = task(index);
        const std::uint32_t sequence = s.marks_issued + 1;
        s.launched_at_mark_ns[sequence % abi::kMarkRing] = t.work.launched.count();
        t.run.position_at_mark[sequence % abi::kMarkRing] = t.run.position;
        if (s.marks_done == sequence - 1) s.progress_ns = now.count();
        s.marks_issued = sequence;
        t.work.marks_all();
    }
    /// The GPU has executed all marks.
    void execute(int index) {
        const std::uint32_t last = slot(index).marks_issued;
        lines_[static_cast<std::size_t>(index)].word[0] = ug_mark_word0(0, 0, last);
        lines_[static_cast<std::size_t>(index)].word[1] = 123ull << 16 | (last & 0xffff);
    }

    sched::Answer ask(int index, nanoseconds next = 100us, const sched::Request& request = {}) {
        task(index).run.next = next;
        return governor.ask(task(index), request, now);
    }
    /// A launch that waits sleeps as it was told.
    void sleep(int index, const sched::Wait& wait) {
        slot(index).state = abi::TaskState::kHeld;
        governor.sleeps(task(index), wait);
        now += wait.sleep;
        governor.slept(task(index), wait, wait.sleep, now);
    }

    int num_progressed = 0;
    nanoseconds now = kStart + 1ms;
    const std::unique_ptr<abi::SharedPage> page = std::make_unique<abi::SharedPage>();

  private:
    static std::vector<config::Chain> configs_of(const std::vector<nanoseconds>& deadlines) {
        std::vector<config::Chain> chains(deadlines.size());
        for (std::size_t i = 0; i < deadlines.size(); ++i) {
            chains[i].period = chains[i].deadline = deadlines[i];
            chains[i].tasks.emplace_back();
        }
        return chains;
    }

    void progressed(sched::GovernedTask&, const sched::SlotView&, const ug_mark_line&,
                    nanoseconds) override {
        ++num_progressed;
    }

    void add(std::size_t i, const config::Chain& config) {
        auto& chain = *chains_.emplace_back(std::make_unique<sched::GovernedChain>());
        auto& t = *tasks_.emplace_back(std::make_unique<sched::GovernedTask>());
        chain.config = config;
        chain.index = i;
        chain.tasks = {static_cast<int>(i)};
        t.index = static_cast<int>(i);
        t.chain = &chain;
        t.slot = &page->tasks[i];
        t.slot->relative_deadline_ns = config.deadline.count();
        t.slot->period_ns = config.period.count();
        t.slot->criticality = 1;
        t.slot->static_rank = t.slot->chain = static_cast<std::uint32_t>(i);
        t.line = &lines_[i];
        t.views.reserve(lines_.size());
        t.run.priority.greatest = -5;
        governor.tasks().add(chain);
        governor.tasks().add(t);
    }

    std::vector<ug_mark_line> lines_;
    std::vector<std::unique_ptr<sched::GovernedChain>> chains_;
    std::vector<std::unique_ptr<sched::GovernedTask>> tasks_;

  public:
    sched::Governor governor;
};

}  // namespace urgengo::testing
