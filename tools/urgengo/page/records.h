// SPDX-License-Identifier: Apache-2.0
//
// The flight recorder of a process under UrgenGo (include/urgengo/abi/run_record.h), copied while
// the process runs, hangs, or after it was killed. The process is not asked.
#pragma once

#include <string>

#include "host/base/result.h"
#include "tools/urgengo/page/page_reader.h"

namespace urgengo::cli {

/// @returns the file's bytes, as tools/trace/run_reader.h reads them: what the process may have
///          overwritten meanwhile is marked
/// @errors there is none, or another user has put it there
Result<std::string> copy_records(const PageReading& page);

}  // namespace urgengo::cli
