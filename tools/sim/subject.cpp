// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/subject.h"

#include <vector>

namespace urgengo::sim {
namespace {

/// Where UrgenGo schedules more than a few tasks (host/config/connections.h). Without it the driver
/// has eight; but the ten chains, bare on an H200, show no stream that waits for another one's
/// queue (2026-11-22_h200_presets_seeds_4_5_6.json: with eight in the model C0 takes 1.4 times as
/// long at f_a 1.3 as there, C9 0.9 times; with ten all are within a tenth).
constexpr int kConnections = 32;

class Bare final : public Subject {
  public:
    LaunchAnswer launch(Place, nanoseconds) override { return {}; }
    int num_connections() const override { return kConnections; }
    std::string description() const override { return "not loaded"; }
};

/// Intercepts and schedules nothing, but tells a program to end frames that cannot be met.
class Vanilla final : public Subject {
  public:
    Vanilla(const chains::Workload& workload, const chains::Scenario& scenario) {
        for (const chains::Chain& chain : workload.chains) {
            std::vector<nanoseconds> latest(chain.tasks.size());
            double left_ms = 0;
            for (std::size_t i = chain.tasks.size(); i-- > 0;) {
                left_ms += chain.tasks[i].cpu_ms + chain.tasks[i].isolated_ms;
                const double latest_ms = scenario.deadline_ms(chain) - left_ms;
                latest[i] = scenario.deadlines
                                ? nanoseconds(static_cast<std::int64_t>(latest_ms * 1e6))
                                : kNever;
            }
            latest_.push_back(std::move(latest));
        }
    }
    bool exits(Place at, nanoseconds arrival, nanoseconds now) override {
        return now - arrival >
               latest_[static_cast<std::size_t>(at.chain)][static_cast<std::size_t>(at.task)];
    }
    LaunchAnswer launch(Place, nanoseconds) override { return {}; }
    int num_connections() const override { return kConnections; }
    std::string description() const override { return "scheduling"; }

  private:
    std::vector<std::vector<nanoseconds>> latest_;  ///< after its arrival may a task begin
};

}  // namespace

void Subject::arrived(int, nanoseconds, nanoseconds) {}
void Subject::task_begins(Place, nanoseconds, nanoseconds) {}
void Subject::launched(Place, nanoseconds) {}
void Subject::wait_begins(Place, nanoseconds) {}
void Subject::task_ends(Place, nanoseconds) {}
void Subject::frame_ended(int, nanoseconds, nanoseconds) {}
void Subject::mark_ended(int, std::int64_t, nanoseconds) {}
bool Subject::exits(Place, nanoseconds, nanoseconds) {
    return false;
}

Result<std::unique_ptr<Subject>> make_subject(const std::string& row,
                                              const chains::Workload& workload,
                                              const chains::Scenario& scenario) {
    if (row == "bare") return std::unique_ptr<Subject>(std::make_unique<Bare>());
    if (row == "vanilla")
        return std::unique_ptr<Subject>(std::make_unique<Vanilla>(workload, scenario));
    return Error{"--rows: found '" + row + "', accepted: bare, vanilla"};
}

}  // namespace urgengo::sim
