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

#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tests/support/lidar_and_camera.h"

using namespace urgengo;
using namespace std::chrono_literals;
using observe::Liveness;
using observe::ShareOptions;
using observe::StatusPage;
using Folder = testing::MemoryFolder;

namespace {

config::Config two_chains() {
    return testing::lidar_and_camera(80ms, 80ms, {{"detect", ""}, {"track", ""}});
}

observe::ProcessKey key_of(const std::string& stem) {
    std::ifstream file(stem + observe::kPageSuffix, std::ios::binary);
    abi::StatusHeader header;
    file.read(reinterpret_cast<char*>(&header), sizeof header);
    return {header.process, header.start_ticks, header.pid_namespace, header.boot_id};
}

/// Does it in a child, which ends at once and runs no handler of exit.
int in_child(const std::function<int()>& act) {
    const pid_t child = fork();
    if (child == 0) _exit(act());
    int status = 0;
    REQUIRE(waitpid(child, &status, 0) == child);
    return status;
}

void write_word(const std::string& stem, std::uint32_t word) {
    std::fstream file(stem + observe::kControlSuffix,
                      std::ios::binary | std::ios::in | std::ios::out);
    file.seekp(offsetof(abi::ControlPage, word));
    file.write(reinterpret_cast<const char*>(&word), sizeof word);
}

}  // namespace

