// SPDX-License-Identifier: Apache-2.0
//
// Every environment variable that UrgenGo reads, in one table (settings.cpp).
#pragma once

#include <cstdint>
#include <string>

#include "host/base/log_detail.h"

namespace urgengo {

struct SettingInfo {
    const char* name;
    const char* meaning;  ///< one line, as in docs/configuration.md
};

/// @returns the table, ended by an entry whose name is null
const SettingInfo* setting_table();

/// By what every kernel in a trace is timed.
enum class KernelTimes {
    kNone,   ///< 0
    kMarks,  ///< 1 or marks: by marks of our own around launches
    kCupti,  ///< cupti
    kAuto,   ///< auto: by CUPTI if that can be, else by marks
};

/// What the environment says, read once, when the first CUDA call comes in. In the names of files
/// %p has become the process id.
struct Settings {
    std::string config;        ///< URGENGO_CONFIG
    std::string mode;          ///< URGENGO_MODE: off | observe | enforce; empty: as in the config
    std::string real_libcuda;  ///< URGENGO_REAL_LIBCUDA
    std::string stats;         ///< URGENGO_STATS: where to write statistics (JSON) at exit
    bool summary = false;      ///< URGENGO_SUMMARY=1: a miss table on stderr at exit
    std::string trace;         ///< URGENGO_TRACE: trace to write; empty: none
    KernelTimes trace_kernels = KernelTimes::kNone;  ///< URGENGO_TRACE_KERNELS
    std::string cupti;  ///< URGENGO_CUPTI: a libcupti, if none is mapped already
    struct Share {
        std::string folder;         ///< URGENGO_SHARE: of the status page; empty: none
        bool is_asked_for = false;  ///< one of the two variables says so
        std::string group;          ///< URGENGO_SHARE_GROUP: may read it, and steer; empty: none
    } share;
    struct Log {
        LogDetail detail = LogDetail::kOff;  ///< URGENGO_LOG
        std::string file;                    ///< URGENGO_LOG_FILE
    } log;
    struct Nvtx {
        std::string events;  ///< URGENGO_NVTX: auto | on | off; empty: as in the config
        std::string tool;    ///< URGENGO_NVTX_TOOL: behind ours; empty: none
    } nvtx;
    struct Records {
        std::string trace;            ///< URGENGO_RUN_TRACE: of the run; empty: not written
        std::uint32_t flight = 4096;  ///< URGENGO_FLIGHT_RECORDS: of each thread; 0: none
    } records;
    bool new_names = false;        ///< URGENGO_NEW_NAMES: of a newer driver
    std::uint64_t test_holds = 0;  ///< URGENGO_TEST_HOLDS: seed of holds at random; 0: none
    std::string wrong;  ///< a variable whose value is not accepted, and what is: one line
};

Settings read_settings();

}  // namespace urgengo
