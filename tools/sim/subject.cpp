// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/subject.h"

#include "host/config/presets.h"
#include "tools/sim/governed_subject.h"
#include "tools/sim/profiled.h"

namespace urgengo::sim {
namespace {

class Bare final : public Subject {
  public:
    LaunchAnswer launch(Place, nanoseconds) override { return {}; }
    int num_connections() const override { return kConnections; }
    std::string description() const override { return "not loaded"; }
};

}  // namespace

void Subject::connect(MarkPort&) {}
void Subject::connect_gates(GatePort&) {}
void Subject::bystander_launched(nanoseconds) {}
void Subject::arrived(int, nanoseconds, nanoseconds) {}
void Subject::task_begins(Place, nanoseconds, nanoseconds) {}
void Subject::launched(Place, nanoseconds) {}
void Subject::joined(Place, int, int, nanoseconds) {}
void Subject::wait_begins(Place, nanoseconds) {}
void Subject::task_ends(Place, nanoseconds) {}
void Subject::frame_ended(int, nanoseconds, nanoseconds) {}
void Subject::mark_ended(int, std::int64_t, nanoseconds) {}
void Subject::park_begins(nanoseconds) {}
void Subject::park_ends(nanoseconds) {}
void Subject::woken(int, nanoseconds) {}
std::optional<GateCounts> Subject::gate_counts() const {
    return std::nullopt;
}
bool Subject::exits(Place, nanoseconds, nanoseconds) {
    return false;
}

std::unique_ptr<Subject> make_bare() {
    return std::make_unique<Bare>();
}

Result<std::unique_ptr<Subject>> make_subject(const std::string& row,
                                              const chains::Workload& workload,
                                              const chains::Scenario& scenario) {
    if (row == "bare") return make_bare();
    const auto preset = config::preset(row);
    if (!preset)
        return Error{"row: found '" + row + "', accepted: bare, " + config::preset_names()};
    return std::unique_ptr<Subject>(std::make_unique<GovernedSubject>(
        configured(workload, scenario, *preset), profiled(workload)));
}

}  // namespace urgengo::sim