TEST_CASE("Status page tells of its process and its chains, and goes with it",
          "[observe][status_page]") {
    const Folder folder;
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
    const Folder folder;
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
    const Folder folder;
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
    const Folder folder;
    SECTION("there is none") {
        StatusPage page({folder.path("missing"), ""}, two_chains(), 0s);
        CHECK_FALSE(page.is_shared());
        CHECK(page.note().find("No such file") != std::string::npos);
        page.akb().tasks[255].head_idle_ns = 7;
        CHECK_FALSE(page.control_word());
        CHECK_FALSE(page.wait_for_control(0));
    }
    SECTION("it is on a disk: launches must not wait for that, nor end where it is full") {
        const testing::Folder disk(std::filesystem::current_path());
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

TEST_CASE("Page that a killed process has left behind is found and removed",
          "[observe][status_page]") {
    const Folder folder;
    const std::string path = folder.path().string();
    const int status = in_child([&] {
        new StatusPage({path, ""}, two_chains(), 0s);
        return raise(SIGKILL);
    });
    REQUIRE(WIFSIGNALED(status));
    const auto stems = observe::list_pages(path);
    REQUIRE(stems.size() == 1);
    CHECK(observe::liveness_of(key_of(stems[0]), stems[0]) == Liveness::kGone);
    SECTION("by a reader") {
        CHECK(observe::remove_stale_pages(path) == 1);
        CHECK(std::filesystem::is_empty(folder.path()));
    }
    SECTION("by the next process that starts") {
        const StatusPage own({path, ""}, two_chains(), 0s);
        CHECK(observe::list_pages(path) == std::vector<std::string>{own.stem()});
        CHECK(observe::remove_stale_pages(path) == 0);
        CHECK(access((stems[0] + observe::kControlSuffix).c_str(), F_OK) != 0);
    }
}

TEST_CASE("Liveness is judged by start and namespace, not by the number alone",
          "[observe][status_page]") {
    const Folder folder;
    const StatusPage page({folder.path().string(), ""}, two_chains(), 0s);
    observe::ProcessKey key = key_of(page.stem());
    CHECK(observe::liveness_of(key, page.stem()) == Liveness::kThere);
    SECTION("another process has the number now") {
        ++key.start_ticks;
        CHECK(observe::liveness_of(key, page.stem()) == Liveness::kGone);
    }
    SECTION("containers may have a boot id each, or none") {
        for (const char* boot_id : {"another", ""}) {
            key.boot_id = boot_id;
            CHECK(observe::liveness_of(key, page.stem()) == Liveness::kThere);
        }
    }
    SECTION("a process of another namespace, whatever its boot id") {
        ++key.pid_namespace;
        CHECK(observe::liveness_of(key, page.stem()) == Liveness::kElsewhere);
        key.boot_id = "another";
        CHECK(observe::liveness_of(key, page.stem()) == Liveness::kElsewhere);
    }
    SECTION("nor where it is not known in which namespace") {
        key.pid_namespace = 0;
        CHECK(observe::liveness_of(key, page.stem()) == Liveness::kElsewhere);
    }
}

TEST_CASE("Page is left alone where /proc is another pid namespace's", "[observe][status_page]") {
    const Folder folder;
    const std::string path = folder.path().string();
    constexpr int kMayNot = 7;
    const int status = in_child([&] {
        if (unshare(CLONE_NEWPID) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWPID) != 0)
            return kMayNot;
        // The first process of the new namespace; /proc/1 is the machine's.
        const int inner = in_child([&] {
            const StatusPage page({path, ""}, two_chains(), 0s);
            const observe::ProcessKey key = observe::own_process();
            std::ifstream stat("/proc/self/stat");
            std::string field;
            for (int i = 0; i < 22; ++i) stat >> field;  // the name has no space
            const bool is_right = key.process == 1 && std::to_string(key.start_ticks) == field &&
                                  observe::liveness_of(key, page.stem()) == Liveness::kElsewhere &&
                                  observe::remove_stale_pages(path) == 0;
            return is_right ? 0 : 1;
        });
        return WIFEXITED(inner) ? WEXITSTATUS(inner) : 2;
    });
    if (WIFEXITED(status) && WEXITSTATUS(status) == kMayNot) return;
    CHECK(status == 0);
}

TEST_CASE("Page of a process that has become another program was left behind",
          "[observe][status_page]") {
    const Folder folder;
    const std::string path = folder.path().string();
    const pid_t child = fork();
    if (child == 0) {
        new StatusPage({path, ""}, two_chains(), 0s);
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        execl("/bin/sleep", "sleep", "60", nullptr);
        _exit(1);
    }
    const auto gone = [&] {
        const auto stems = observe::list_pages(path);
        return stems.size() == 1 &&
               observe::liveness_of(key_of(stems[0]), stems[0]) == Liveness::kGone;
    };
    bool was_gone = false;
    for (int i = 0; i < 1000 && !(was_gone = gone()); ++i) std::this_thread::sleep_for(5ms);
    CHECK(was_gone);
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
}

TEST_CASE("Process whose first thread has ended is there as long as another one runs",
          "[observe][status_page]") {
    const Folder folder;
    const std::string path = folder.path().string();
    const pid_t child = fork();
    if (child == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        new StatusPage({path, ""}, two_chains(), 0s);
        std::thread([] { std::this_thread::sleep_for(60s); }).detach();
        syscall(SYS_exit, 0);  // this thread alone, unwinding nothing
    }
    const auto first_has_ended = [&] {
        std::ifstream stat("/proc/" + std::to_string(child) + "/stat");
        std::string text((std::istreambuf_iterator<char>(stat)), {});
        return text.find(") Z ") != std::string::npos;
    };
    for (int i = 0; i < 1000 && !first_has_ended(); ++i) std::this_thread::sleep_for(5ms);
    REQUIRE(first_has_ended());
    const auto stems = observe::list_pages(path);
    REQUIRE(stems.size() == 1);
    CHECK(observe::liveness_of(key_of(stems[0]), stems[0]) == Liveness::kThere);
    kill(child, SIGKILL);
    for (int i = 0; i < 1000; ++i) {  // not waited for: a zombie as a whole, in the end
        if (observe::liveness_of(key_of(stems[0]), stems[0]) == Liveness::kGone) break;
        std::this_thread::sleep_for(5ms);
    }
    CHECK(observe::liveness_of(key_of(stems[0]), stems[0]) == Liveness::kGone);
    waitpid(child, nullptr, 0);
}

TEST_CASE("Page stays if the process' maps are too long to be read to their end",
          "[observe][status_page]") {
    const Folder folder;
    const int status = in_child([&] {
        const StatusPage page({folder.path().string(), ""}, two_chains(), 0s);
        std::filesystem::path deep = folder.path();
        while (deep.string().size() < 3700) deep /= std::string(200, 'd');
        std::filesystem::create_directories(deep);
        const int fd = open((deep / "file").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
        // Each below those before it: the page is the last that maps tell of.
        for (int i = 0; i < 6000; ++i)
            if (mmap(nullptr, 4096, PROT_READ, MAP_SHARED, fd, 0) == MAP_FAILED) return 2;
        return observe::liveness_of(key_of(page.stem()), page.stem()) == Liveness::kThere ? 0 : 1;
    });
    CHECK(status == 0);
}

TEST_CASE("Forked child leaves its parent's page alone", "[observe][status_page]") {
    const Folder folder;
    StatusPage page({folder.path().string(), ""}, two_chains(), 0s);
    CHECK(in_child([&] {
              page.retire();
              return 0;
          }) == 0);
    CHECK(page.header().is_over == 0);
    CHECK(observe::list_pages(folder.path().string()).size() == 1);
}

TEST_CASE("Stopped process is told from one that runs", "[observe][status_page]") {
    const Folder folder;
    const std::string path = folder.path().string();
    const pid_t child = fork();
    if (child == 0) {
        new StatusPage({path, ""}, two_chains(), 0s);
        raise(SIGSTOP);
        _exit(0);
    }
    int status = 0;
    REQUIRE(waitpid(child, &status, WUNTRACED) == child);
    REQUIRE(WIFSTOPPED(status));
    const auto stems = observe::list_pages(path);
    REQUIRE(stems.size() == 1);
    CHECK(observe::liveness_of(key_of(stems[0]), stems[0]) == Liveness::kStopped);
    kill(child, SIGKILL);
    waitpid(child, &status, 0);
    CHECK(observe::liveness_of(key_of(stems[0]), stems[0]) == Liveness::kGone);
}

TEST_CASE("Control word is read as it stands, and nothing ends the program when the file is cut",
          "[observe][status_page]") {
    const Folder folder;
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
    const Folder folder;
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
