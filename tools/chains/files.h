// SPDX-License-Identifier: Apache-2.0
//
// Whole files, read and written; a file that is written appears complete or not at all.
#pragma once

#include <string>

namespace urgengo::chains {

/// @throws std::runtime_error naming the file and the system's reason
std::string read_file(const std::string& path);

/// To ask before a long run: whether write_file() would find its folder, and may write there.
/// @throws std::runtime_error as write_file()
void check_writable(const std::string& path);

/// Writes beside `path`, then renames.
/// @throws std::runtime_error naming the file and the system's reason
void write_file(const std::string& path, const std::string& content);

/// @returns the driver's version from the text of /proc/driver/nvidia/version, e.g. 580.159.04;
///          empty if there is none
std::string parse_kernel_driver_version(const std::string& text);

}  // namespace urgengo::chains
