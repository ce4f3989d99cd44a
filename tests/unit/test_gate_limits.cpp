// SPDX-License-Identifier: Apache-2.0
//
// How many tasks may have closed gates, and how many launches may be behind them.
#include <cstdlib>
#include <string>

#include "host/config/connections.h"
#include "host/config/dispatch_choice.h"
#include "host/sched/gate_groups.h"
#include "tests/support/gates_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

constexpr char kVariable[] = "CUDA_DEVICE_MAX_CONNECTIONS";

/// The process has so many connections for as long as the object lives; 0: the driver's default.
class Connections {
  public:
    explicit Connections(int number) {
        if (const char* const set = std::getenv(kVariable)) before_ = set;
        number > 0 ? setenv(kVariable, std::to_string(number).c_str(), 1) : unsetenv(kVariable);
    }
    ~Connections() {
        before_.empty() ? unsetenv(kVariable) : setenv(kVariable, before_.c_str(), 1);
    }
    Connections(const Connections&) = delete;
    Connections& operator=(const Connections&) = delete;

  private:
    std::string before_;
};

}  // namespace

TEST_CASE("Two connections are left for streams without gates", "[runtime][gates]") {
    const int connections = GENERATE(1, 2, 3, 4, 32, 0);
    const Connections set(connections);
    GatesFixture f;
    runtime::GateKeeper& keeper = f.common().gate_keeper;
    const int most = (connections > 0 ? connections : config::kDefaultConnections) - 2;
    for (int i = 0; i < most; ++i) CHECK(keeper.begins());
    CHECK_FALSE(keeper.begins());
    CHECK(keeper.counts().refused == 1);
    f.launch_on(f.thread_b, kStreamB);
    CHECK(GatesFixture::closed.empty());
    CHECK(f.clock.num_sleeps > 0);  // the launch has waited in its thread
    CHECK(keeper.counts().refused > 1);
    if (most <= 0) return;
    // As one of those that have closed gates.
    f.loose().gates.is_open = false;
    keeper.ends(f.loose(), f.clock.now());
    CHECK(keeper.begins());
    CHECK_FALSE(keeper.begins());
}

TEST_CASE("So many launches are behind closed gates at most; then the thread waits",
          "[runtime][gates]") {
    GatesFixture f;
    for (std::uint32_t i = 1; i <= 6; ++i) {
        f.launch_on(f.thread_b, kStreamB);
        CHECK(f.loose().gates.behind == i);
    }
    REQUIRE(f.is_closed());
    f.loose().gates.behind = sched::kMostBehindGates - 1;
    f.launch_on(f.thread_b, kStreamB);
    CHECK(f.loose().gates.behind == sched::kMostBehindGates);
    CHECK(f.clock.num_sleeps == 0);
    const std::size_t closed = GatesFixture::closed.size();
    f.clock.on_sleep = [&] { f.tight_ends(); };
    f.launch_on(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps > 0);
    CHECK(f.loose().run.waited.paced > 0us);
    CHECK_FALSE(f.is_closed());  // all of them, as its launch would overtake what is behind one
    CHECK(GatesFixture::closed.size() == closed);
}
