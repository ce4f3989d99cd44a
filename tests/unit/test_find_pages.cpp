// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/page/find_pages.h"

#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <fstream>
#include <thread>

#include "host/base/clock.h"
#include "host/observe/status_page.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/urgengo/cmd_ctl.h"
#include "tools/urgengo/page/control.h"
#include "tools/urgengo/page/page_reader.h"

using namespace urgengo;
using namespace std::chrono_literals;
using abi::ControlCommand;
using cli::choose_pages;
using cli::find_pages;
using observe::kControlSuffix;
using observe::kPageSuffix;
using observe::Liveness;
using Folder = testing::MemoryFolder;

namespace {

config::Config one_chain() {
    config::Config config;
    config.chains.emplace_back();
    config.chains[0].name = "lidar";
    config.chains[0].tasks = {{"detect", ""}};
    return config;
}

struct OwnPage {
    Folder folder;
    std::string path{folder.path().string()};
    observe::StatusPage page{{path, ""}, one_chain(), 1s};
    std::uint32_t pid = static_cast<std::uint32_t>(getpid());

    /// Leaves a page of a process with our number in another pid namespace, which is not there.
    void leave_elsewhere(int number) const {
        const std::string bytes = text_of(page.stem() + kPageSuffix);
        const std::string control = text_of(page.stem() + kControlSuffix);
        const observe::ProcessKey own = observe::own_process();
        const std::uint64_t space = own.pid_namespace + static_cast<std::uint64_t>(number);
        std::string copy = bytes;
        std::memcpy(copy.data() + offsetof(abi::StatusHeader, pid_namespace), &space, sizeof space);
        const std::string stem = observe::page_stem({own.process, own.start_ticks, space, ""});
        folder.write(stem + kPageSuffix, copy, 0600);
        folder.write(stem + kControlSuffix, control, 0600);
    }

  private:
    static std::string text_of(const std::string& file) {
        std::ifstream stream(file, std::ios::binary);
        return {std::istreambuf_iterator<char>(stream), {}};
    }
};

}  // namespace

TEST_CASE("Page that another user has put there is passed over", "[cli][page]") {
    if (geteuid() != 0) return;  // who may give no file away
    constexpr uid_t kStranger = 12345;
    const OwnPage f;
    const std::string control = f.page.stem() + kControlSuffix;
    REQUIRE(find_pages(f.path).size() == 1);
    SECTION("though it names a process that is there") {
        REQUIRE(chown((f.page.stem() + kPageSuffix).c_str(), kStranger, kStranger) == 0);
        REQUIRE(chown(control.c_str(), kStranger, kStranger) == 0);
        CHECK(find_pages(f.path).empty());
        CHECK_FALSE(choose_pages(f.path, f.pid, false));
    }
    SECTION("and so is the word that another user has put beside a page") {
        REQUIRE(chown(control.c_str(), kStranger, kStranger) == 0);
        const auto word = cli::send_command(f.page.stem(), ControlCommand::kOff);
        REQUIRE_FALSE(word);
        CHECK(word.error() == control + ": belongs to another user than the page");
        CHECK(f.page.control_word() == 0u);
    }
    CHECK(observe::list_pages(f.path).size() == 1);
}

TEST_CASE("Link to a page under another name is no page", "[cli][page]") {
    const OwnPage f;
    std::filesystem::create_hard_link(f.page.stem() + kPageSuffix,
                                      f.folder.path("urgengo-1-2-3.page"));
    const auto pages = find_pages(f.path, false);
    REQUIRE(pages.size() == 1);
    CHECK(pages[0].stem == f.page.stem());
}

TEST_CASE("File belongs to a process by who owns it", "[observe][status_page]") {
    const observe::ProcessKey own = observe::own_process();
    const std::uint32_t user = geteuid(), stranger = user + 12345;
    CHECK(observe::may_be_of({user, false}, own, Liveness::kThere));
    CHECK(observe::may_be_of({user, false}, own, Liveness::kElsewhere));
    CHECK(observe::may_be_of({0, false}, own, Liveness::kElsewhere));
    CHECK_FALSE(observe::may_be_of({stranger, false}, own, Liveness::kThere));
    CHECK_FALSE(observe::may_be_of({stranger, false}, own, Liveness::kElsewhere));
    if (user != 0) return;  // others cannot become another
    const pid_t child = fork();
    if (child == 0) {
        (void)!setuid(stranger);
        prctl(PR_SET_DUMPABLE, 0);  // root owns its folder in /proc
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        raise(SIGSTOP);
        _exit(0);
    }
    int status = 0;
    REQUIRE(waitpid(child, &status, WUNTRACED) == child);
    const observe::ProcessKey other{static_cast<std::uint32_t>(child), 0, own.pid_namespace, ""};
    CHECK(observe::may_be_of({stranger, false}, other, Liveness::kThere));
    CHECK_FALSE(observe::may_be_of({stranger, true}, other, Liveness::kThere));  // open to all
    CHECK_FALSE(observe::may_be_of({stranger, false}, other, Liveness::kElsewhere));
    CHECK_FALSE(observe::may_be_of({stranger + 1, false}, other, Liveness::kThere));
    kill(child, SIGKILL);
    waitpid(child, &status, 0);
}

