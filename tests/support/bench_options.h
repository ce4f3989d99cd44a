// SPDX-License-Identifier: Apache-2.0
//
// What tests of urgengo bench plan with.
#pragma once

#include <unistd.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "host/config/config_reader.h"
#include "host/config/file_text.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/bench/smoke/bench_json.h"
#include "tools/bench/smoke/bench_noise.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_profile.h"
#include "tools/bench/smoke/bench_results.h"
#include "tools/bench/smoke/bench_runner.h"
#include "tools/bench/smoke/bench_table.h"
#include "tools/bench/smoke/bench_variant.h"
#include "tools/bench/smoke/level_yaml.h"
#include "tools/urgengo/program/run_process.h"

namespace urgengo::cli {

inline const BenchPaths kPaths{"/bin/urgengo", "/bin/chains", "/s/h.yaml", "/s/n.yaml",
                               "/t/w.json",    "/t",          "/sim"};

inline BenchOptions two_rows() {
    BenchOptions options;
    options.f_a = {0.9};
    options.seed = 5;
    options.rows = {"bare", "urgengo"};
    return options;
}

}  // namespace urgengo::cli
