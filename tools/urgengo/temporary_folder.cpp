// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/temporary_folder.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>

namespace urgengo::cli {
namespace {

std::string variable(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}

}  // namespace

Result<std::unique_ptr<TemporaryFolder>> TemporaryFolder::make() {
    const std::string parent = variable("TMPDIR");
    std::string pattern = (parent.empty() ? "/tmp" : parent) + "/urgengo-XXXXXX";
    if (!mkdtemp(pattern.data())) {
        return Error{pattern + ": cannot be made: " + std::generic_category().message(errno)};
    }
    return std::unique_ptr<TemporaryFolder>(new TemporaryFolder(pattern));
}

TemporaryFolder::~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
}

Result<std::string> session_folder() {
    const std::string runtime = variable("XDG_RUNTIME_DIR");
    const std::string path =
        runtime.empty() ? "/tmp/urgengo-" + std::to_string(geteuid()) : runtime + "/urgengo";
    if (mkdir(path.c_str(), 0700) != 0 && errno != EEXIST) {
        return Error{path + ": cannot be made: " + std::generic_category().message(errno)};
    }
    // Another user may have made a folder, or a link, of that name in /tmp before us.
    struct stat info {};
    if (lstat(path.c_str(), &info) != 0 || !S_ISDIR(info.st_mode) || info.st_uid != geteuid() ||
        (info.st_mode & 077) != 0) {
        return Error{path + ": accepted: a folder of this user with mode 0700"};
    }
    return path;
}

}  // namespace urgengo::cli
