// SPDX-License-Identifier: Apache-2.0
#include "interposer/driver_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <iterator>

#include "interposer/ld_cache.h"

namespace urgengo::interposer {
namespace {

constexpr const char* kSoname = "libcuda.so.1";

bool are_ours(const std::vector<DynamicSymbol>& symbols) {
    return std::any_of(symbols.begin(), symbols.end(),
                       [](const DynamicSymbol& s) { return s.name == "ug_status"; });
}

}  // namespace

std::vector<std::string> driver_candidates(const char* library_path) {
    std::vector<std::string> paths;
    if (library_path) {
        std::string_view rest = library_path;
        while (true) {
            const std::size_t end = rest.find_first_of(":;");
            const std::string_view folder = rest.substr(0, end);
            paths.push_back((folder.empty() ? "." : std::string(folder)) + "/" + kSoname);
            if (end == std::string_view::npos) break;
            rest.remove_prefix(end + 1);
        }
    }
    std::ifstream file("/etc/ld.so.cache", std::ios::binary);
    const std::string cache{std::istreambuf_iterator<char>(file), {}};
    for (std::string& path : find_in_ld_cache(cache, kSoname)) paths.push_back(std::move(path));
    for (const char* folder : {"/lib/x86_64-linux-gnu", "/usr/lib/x86_64-linux-gnu",
                               "/lib/aarch64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/lib64",
                               "/usr/lib64", "/lib", "/usr/lib", "/usr/lib/wsl/lib"})
        paths.push_back(std::string(folder) + "/" + kSoname);
    return paths;
}

MappedFile::MappedFile(const std::string& path) {
    const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) return;
    struct stat status;
    if (fstat(file, &status) == 0 && S_ISREG(status.st_mode) && status.st_size > 0) {
        const auto size = static_cast<std::size_t>(status.st_size);
        void* const start = mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file, 0);
        if (start != MAP_FAILED) bytes_ = {static_cast<const char*>(start), size};
    }
    close(file);
}

MappedFile::~MappedFile() {
    if (!bytes_.empty()) munmap(const_cast<char*>(bytes_.data()), bytes_.size());
}

bool is_urgengo(const std::string& path) {
    const MappedFile file(path);
    return are_ours(defined_symbols(file.bytes()));
}

std::string find_driver_file(const std::string& asked, const char* library_path) {
    if (!asked.empty()) return asked;
    for (std::string& path : driver_candidates(library_path)) {
        const MappedFile file(path);
        const auto symbols = defined_symbols(file.bytes());
        if (!symbols.empty() && !are_ours(symbols)) return std::move(path);
    }
    return {};
}

std::vector<std::uint64_t> places_in(std::string_view driver,
                                     const std::vector<std::string_view>& names) {
    std::vector<std::uint64_t> places(names.size(), 0);
    bool any = false;
    for (const DynamicSymbol& symbol : defined_symbols(driver)) {
        const auto name = std::lower_bound(names.begin(), names.end(), symbol.name);
        if (name == names.end() || *name != symbol.name) continue;
        places[static_cast<std::size_t>(name - names.begin())] = symbol.value;
        any = true;
    }
    if (!any) places.clear();
    return places;
}

}  // namespace urgengo::interposer
