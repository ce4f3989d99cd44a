// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program/program_check.h"

#include <elf.h>
#include <sys/stat.h>
#include <sys/xattr.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/program/elf_program.h"

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

#if defined(__x86_64__)
constexpr std::uint16_t kMachine = EM_X86_64;
#elif defined(__aarch64__)
constexpr std::uint16_t kMachine = EM_AARCH64;
#else
#error "the ELF machine of this architecture is not known"
#endif

constexpr char kSoname[] = "libcuda.so.1";
constexpr int kMaxScripts = 5;  // as many as the kernel follows
constexpr char kPreloadable[] =
    "accepted: a dynamically linked program for this machine, with no more rights than its user's "
    "(the loader lets UrgenGo into no other)";

ProgramCheck refuse(const std::string& path, const std::string& found,
                    const std::string& accepted) {
    return {path, path + ": found " + found + ", " + accepted, {}, ""};
}

/// What a script's first line says: the interpreter, and its argument. Empty if it is no script.
std::vector<std::string> interpreter_of(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    std::string line(2, '\0');
    if (!file.read(line.data(), 2) || line != "#!" || !std::getline(file, line)) return {};
    std::istringstream words(line);
    std::vector<std::string> list;
    for (std::string word; words >> word;) list.push_back(word);
    return list;
}

/// The program that `env` in a script's first line looks for.
std::string program_of_env(const std::vector<std::string>& line) {
    for (std::size_t i = 1; i < line.size(); ++i) {
        if (!line[i].starts_with("-") && line[i].find('=') == std::string::npos) return line[i];
    }
    return {};
}

/// @returns what is wrong with the program's rights or its kind; empty if nothing is
std::string why_not_preloadable(const std::string& path, const ElfProgram& elf, uid_t uid,
                                gid_t gid) {
    struct stat info {};
    if (stat(path.c_str(), &info) != 0) return {};
    // The loader distrusts the environment only if the program gains rights that its user lacks.
    if ((info.st_mode & S_ISUID) && info.st_uid != uid) return "a setuid program";
    if ((info.st_mode & S_ISGID) && info.st_gid != gid) return "a setgid program";
    if (uid != 0 && getxattr(path.c_str(), "security.capability", nullptr, 0) > 0) {
        return "a program with file capabilities";
    }
    if (!elf.is_64_bit) return "a program that is not 64-bit";
    if (!elf.is_little_endian || elf.machine != kMachine) return "a program for another processor";
    if (elf.loader.empty()) return "a statically linked program";
    const std::string loader = elf.loader.substr(elf.loader.rfind('/') + 1);
    if (!loader.starts_with("ld-linux")) {
        return "a program whose loader is not glibc's, but " + elf.loader;
    }
    return {};
}

/// The first of these folders that has a driver, for what the loader does not look for elsewhere.
std::string driver_in(const std::vector<std::string>& folders) {
    for (const std::string& folder : folders) {
        const std::string path = folder + "/" + kSoname;
        if (inspect(path) != Candidate::kAbsent) return path;
    }
    return {};
}

/// @returns the driver that the program names itself, by its path; empty if it leaves that to the
///          machine. With ours preloaded, its calls come to us, but we would look elsewhere.
std::string own_driver(const ElfProgram& elf, const std::vector<std::string>& library_path) {
    for (const std::string& library : elf.needed) {
        const std::size_t slash = library.rfind('/');
        if (slash != std::string::npos && library.substr(slash + 1).starts_with("libcuda.so")) {
            return library;
        }
    }
    if (elf.runpath.empty()) return driver_in(elf.rpath);
    return driver_in(library_path).empty() ? driver_in(elf.runpath) : "";
}

ProgramCheck check_elf(const std::string& path, const ElfProgram& elf, const ProgramUser& user) {
    const std::string wrong = why_not_preloadable(path, elf, user.uid, user.gid);
    if (!wrong.empty()) return refuse(path, wrong, kPreloadable);

    ProgramCheck check{path, "", {}, own_driver(elf, user.library_path)};
    // A warning and no more: the path may be one of several that it tries. (The name alone may
    // stand in the file as the end of the path.)
    for (const std::string& name : elf.driver_names) {
        if (name.front() != '/') continue;
        check.warnings.push_back(path + ": found the driver's path '" + name +
                                 "' in the program, accepted: " + kSoname +
                                 " opened by its name; calls made through the path are not seen");
    }
    return check;
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

ProgramCheck check_program(const std::string& path, const ProgramUser& user) {
    std::string file = path;
    for (int i = 0; i <= kMaxScripts; ++i) {
        if (const auto elf = read_elf_program(file)) return check_elf(file, *elf, user);
        const std::vector<std::string> line = interpreter_of(file);
        // Without "#!" it is for the shell; with neither, for the kernel to refuse.
        if (line.empty()) return {file, "", {}, ""};
        std::string next = line.front();
        if (next.substr(next.rfind('/') + 1) == "env") next = program_of_env(line);
        const FoundProgram found = find_program(next, user.search_path);
        if (found.path.empty()) {
            return refuse(file, "the interpreter '" + next + "'",
                          "accepted: a program that exists and can be executed");
        }
        file = found.path;
    }
    return refuse(path, "scripts interpreted by scripts",
                  "accepted: at most " + std::to_string(kMaxScripts));
}

}  // namespace urgengo::cli