TEST_CASE("Word is written though somebody holds the lock for ever", "[cli][page]") {
    const OwnPage f;
    const int fd = open((f.page.stem() + kControlSuffix).c_str(), O_RDWR | O_CLOEXEC);
    REQUIRE(fd >= 0);
    REQUIRE(flock(fd, LOCK_EX) == 0);
    const auto word = cli::send_command(f.page.stem(), ControlCommand::kOff);
    REQUIRE(word);
    CHECK(f.page.control_word() == *word);
    CHECK(abi::command_of(*word) == ControlCommand::kOff);
    close(fd);
}

TEST_CASE("Reading a page looks into no maps; finding pages does when it is asked to",
          "[cli][page]") {
    const Folder folder;
    const std::string path = folder.path().string();
    const pid_t child = fork();
    if (child == 0) {
        new observe::StatusPage({path, ""}, one_chain(), 0s);
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        execl("/bin/sleep", "sleep", "60", nullptr);
        _exit(1);
    }
    const auto has_let_go = [&] {
        const auto stems = observe::list_pages(path);
        if (stems.empty()) return false;
        const auto page = cli::read_page(stems[0], monotonic_now());
        return page && observe::liveness_of(page->process, stems[0]) == Liveness::kGone;
    };
    for (int i = 0; i < 1000 && !has_let_go(); ++i) std::this_thread::sleep_for(5ms);
    REQUIRE(has_let_go());
    const auto page = cli::read_page(observe::list_pages(path)[0], monotonic_now());
    REQUIRE(page);
    CHECK(page->liveness == Liveness::kThere);
    CHECK(find_pages(path, false).size() == 1);
    CHECK(find_pages(path, true).empty());
    CHECK(observe::list_pages(path).empty());
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
}

TEST_CASE("Process is meant by its number in this pid namespace", "[cli][page]") {
    const OwnPage f;
    f.leave_elsewhere(1);
    f.leave_elsewhere(2);
    CHECK(find_pages(f.path).size() == 3);
    for (const std::uint32_t pid : {f.pid, 0u}) {
        const auto pages = choose_pages(f.path, pid, false);
        REQUIRE(pages);
        REQUIRE(pages->size() == 1);
        CHECK((*pages)[0].stem == f.page.stem());
    }
    CHECK(choose_pages(f.path, 0, true)->size() == 3);
    observe::remove_page(f.page.stem());
    const auto none = choose_pages(f.path, f.pid, false);
    REQUIRE_FALSE(none);
    CHECK(none.error().find("in this pid namespace") != std::string::npos);
    CHECK(none.error().find("but in another: " + std::to_string(f.pid)) != std::string::npos);
    CHECK(choose_pages(f.path, 0, false).error().find("found 2 processes") != std::string::npos);
    CHECK_FALSE(choose_pages(f.path, f.pid + 1, false));
}

TEST_CASE("Process of another pid namespace need not answer what all are told", "[cli][page]") {
    const OwnPage f;
    f.leave_elsewhere(1);
    observe::remove_page(f.page.stem());
    setenv("URGENGO_SHARE", f.path.c_str(), 1);
    cli::CtlOptions options{.what = "off", .quiet = true, .timeout = 0.02};
    CHECK(cli::cmd_ctl(options) == 1);  // it is the only one
    options.all = true;
    CHECK(cli::cmd_ctl(options) == 0);
    unsetenv("URGENGO_SHARE");
}

TEST_CASE("Chain's mode is the weaker one of its own and its process'", "[cli][page]") {
    using abi::StatusMode;
    const auto mode_now = [](StatusMode of_all, StatusMode own) {
        cli::PageReading page;
        page.mode = of_all;
        cli::ChainReading chain;
        chain.mode = own;
        return cli::mode_of(page, chain);
    };
    CHECK(mode_now(StatusMode::kEnforce, StatusMode::kEnforce) == StatusMode::kEnforce);
    CHECK(mode_now(StatusMode::kEnforce, StatusMode::kShadow) == StatusMode::kShadow);
    CHECK(mode_now(StatusMode::kShadow, StatusMode::kEnforce) == StatusMode::kShadow);
    CHECK(mode_now(StatusMode::kShadow, StatusMode::kObserve) == StatusMode::kObserve);
    CHECK(mode_now(StatusMode::kObserve, StatusMode::kShadow) == StatusMode::kObserve);
    CHECK(mode_now(StatusMode::kOff, StatusMode::kShadow) == StatusMode::kOff);
    CHECK(mode_now(StatusMode::kTripped, StatusMode::kShadow) == StatusMode::kTripped);
}
