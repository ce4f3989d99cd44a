// SPDX-License-Identifier: Apache-2.0
//
// The environment variables, as a process reads them.
#include "host/base/settings.h"

#include <unistd.h>

#include <cstdlib>

#include "tests/support/catch.h"

namespace urgengo {
namespace {

TEST_CASE("Settings put the process id where a file's name asks for it", "[unit][settings]") {
    setenv("URGENGO_STATS", "/tmp/%p/s.%p.json", 1);
    setenv("URGENGO_TRACE", "t%%p%q.ugtrace", 1);
    setenv("URGENGO_CONFIG", "/etc/%p.yaml", 1);
    const Settings settings = read_settings();
    for (const char* name : {"URGENGO_STATS", "URGENGO_TRACE", "URGENGO_CONFIG"}) unsetenv(name);
    const std::string pid = std::to_string(getpid());
    CHECK(settings.stats == "/tmp/" + pid + "/s." + pid + ".json");
    CHECK(settings.trace == "t%" + pid + "%q.ugtrace");
    CHECK(settings.config == "/etc/%p.yaml");  // is read, by all of them
}

}  // namespace
}  // namespace urgengo
