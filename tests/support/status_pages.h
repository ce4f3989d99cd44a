// SPDX-License-Identifier: Apache-2.0
//
// Status pages of this process and of children, as files.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <functional>
#include <string>

#include "host/observe/status_page.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tests/support/lidar_and_camera.h"

namespace urgengo::testing {

using namespace std::chrono_literals;

inline config::Config two_chains() {
    return lidar_and_camera(80ms, 80ms, {{"detect", ""}, {"track", ""}});
}

inline observe::ProcessKey key_of(const std::string& stem) {
    std::ifstream file(stem + observe::kPageSuffix, std::ios::binary);
    abi::StatusHeader header;
    file.read(reinterpret_cast<char*>(&header), sizeof header);
    return {header.process, header.start_ticks, header.pid_namespace, header.boot_id};
}

/// Does it in a child, which ends at once and runs no handler of exit.
inline int in_child(const std::function<int()>& act) {
    const pid_t child = fork();
    if (child == 0) _exit(act());
    int status = 0;
    REQUIRE(waitpid(child, &status, 0) == child);
    return status;
}

}  // namespace urgengo::testing
