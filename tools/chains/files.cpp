// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/files.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <stdexcept>

#include <fmt/format.h>

#include "host/base/atomic_file.h"

namespace urgengo::chains {

namespace {

[[noreturn]] void fail(const char* what, const std::string& path) {
    const int error = errno;
    throw std::runtime_error(fmt::format("cannot {} {}: {}", what, path, std::strerror(error)));
}

}  // namespace

std::string read_file(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) fail("read", path);
    std::ostringstream content;
    content << file.rdbuf();
    if (file.bad()) fail("read", path);
    return content.str();
}

void check_writable(const std::string& path) {
    const std::string folder = std::filesystem::path(path).parent_path().string();
    if (access(folder.empty() ? "." : folder.c_str(), W_OK | X_OK) != 0) fail("write", path);
    if (std::filesystem::is_directory(path)) {
        errno = EISDIR;
        fail("write", path);
    }
}

void write_file(const std::string& path, const std::string& content) {
    if (const auto written = write_file_atomically(path, content); !written)
        throw std::runtime_error(written.error());
}

std::string parse_kernel_driver_version(const std::string& text) {
    // "NVRM version: NVIDIA UNIX x86_64 Kernel Module  580.159.04  ..."; the open module's line has
    // the architecture after the words instead. The first dotted number on the line is the version.
    static const std::regex pattern(R"(NVRM version:[^\n]*?\s(\d+\.\d+(\.\d+)?)\s)");
    std::smatch match;
    return std::regex_search(text, match, pattern) ? match[1].str() : "";
}

}  // namespace urgengo::chains
