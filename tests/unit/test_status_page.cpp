// SPDX-License-Identifier: Apache-2.0
#include "host/observe/status_page.h"

#include <fcntl.h>
#include <linux/filter.h>
#include <linux/magic.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/vfs.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstddef>
#include <fstream>
#include <thread>

#include "tests/support/status_pages.h"

using namespace urgengo;
using namespace urgengo::testing;
using observe::Liveness;
using observe::ShareOptions;
using observe::StatusPage;

namespace {

void write_word(const std::string& stem, std::uint32_t word) {
    std::fstream file(stem + observe::kControlSuffix,
                      std::ios::binary | std::ios::in | std::ios::out);
    file.seekp(offsetof(abi::ControlPage, word));
    file.write(reinterpret_cast<const char*>(&word), sizeof word);
}

}  // namespace

TEST_CASE("Status page tells of its process and its chains, and goes with it",
          "[observe][status_page]") {
    const MemoryFolder folder;
    std::string stem;
    {
        StatusPage page({folder.path().string(), ""}, two_chains(), 5s);
        REQUIRE(page.is_shared());
        CHECK(page.note() == "");
        stem = page.stem();
        REQUIRE(observe::list_pages(folder.path().string()) == std::vector<std::string>{stem});
        struct stat status {};
        for (const char* suffix : {observe::kPageSuffix, observe::kControlSuffix}) {
            REQUIRE(stat((stem + suffix).c_str(), &status) == 0);
            CHECK((status.st_mode & 07777) == 0600);
        }
        const abi::StatusHeader& header = page.header();
        CHECK(header.process == static_cast<std::uint32_t>(getpid()));
        CHECK(header.begin_ns == 5'000'000'000);
        CHECK(header.chains.count == 2);
        CHECK(header.tasks.count == 4);
        CHECK(std::string(page.chain(1).name) == "camera");
        CHECK(page.chain(1).first_task == 2);
        CHECK(std::string(page.task(3).name) == "track");
        CHECK(page.task(3).chain == 1);
        CHECK(reinterpret_cast<std::uintptr_t>(&page.akb()) % 4096 == 0);
        CHECK(page.akb().magic == abi::kSharedPageMagic);
        CHECK(observe::liveness_of(key_of(stem), stem) == Liveness::kThere);
    }
    CHECK(observe::list_pages(folder.path().string()).empty());
    CHECK(access((stem + observe::kControlSuffix).c_str(), F_OK) != 0);
}

TEST_CASE("Request says besides its word what was written there for this word",
          "[observe][status_page]") {
    const MemoryFolder folder;
    StatusPage page({folder.path().string(), ""}, two_chains(), 0s);
    const auto write = [&](std::uint32_t index, std::array<std::uint32_t, 2> request) {
        std::fstream file(page.stem() + observe::kControlSuffix,
                          std::ios::binary | std::ios::in | std::ios::out);
        file.seekp(offsetof(abi::ControlPage, requests) + index * sizeof(abi::ControlRequest));
        file.write(reinterpret_cast<const char*>(request.data()), sizeof request);
    };
    const std::uint32_t word = (abi::kControlRing + 5) << 8 | 16;
    CHECK_FALSE(page.control_request(word));
    write(5, {word, 1});
    const auto request = page.control_request(word);
    REQUIRE(request);
    CHECK(request->word == word);
    CHECK(request->chain == 1);
    write(5, {5 << 8 | 16, 1});  // a round of the ring before
    CHECK_FALSE(page.control_request(word));
}

TEST_CASE("Name that does not fit is cut off between characters", "[observe][status_page]") {
    config::Config config = two_chains();
    const std::string before(abi::kNameBytes - 2, 'a');
    config.chains[0].name = before + "\u00e4";
    config.chains[1].name = before + "ab";
    StatusPage page({}, config, 0s);
    CHECK(page.chain(0).name == before);
    CHECK(page.chain(1).name == before + "a");
}

TEST_CASE("Status page may be read and steered by a group when one is configured",
          "[observe][status_page]") {
    const MemoryFolder folder;
    const auto [group, found] = GENERATE(table<std::string, bool>(
        {{std::to_string(getgid()), true}, {"no such group at all", false}}));
    const StatusPage page({folder.path().string(), group}, two_chains(), 0s);
    CHECK(page.is_shared() == found);
    if (!found) {
        CHECK(page.note() == "no group 'no such group at all'");
        return;
    }
    struct stat status {};
    REQUIRE(stat((page.stem() + observe::kPageSuffix).c_str(), &status) == 0);
    CHECK((status.st_mode & 07777) == 0640);
    REQUIRE(stat((page.stem() + observe::kControlSuffix).c_str(), &status) == 0);
    CHECK((status.st_mode & 07777) == 0660);
    CHECK(status.st_gid == getgid());
}

TEST_CASE("Status page is private, and all else as it was, when its folder cannot be used",
          "[observe][status_page]") {
    const MemoryFolder folder;
    SECTION("there is none") {
        StatusPage page({folder.path("missing"), ""}, two_chains(), 0s);
        CHECK_FALSE(page.is_shared());
        CHECK(page.note().find("No such file") != std::string::npos);
        page.akb().tasks[255].head_idle_ns = 7;
        CHECK_FALSE(page.control_word());
        CHECK_FALSE(page.wait_for_control(0));
    }
    SECTION("it is on a disk: launches must not wait for that, nor end where it is full") {
        const Folder disk(std::filesystem::current_path());
        struct statfs system {};
        REQUIRE(statfs(disk.path().c_str(), &system) == 0);
        if (system.f_type == TMPFS_MAGIC || system.f_type == RAMFS_MAGIC) return;
        const StatusPage page({disk.path().string(), ""}, two_chains(), 0s);
        CHECK_FALSE(page.is_shared());
        CHECK(page.note() == disk.path().string() + ": is on a disk, accepted: in memory (tmpfs)");
        CHECK(std::filesystem::is_empty(disk.path()));
    }
    SECTION("nobody asked for it") {
        StatusPage page({}, two_chains(), 0s);
        CHECK_FALSE(page.is_shared());
        CHECK(page.note() == "");
        CHECK(std::string(page.chain(0).name) == "lidar");
    }
    SECTION("files may not be that large: no SIGXFSZ") {
        const int status = in_child([&] {
            const rlimit limit{4096, 4096};
            setrlimit(RLIMIT_FSIZE, &limit);
            const StatusPage page({folder.path().string(), ""}, two_chains(), 0s);
            return page.is_shared() ? 1 : 0;
        });
        CHECK(status == 0);
    }
    CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("Forked child leaves its parent's page alone", "[observe][status_page]") {
    const MemoryFolder folder;
    StatusPage page({folder.path().string(), ""}, two_chains(), 0s);
    CHECK(in_child([&] {
              page.retire();
              return 0;
          }) == 0);
    CHECK(page.header().is_over == 0);
    CHECK(observe::list_pages(folder.path().string()).size() == 1);
}

TEST_CASE("Control word is read as it stands, and nothing ends the program when the file is cut",
          "[observe][status_page]") {
    const MemoryFolder folder;
    const StatusPage page({folder.path().string(), ""}, two_chains(), 0s);
    CHECK(page.control_word() == 0u);
    CHECK(page.wait_for_control(1));  // is another already
    const std::uint32_t word = abi::next_control_word(0, abi::ControlCommand::kObserve);
    write_word(page.stem(), word);
    CHECK(page.control_word() == word);
    CHECK(abi::command_of(*page.control_word()) == abi::ControlCommand::kObserve);
    REQUIRE(truncate((page.stem() + observe::kControlSuffix).c_str(), 0) == 0);
    CHECK_FALSE(page.control_word());
    CHECK_FALSE(page.wait_for_control(word));
}

namespace {

/// As in a sandbox that forbids to look into processes. @returns whether that could be had
bool forbid_process_vm_readv() {
    sock_filter steps[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_process_vm_readv, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    sock_fprog filter{std::size(steps), steps};
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
           prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) == 0;
}

}  // namespace

TEST_CASE("Control word is read where a sandbox forbids it, and a file that is cut ends nothing",
          "[observe][status_page]") {
    const MemoryFolder folder;
    constexpr int kMayNot = 7;
    const int status = in_child([&] {
        const StatusPage page({folder.path().string(), ""}, two_chains(), 0s);
        const std::string control = page.stem() + observe::kControlSuffix;
        const std::uint32_t word = abi::next_control_word(0, abi::ControlCommand::kObserve);
        write_word(page.stem(), word);
        if (!forbid_process_vm_readv()) return kMayNot;
        if (page.control_word() != word) return 1;
        if (truncate(control.c_str(), 0) != 0 || page.control_word()) return 2;
        // Nor is another's file taken for it.
        if (unlink(control.c_str()) != 0 || page.control_word()) return 3;
        std::ofstream(control) << std::string(sizeof(abi::ControlPage), 'x');
        return page.control_word() ? 4 : 0;
    });
    if (WIFEXITED(status) && WEXITSTATUS(status) == kMayNot) return;
    CHECK(status == 0);
}
