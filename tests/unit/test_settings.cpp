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

TEST_CASE("Settings name the log after the program unless told otherwise", "[unit][settings]") {
    const std::string pid = std::to_string(getpid());
    CHECK(read_settings().log.detail == LogDetail::kOff);
    CHECK(read_settings().log.file == "urgengo-urgengo_unit_tests-" + pid + ".log");
    setenv("URGENGO_LOG", "debug", 1);
    setenv("URGENGO_LOG_FILE", "/tmp/%p.log", 1);
    CHECK(read_settings().log.detail == LogDetail::kDebug);
    CHECK(read_settings().log.file == "/tmp/" + pid + ".log");
    setenv("URGENGO_LOG", "all", 1);
    CHECK(read_settings().log.detail == LogDetail::kOff);
    CHECK(read_settings().wrong == "URGENGO_LOG: found 'all', accepted: off, info, debug");
    for (const char* name : {"URGENGO_LOG", "URGENGO_LOG_FILE"}) unsetenv(name);
}

TEST_CASE("Settings say which words URGENGO_NVTX accepts when they find another one",
          "[unit][settings]") {
    setenv("URGENGO_NVTX", "off", 1);
    CHECK(read_settings().nvtx.events == "off");
    setenv("URGENGO_NVTX", "no", 1);
    const Settings settings = read_settings();
    unsetenv("URGENGO_NVTX");
    CHECK(settings.nvtx.events == "");
    CHECK(settings.wrong == "URGENGO_NVTX: found 'no', accepted: auto, on, off");
}

TEST_CASE("Settings say how many events the flight recorder keeps, and what is no number",
          "[unit][settings]") {
    const auto with = [](const char* value) {
        setenv("URGENGO_FLIGHT_RECORDS", value, 1);
        const Settings settings = read_settings();
        unsetenv("URGENGO_FLIGHT_RECORDS");
        return settings;
    };
    CHECK(read_settings().records.flight == 4096);
    CHECK(with("0").records.flight == 0);
    CHECK(with("100000").records.flight == 100000);
    CHECK(with("99999999999").records.flight == 1u << 22);
    CHECK(with("many").records.flight == 4096);
    CHECK(with("many").wrong == "URGENGO_FLIGHT_RECORDS: found 'many', accepted: a number");
}

}  // namespace
}  // namespace urgengo
