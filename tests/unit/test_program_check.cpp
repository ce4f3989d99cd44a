// SPDX-License-Identifier: Apache-2.0
//
// Which programs the loader lets us into: judged by ELF files and scripts made here.
#include "tools/urgengo/program/program_check.h"

#include <elf.h>
#include <unistd.h>

#include <string>

#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/urgengo/program/elf_program.h"

namespace urgengo::cli {
namespace {

using testing::Folder;

#if defined(__x86_64__)
constexpr std::uint16_t kMachine = EM_X86_64, kOtherMachine = EM_AARCH64;
#else
constexpr std::uint16_t kMachine = EM_AARCH64, kOtherMachine = EM_X86_64;
#endif

constexpr char kAccepted[] =
    ", accepted: a dynamically linked program for this machine, with no more rights than its "
    "user's (the loader lets UrgenGo into no other)";

/// What a made-up ELF file says.
struct Elf {
    unsigned char elf_class = ELFCLASS64;
    std::uint16_t machine = kMachine;
    std::string loader = "/lib64/ld-linux-x86-64.so.2";  ///< empty: none
    std::vector<std::pair<std::int64_t, std::string>> dynamic{};
    std::string text{};  ///< stands in the file, between zero bytes

    std::string bytes() const;
};

template <typename T>
void append(std::string& bytes, const T& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Header, three program headers, the loader's name, the strings, the dynamic entries, the text.
/// Mapped 4 KiB behind its place in the file, so that addresses and offsets differ.
std::string Elf::bytes() const {
    constexpr std::uint64_t kAddress = 4096;
    const std::uint64_t loader_at = sizeof(Elf64_Ehdr) + 3 * sizeof(Elf64_Phdr);
    const std::uint64_t strings_at = loader_at + loader.size() + 1;
    std::string strings(1, '\0'), entries;
    for (const auto& [tag, value] : dynamic) {
        append(entries, Elf64_Dyn{tag, {strings.size()}});
        strings += value + '\0';
    }
    append(entries, Elf64_Dyn{DT_STRTAB, {kAddress + strings_at}});
    append(entries, Elf64_Dyn{DT_NULL, {0}});
    const std::uint64_t dynamic_at = strings_at + strings.size();

    Elf64_Ehdr header{};
    std::copy_n(ELFMAG, SELFMAG, header.e_ident);
    header.e_ident[EI_CLASS] = elf_class;
    header.e_ident[EI_DATA] = ELFDATA2LSB;
    header.e_type = ET_DYN;
    header.e_machine = machine;
    header.e_phoff = sizeof header;
    header.e_phentsize = sizeof(Elf64_Phdr);
    header.e_phnum = 3;
    const auto segment = [](std::uint32_t type, std::uint64_t at, std::uint64_t size) {
        Elf64_Phdr s{};
        s.p_type = type;
        s.p_offset = at;
        s.p_vaddr = kAddress + at;
        s.p_filesz = size;
        return s;
    };
    std::string file;
    append(file, header);
    append(file, segment(PT_LOAD, 0, dynamic_at + entries.size()));
    append(file, segment(loader.empty() ? PT_NOTE : PT_INTERP, loader_at, loader.size() + 1));
    append(file, segment(PT_DYNAMIC, dynamic_at, entries.size()));
    return file + loader + '\0' + strings + entries + '\0' + text + '\0';
}

ProgramUser this_user() {
    return {getuid(), getgid(), "/usr/bin:/bin", {}};
}

TEST_CASE("Program is refused when the loader would not let us in", "[unit][cli]") {
    const Folder folder;
    const auto refusal = [&](const Elf& elf) {
        return check_program(folder.write("program", elf.bytes()), this_user()).refusal;
    };
    const auto found = [&](const std::string& what) {
        return folder.path("program") + ": found " + what + kAccepted;
    };
    CHECK(refusal({}).empty());
    CHECK(refusal({.loader = "/nix/store/x/ld-linux-aarch64.so.1"}).empty());
    CHECK(refusal({.loader = ""}) == found("a statically linked program"));
    CHECK(refusal({.elf_class = ELFCLASS32}) == found("a program that is not 64-bit"));
    CHECK(refusal({.machine = kOtherMachine}) == found("a program for another processor"));
    CHECK(refusal({.loader = "/lib/ld-musl-x86_64.so.1"}) ==
          found("a program whose loader is not glibc's, but /lib/ld-musl-x86_64.so.1"));
    CHECK(check_program("/bin/sh", this_user()).refusal.empty());
}

TEST_CASE("Program is refused when it would gain rights that its user lacks", "[unit][cli]") {
    const Folder folder;
    ProgramUser other = this_user();
    ++other.uid;
    ++other.gid;
    const std::string setuid = folder.write("setuid", Elf{}.bytes(), 04755);
    CHECK(check_program(setuid, this_user()).refusal.empty());  // gains nothing
    CHECK(check_program(setuid, other).refusal == setuid + ": found a setuid program" + kAccepted);
    const std::string setgid = folder.write("setgid", Elf{}.bytes(), 02755);
    CHECK(check_program(setgid, this_user()).refusal.empty());
    CHECK(check_program(setgid, other).refusal == setgid + ": found a setgid program" + kAccepted);
}

TEST_CASE("Script is judged by its interpreter when the loader will see that one", "[unit][cli]") {
    const Folder folder;
    const std::string program = folder.write("static", Elf{.loader = ""}.bytes());
    const std::string direct = folder.write("direct", "#!" + program + "\n");
    const std::string spaced = folder.write("spaced", "#! " + program + " -u\n");
    const std::string nested = folder.write("nested", "#!" + direct + "\n");
    const std::string by_env = folder.write("by_env", "#!/usr/bin/env -S A=b static -u\n");
    ProgramUser user = this_user();
    user.search_path = folder.path().string();
    for (const std::string& script : {direct, spaced, nested, by_env}) {
        CHECK(check_program(script, user).refusal ==
              program + ": found a statically linked program" + kAccepted);
    }
    // Rights of a script are ignored by the kernel; what has no first line is for the shell.
    const std::string setuid = folder.write("setuid", "#!/bin/sh\n", 04755);
    ++user.uid;
    CHECK(check_program(setuid, user).refusal.empty());
    CHECK(check_program(setuid, user).file == "/bin/sh");
    CHECK(check_program(folder.write("plain", "echo\n"), user).refusal.empty());
    CHECK(check_program(folder.write("empty", ""), user).refusal.empty());

    const std::string lost = folder.write("lost", "#!/nonexistent/python\n");
    CHECK(check_program(lost, user).refusal ==
          lost +
              ": found the interpreter '/nonexistent/python', accepted: a program that exists "
              "and can be executed");
    const std::string bare = folder.write("bare", "#!\n");
    CHECK(check_program(bare, user).refusal.empty());
    const std::string loop = folder.write("loop", "#!" + folder.path("loop") + "\n");
    CHECK(check_program(loop, user).refusal ==
          loop + ": found scripts interpreted by scripts, accepted: at most 5");
}

TEST_CASE("Driver that a program names by itself is found when it is in the file", "[unit][cli]") {
    const Folder folder;
    const std::string beside = folder.write("deps/libcuda.so.1", "");
    const std::string other = folder.write("other/libcuda.so.1", "");
    const auto driver = [&](const Elf& elf, std::vector<std::string> library_path = {}) {
        ProgramUser user = this_user();
        user.library_path = std::move(library_path);
        return check_program(folder.write("program", elf.bytes()), user).driver;
    };
    const std::string in_other = folder.path("other"), in_none = folder.path("none");
    CHECK(driver({.dynamic = {{DT_NEEDED, "libcuda.so.1"}}}).empty());
    CHECK(driver({.dynamic = {{DT_NEEDED, "/opt/x/libcuda.so"}}}) == "/opt/x/libcuda.so");
    CHECK(driver({.dynamic = {{DT_RPATH, in_none + "::$ORIGIN/deps"}}}) == beside);
    CHECK(driver({.dynamic = {{DT_RPATH, "${ORIGIN}/deps"}}}, {in_other}) == beside);
    CHECK(driver({.dynamic = {{DT_RUNPATH, "$ORIGIN/deps"}}}) == beside);
    CHECK(driver({.dynamic = {{DT_RUNPATH, "$ORIGIN/deps"}}}, {in_other}).empty());
    CHECK(driver({.dynamic = {{DT_RPATH, in_other}, {DT_RUNPATH, in_none}}}).empty());
}

TEST_CASE("Program is warned of when it may open the driver past us", "[unit][cli]") {
    const Folder folder;
    const auto warnings = [&](const Elf& elf) {
        return check_program(folder.write("program", elf.bytes()), this_user()).warnings;
    };
    CHECK(warnings({.text = "libcuda.so.1"}).empty());
    CHECK(warnings({.text = "/opt/mylibcuda.so.1"}).empty());
    CHECK(warnings({.text = "/opt/libcuda.so.1.bak"}).empty());
    CHECK(warnings({.text = "/opt/libcudart.so.12"}).empty());
    CHECK(warnings({.dynamic = {{DT_NEEDED, "/opt/x/libcuda.so.1"}}}).empty());
    const auto one = warnings({.text = "/usr/lib/libcuda.so.1"});
    REQUIRE(one.size() == 1);
    CHECK(one[0] == folder.path("program") +
                        ": found the driver's path '/usr/lib/libcuda.so.1' in the program, "
                        "accepted: libcuda.so.1 opened by its name; calls made through the path "
                        "are not seen");
    const std::string two = std::string("libcuda.so.1") + '\0' + "/a/libcuda.so" + '\0' +
                            "/a/libcuda.so" + '\0' + "/b/libcuda.so.1";
    CHECK(warnings({.text = two}).size() == 2);
}

TEST_CASE("ELF reader gives what it can when a file is cut or garbled", "[unit][cli]") {
    const Folder folder;
    const std::string whole =
        Elf{.dynamic = {{DT_NEEDED, "libcuda.so.1"}, {DT_RPATH, "/x"}}, .text = "libcuda.so"}
            .bytes();
    for (std::size_t length = 0; length < whole.size(); ++length) {
        (void)read_elf_program(folder.write("cut", whole.substr(0, length)));
    }
    for (std::size_t i = 0; i < whole.size(); ++i) {
        for (const char c : {'\0', '\xff', '\x7f'}) {
            std::string garbled = whole;
            garbled[i] = c;
            (void)read_elf_program(folder.write("garbled", garbled));
        }
    }
    CHECK_FALSE(read_elf_program(folder.path().string()));
    CHECK_FALSE(read_elf_program("/nonexistent"));
    const auto elf = read_elf_program(folder.write("whole", whole));
    REQUIRE(elf);
    CHECK(elf->needed == std::vector<std::string>{"libcuda.so.1"});
    CHECK(elf->rpath == std::vector<std::string>{"/x"});
    CHECK(elf->driver_names == std::vector<std::string>{"libcuda.so"});
}

TEST_CASE("Program is found as a shell finds it when it is named", "[unit][cli]") {
    const Folder folder;
    const std::string tool = folder.write("tool", "#!/bin/sh\n", 0755);
    const std::string text = folder.write("text", "", 0644);
    CHECK(find_program(tool, "").path == tool);
    CHECK(find_program("tool", "/nonexistent:" + folder.path().string()).path == tool);
    CHECK(find_program("tool", "/nonexistent").exit_code == 127);
    CHECK(find_program("tool", "/nonexistent").message == "tool: no such program in $PATH");
    CHECK(find_program(folder.path("none"), "").exit_code == 127);
    CHECK(find_program(text, "").exit_code == 126);
    CHECK(find_program("text", folder.path().string()).message ==
          text + ": not an executable file");
    CHECK(find_program(folder.path().string(), "").exit_code == 126);
    CHECK(find_program("", "/bin").exit_code == 127);
}

}  // namespace
}  // namespace urgengo::cli
