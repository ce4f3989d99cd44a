// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program_check.h"

#include <elf.h>
#include <sys/stat.h>
#include <sys/xattr.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <fstream>

#include "tools/urgengo/exit_codes.h"

namespace urgengo::cli {
namespace {

enum class Candidate { kAbsent, kNotExecutable, kGood };

Candidate inspect(const std::string& path) {
    struct stat info {};
    if (stat(path.c_str(), &info) != 0) return Candidate::kAbsent;
    const bool runs = S_ISREG(info.st_mode) && access(path.c_str(), X_OK) == 0;
    return runs ? Candidate::kGood : Candidate::kNotExecutable;
}

FoundProgram not_executable(const std::string& path) {
    return {"", kExitNotExecutable, path + ": not an executable file"};
}

template <typename T>
bool read_at(std::ifstream& file, std::uint64_t offset, T& value) {
    file.seekg(static_cast<std::streamoff>(offset));
    file.read(reinterpret_cast<char*>(&value), sizeof value);
    return file.good();
}

bool has_interpreter(std::ifstream& file, const Elf64_Ehdr& header) {
    for (unsigned i = 0; i < header.e_phnum; ++i) {
        Elf64_Phdr segment{};
        if (!read_at(file, header.e_phoff + std::uint64_t{i} * header.e_phentsize, segment)) break;
        if (segment.p_type == PT_INTERP) return true;
    }
    return false;
}

/// Scripts and other things that exec knows how to start are fine: their interpreter is looked at
/// by the loader, not by us.
std::string why_elf_unsuitable(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    unsigned char ident[EI_NIDENT] = {};
    if (!read_at(file, 0, ident) || std::memcmp(ident, ELFMAG, SELFMAG) != 0) return {};
    if (ident[EI_CLASS] != ELFCLASS64) return "it is not a 64-bit program";
    Elf64_Ehdr header{};
    if (!read_at(file, 0, header)) return {};
    return has_interpreter(file, header) ? "" : "it is statically linked";
}

}  // namespace

FoundProgram find_program(const std::string& name, const std::string& search_path) {
    if (name.find('/') != std::string::npos) {
        switch (inspect(name)) {
            case Candidate::kGood:
                return {name, 0, ""};
            case Candidate::kNotExecutable:
                return not_executable(name);
            case Candidate::kAbsent:
                return {"", kExitNotFound, name + ": no such file"};
        }
    }
    FoundProgram found{"", kExitNotFound, name + ": no such program in $PATH"};
    std::size_t start = 0;
    while (!name.empty() && start <= search_path.size()) {
        const std::size_t end = std::min(search_path.find(':', start), search_path.size());
        const std::string folder = search_path.substr(start, end - start);
        start = end + 1;
        const std::string path = (folder.empty() ? "." : folder) + "/" + name;
        const Candidate candidate = inspect(path);
        if (candidate == Candidate::kGood) return {path, 0, ""};
        if (candidate == Candidate::kNotExecutable) found = not_executable(path);
    }
    return found;
}

std::string why_not_preloadable(const std::string& path, uid_t uid, gid_t gid) {
    struct stat info {};
    if (stat(path.c_str(), &info) != 0) return {};
    // The loader distrusts the environment only if the program gains rights that its user lacks.
    if ((info.st_mode & S_ISUID) && info.st_uid != uid) return "it is setuid";
    if ((info.st_mode & S_ISGID) && info.st_gid != gid) return "it is setgid";
    if (uid != 0 && getxattr(path.c_str(), "security.capability", nullptr, 0) > 0) {
        return "it has file capabilities";
    }
    return why_elf_unsuitable(path);
}

}  // namespace urgengo::cli
