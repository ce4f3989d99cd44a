// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program/program_setup.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include "interposer/driver_file.h"
#include "tools/log/log.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/pruned_library.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

ProgramSetup failed(int exit_code, const std::string& message) {
    ProgramSetup setup;
    setup.exit_code = exit_code;
    setup.message = message;
    return setup;
}

std::vector<std::string> split(const std::string& list, const char* separators) {
    std::vector<std::string> parts;
    std::size_t start = 0;
    while (start <= list.size()) {
        const std::size_t end = std::min(list.find_first_of(separators, start), list.size());
        if (end > start) parts.push_back(list.substr(start, end - start));
        start = end + 1;
    }
    return parts;
}

std::vector<char*> pointers(std::vector<std::string>& texts) {
    std::vector<char*> list;
    for (std::string& text : texts) list.push_back(text.data());
    list.push_back(nullptr);
    return list;
}

/// The library to preload, with no name that the driver lacks, if that can be had.
std::string library_for(const ProgramSetup& setup, const Environment& environment,
                        std::vector<std::string>& warnings) {
    const auto library =
        library_without_missing_names(setup.interposer, setup.driver, cache_folder(environment));
    if (library) return *library;
    warnings.push_back(library.error() +
                       "; a program that needs what this driver lacks will start, and fail later");
    return setup.interposer;
}

}  // namespace

ProgramSetup set_up_program(const std::vector<std::string>& program,
                            const std::string& real_libcuda, const Environment& environment,
                            const std::string& chosen) {
    const auto interposer =
        chosen.empty() ? interposer_library() : Result<std::string>(absolute(chosen));
    if (!interposer) return failed(kExitUsage, interposer.error());
    const std::string wrong = why_not_preloadable_from(*interposer);
    if (!wrong.empty()) return failed(kExitUsage, wrong);
    const FoundProgram found = find_program(program.front(), value_of(environment, "PATH"));
    if (found.path.empty()) return failed(found.exit_code, found.message);
    const ProgramCheck check = check_program(found.path, program_user(environment));
    if (!check.refusal.empty()) return failed(kExitUsage, check.refusal);

    ProgramSetup setup;
    setup.path = found.path;
    setup.name = fs::path(found.path).filename().string();
    setup.interposer = *interposer;
    setup.warnings = check.warnings;
    setup.real_libcuda = choose_driver(real_libcuda, environment, check.driver, *interposer);
    const std::string search = value_of(environment, "LD_LIBRARY_PATH");
    setup.driver =
        interposer::find_driver_file(setup.real_libcuda, search.empty() ? nullptr : search.c_str());
    setup.interposer = library_for(setup, environment, setup.warnings);
    return setup;
}

ProgramUser program_user(const Environment& environment) {
    return {getuid(), getgid(), value_of(environment, "PATH"),
            split(value_of(environment, "LD_LIBRARY_PATH"), ":;")};
}

std::string why_not_preloadable_from(const std::string& interposer) {
    if (interposer.find_first_of(" :;") == std::string::npos) return {};
    return interposer +
           ": found a path with spaces, colons or semicolons, accepted: one that the loader can "
           "preload from";
}

std::string choose_driver(const std::string& asked, const Environment& environment,
                          const std::string& programs_own, const std::string& interposer) {
    if (!asked.empty()) return absolute(asked);
    const std::string set = value_of(environment, "URGENGO_REAL_LIBCUDA");
    std::error_code ignored;
    if (!set.empty() || fs::equivalent(programs_own, interposer, ignored)) return set;
    return absolute(programs_own);
}

std::string absolute(const std::string& path) {
    return path.empty() ? path : fs::absolute(path).lexically_normal().string();
}

std::string value_of(const Environment& environment, const std::string& name) {
    const auto entry = environment.find(name);
    return entry == environment.end() ? "" : entry->second;
}

void warn(const std::vector<std::string>& warnings) {
    for (const std::string& warning : warnings) {
        tools::log_warning("{}", warning);
    }
}

int become(const ProgramSetup& setup, std::vector<std::string> arguments,
           const Environment& environment) {
    std::vector<std::string> lines = to_lines(environment);
    // execvpe and not execve: it hands a script without "#!" to the shell, as execvp does.
    execvpe(setup.path.c_str(), pointers(arguments).data(), pointers(lines).data());
    const int error = errno;
    return fail(error == ENOENT ? kExitNotFound : kExitNotExecutable,
                setup.path + ": cannot be started: " + std::generic_category().message(error));
}

}  // namespace urgengo::cli
