// SPDX-License-Identifier: Apache-2.0
#include "host/base/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <memory>

namespace urgengo {
namespace {

// Made at the first line and never destroyed: threads of the program may log while it exits. Kept
// out of spdlog's registry, which would be torn down then.
spdlog::logger& logger() {
    static auto* instance = [] {
        auto* l = new spdlog::logger("urgengo", std::make_shared<spdlog::sinks::stderr_sink_mt>());
        l->set_pattern("urgengo: %v");
        return l;
    }();
    return *instance;
}

}  // namespace

void log_line(std::string_view message) {
    logger().info("{}", message);
}

}  // namespace urgengo
