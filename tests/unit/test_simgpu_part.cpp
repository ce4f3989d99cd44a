// SPDX-License-Identifier: Apache-2.0
//
// The simulated part and its environment variables.
#include <cstdlib>

#include "tests/support/catch.h"
#include "tools/simgpu/engine/part.h"

using namespace urgengo::simgpu;

namespace {

class Variable {
  public:
    Variable(const char* name, const char* value) : name_(name) { setenv(name, value, 1); }
    ~Variable() { unsetenv(name_); }
    Variable(const Variable&) = delete;
    Variable& operator=(const Variable&) = delete;

  private:
    const char* name_;
};

}  // namespace

TEST_CASE("Part follows the environment when it is valid", "[unit][simgpu]") {
    const Variable sms("SIMGPU_SMS", "8");
    const Variable scale("SIMGPU_TIME_SCALE", "2.5");
    const Variable overhead("SIMGPU_LAUNCH_OVERHEAD_NS", "0");
    const Variable copies("SIMGPU_COPY_GBPS", "10");
    std::vector<std::string> problems;
    const Part part = read_part(problems);
    CHECK(problems.empty());
    CHECK(part.num_sms == 8);
    CHECK(part.scaled(1000) == Time{2500});
    CHECK(part.launch_overhead == Time{0});
    CHECK(part.copy_time(10000, part.copy_gbps) == Time{5000});  // (1000 + 1000) * 2.5
}

TEST_CASE("Part keeps the default and says why when a variable is refused", "[unit][simgpu]") {
    for (const char* bad : {"many", "0", "1.5", "8 SMs", "nan", "-3"}) {
        const Variable sms("SIMGPU_SMS", bad);
        std::vector<std::string> problems;
        CHECK(read_part(problems).num_sms == 46);
        REQUIRE(problems.size() == 1);
        CHECK(problems[0] == "SIMGPU_SMS: found '" + std::string(bad) +
                                 "', accepted: a whole number from 1 to 1024; using 46");
    }
}

TEST_CASE("Part makes no duration shorter than a nanosecond when scaled", "[unit][simgpu]") {
    Part part;
    part.time_scale = 0.001;
    CHECK(part.scaled(1) == Time{1});
}
