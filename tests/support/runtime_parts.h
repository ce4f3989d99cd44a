// SPDX-License-Identifier: Apache-2.0
//
// What the parts of the runtime are made around, in virtual time: chains and their tasks, who
// decides, the guard, a driver; and no Runtime.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "host/runtime/live_guard.h"
#include "host/runtime/task.h"
#include "host/runtime/thread_state.h"
#include "host/sched/governor.h"
#include "host/sched/instance_slot.h"
#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"

namespace urgengo::testing {

using namespace std::chrono_literals;

class RuntimeParts {
    struct Deaf final : sched::ProgressListener {
        void progressed(sched::GovernedTask&, const sched::SlotView&, const ug_mark_line&,
                        nanoseconds) override {}
    } deaf_;

  public:
    /// Two chains with a task each: `tight` (20 ms) and `loose` (100 ms); no profile.
    static config::Config two_chains() {
        config::Config config;
        for (const auto& [name, deadline] : {std::pair{"tight", 20ms}, std::pair{"loose", 100ms}}) {
            config::Chain chain;
            chain.name = name;
            chain.period = chain.deadline = deadline;
            chain.tasks = {{"detect", std::string("th_") + name}};
            config.chains.push_back(chain);
        }
        return config;
    }

    explicit RuntimeParts(const config::Config& config = two_chains())
        : guard(config),
          governor(config.scheduler, config.chains, config.mode, *page, deaf_, clock.now()) {
        for (const config::Chain& c : config.chains) {
            auto& chain = *chains.emplace_back(std::make_unique<identity::ChainState>());
            chain.config = c;
            chain.index = chains.size() - 1;
            chain.statistics.name = c.name;
            governor.tasks().add(chain);
            for (const config::Task& t : c.tasks) add_task(chain, t);
        }
        for (const auto& task : tasks) {
            sched::describe_chain(governor.tasks(), *task);
            task->views.reserve(tasks.size());
        }
        sched::rank_chains(governor.tasks());
    }

    runtime::TaskState& task(std::size_t index) { return *tasks[index]; }
    identity::ChainState& chain(std::size_t index) { return *chains[index]; }

    /// The task begins an instance that has just arrived.
    void begin(std::size_t index) {
        runtime::TaskState& t = task(index);
        governor.tasks().set_active(t, true);
        sched::begin_instance(governor.tasks(), t, clock.now() + t.chain->config.deadline, 0ms, 0ms,
                              clock.now());
    }

    FakeDriver driver;
    HookedClock clock;
    const std::unique_ptr<abi::SharedPage> page = std::make_unique<abi::SharedPage>();
    runtime::LiveGuard guard;
    sched::Governor governor;
    std::vector<std::unique_ptr<identity::ChainState>> chains;
    std::vector<std::unique_ptr<runtime::TaskState>> tasks;

  private:
    void add_task(identity::ChainState& chain, const config::Task& match) {
        auto& task = *tasks.emplace_back(std::make_unique<runtime::TaskState>());
        task.index = static_cast<int>(tasks.size()) - 1;
        task.chain = &chain;
        task.stage = chain.tasks.size();
        task.known_by.config = match;
        task.slot = &page->tasks[task.index];
        governor.tasks().add(task);
        sched::describe_task(task, 1);
        chain.tasks.push_back(task.index);
    }
};

}  // namespace urgengo::testing
