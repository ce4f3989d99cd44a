// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program/pruned_library.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <system_error>
#include <vector>

#include "host/base/atomic_file.h"
#include "host/base/hash.h"
#include "interposer/driver_file.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

/// @returns sorted names cu... that our library exports and the driver lacks
std::vector<std::string> missing_names(std::string_view ours, std::string_view driver) {
    std::vector<std::string_view> names;
    for (const auto& symbol : interposer::defined_symbols(ours)) {
        if (symbol.name.starts_with("cu")) names.push_back(symbol.name);
    }
    std::sort(names.begin(), names.end());
    const auto places = interposer::places_in(driver, names);
    std::vector<std::string> missing;
    for (std::size_t i = 0; i < places.size(); ++i) {
        if (places[i] == 0) missing.emplace_back(names[i]);
    }
    return missing;
}

constexpr std::chrono::hours kUnusedFor{24 * 30};
constexpr char kLibrary[] = "libcuda.so.1";

/// @returns the name of a copy's folder
std::string folder_name(std::uint64_t contents) {
    return fmt::format("{:016x}", contents);
}

bool is_folder_of_a_copy(const fs::path& folder) {
    const std::string name = folder.filename().string();
    std::error_code ignored;
    return name.size() == folder_name(0).size() &&
           name.find_first_not_of("0123456789abcdef") == std::string::npos &&
           fs::is_regular_file(folder / kLibrary, ignored);
}

void note_use(const fs::path& folder) {
    std::error_code ignored;
    fs::last_write_time(folder, fs::file_time_type::clock::now(), ignored);
}

void remove_unused_copies(const fs::path& cache_folder) {
    std::error_code error;
    std::vector<fs::path> unused;
    for (fs::directory_iterator at(cache_folder, error), end; !error && at != end;
         at.increment(error)) {
        std::error_code unknown;
        const auto used = fs::last_write_time(at->path(), unknown);
        if (!unknown && is_folder_of_a_copy(at->path()) &&
            fs::file_time_type::clock::now() - used > kUnusedFor)
            unused.push_back(at->path());
    }
    for (const fs::path& folder : unused) fs::remove_all(folder, error);
}

}  // namespace

std::string cache_folder(const Environment& environment) {
    const auto absolute = [&](const char* name) {
        const auto found = environment.find(name);
        return found != environment.end() && found->second.starts_with('/') ? found->second : "";
    };
    if (const std::string cache = absolute("XDG_CACHE_HOME"); !cache.empty()) {
        return cache + "/urgengo";
    }
    const std::string home = absolute("HOME");
    return home.empty() ? home : home + "/.cache/urgengo";
}

std::size_t count_missing_names(const std::string& interposer, const std::string& driver) {
    const interposer::MappedFile ours(interposer), real(driver);
    return missing_names(ours.bytes(), real.bytes()).size();
}

bool lacks_name_of(const std::string& interposer, const std::string& driver,
                   std::string_view name) {
    const interposer::MappedFile ours(interposer), real(driver);
    return interposer::places_in(real.bytes(), {name})[0] != 0 &&
           interposer::places_in(ours.bytes(), {name})[0] == 0;
}

Result<std::string> library_without_missing_names(const std::string& interposer,
                                                  const std::string& driver,
                                                  const std::string& cache_folder) {
    if (driver.empty()) return interposer;
    const interposer::MappedFile ours(interposer), real(driver);
    const std::vector<std::string> missing = missing_names(ours.bytes(), real.bytes());
    if (missing.empty()) return interposer;

    if (cache_folder.empty()) return Error{"neither XDG_CACHE_HOME nor HOME is an absolute path"};
    if (cache_folder.find_first_of(" :;") != std::string::npos) {
        return Error{cache_folder +
                     ": the loader cannot preload from a path with spaces, colons or semicolons"};
    }
    const std::uint64_t contents =
        fnv1a64(fmt::format("{:x} {}", fnv1a64(ours.bytes()), fmt::join(missing, " ")));
    const fs::path folder = fs::path(cache_folder) / folder_name(contents);
    const std::string path = (folder / kLibrary).string();
    std::error_code error;
    if (fs::is_regular_file(path, error)) {
        note_use(folder);
        return path;
    }

    remove_unused_copies(cache_folder);
    fs::create_directories(folder, error);
    if (error) return Error{folder.string() + ": cannot be made: " + error.message()};
    // For programs that open the driver without the version, found by LD_LIBRARY_PATH.
    fs::create_symlink(kLibrary, folder / "libcuda.so", error);
    std::string copy{ours.bytes()};
    interposer::undefine(copy, missing);
    if (const auto written = write_file_atomically(path, copy); !written) {
        return Error{written.error()};
    }
    return path;
}

}  // namespace urgengo::cli
