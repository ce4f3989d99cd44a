// SPDX-License-Identifier: Apache-2.0
//
// Pages of programs that have ended, or become others: what is found of them, and what is kept.
#include "host/observe/page_folder.h"

#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>

#include <algorithm>
#include <csignal>
#include <thread>

#include "tests/support/status_pages.h"

using namespace urgengo;
using namespace urgengo::testing;
using observe::Liveness;
using observe::StatusPage;

TEST_CASE("Page that a killed process has left behind is found and removed",
          "[observe][status_page]") {
    const MemoryFolder folder;
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
    const MemoryFolder folder;
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
    const MemoryFolder folder;
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
    const MemoryFolder folder;
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
    const MemoryFolder folder;
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
    const MemoryFolder folder;
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

TEST_CASE("Stopped process is told from one that runs", "[observe][status_page]") {
    const MemoryFolder folder;
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

TEST_CASE("Pages of programs that have tripped are kept with their records, four at most",
          "[observe][status_page]") {
    const MemoryFolder folder;
    const std::string path = folder.path().string();
    const auto leave = [&](std::chrono::seconds begin, bool has_records, bool is_killed) {
        in_child([&] {
            StatusPage& page = *new StatusPage({path, ""}, two_chains(), begin);
            if (has_records) std::ofstream(page.stem() + observe::kRecordsSuffix) << "records";
            page.tripped();
            return is_killed ? raise(SIGKILL) : (page.retire(), 0);
        });
    };
    leave(1s, false, false);
    CHECK(std::filesystem::is_empty(folder.path()));
    leave(6s, true, true);
    const std::vector<std::string> newest = observe::list_pages(path);
    REQUIRE(newest.size() == 1);
    for (int begin = 1; begin <= 5; ++begin) leave(std::chrono::seconds(begin), true, false);
    CHECK(observe::remove_stale_pages(path) >= 1);  // those that have started since did it, too
    std::vector<std::string> kept = observe::list_pages(path);
    CHECK(kept.size() == observe::kMostKept);
    CHECK(std::count(kept.begin(), kept.end(), newest[0]) == 1);
    for (const std::string& stem : kept) {
        CHECK(access((stem + observe::kRecordsSuffix).c_str(), F_OK) == 0);
        std::ifstream file(stem + observe::kPageSuffix, std::ios::binary);
        abi::StatusHeader header;
        file.read(reinterpret_cast<char*>(&header), sizeof header);
        CHECK(header.begin_ns >= 3'000'000'000);
    }
    CHECK(observe::remove_stale_pages(path) == 0);
}
