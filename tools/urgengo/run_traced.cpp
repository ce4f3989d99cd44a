// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/run_traced.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <system_error>
#include <thread>

#include "host/base/atomic_file.h"
#include "host/config/names.h"
#include "host/config/resolved_config.h"
#include "tools/urgengo/environment_check.h"
#include "tools/urgengo/exit_codes.h"

namespace urgengo::cli {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kPoll{20};
constexpr std::chrono::seconds kGrace{5};

volatile sig_atomic_t g_interrupt = 0;

/// Notes SIGINT and SIGTERM while it lives: what was traced until then is still wanted.
class InterruptGuard {
  public:
    InterruptGuard() {
        g_interrupt = 0;
        struct sigaction action {};
        action.sa_handler = [](int signal) { g_interrupt = signal; };
        sigaction(SIGINT, &action, &old_int_);
        sigaction(SIGTERM, &action, &old_term_);
    }
    InterruptGuard(const InterruptGuard&) = delete;
    InterruptGuard& operator=(const InterruptGuard&) = delete;
    ~InterruptGuard() {
        sigaction(SIGINT, &old_int_, nullptr);
        sigaction(SIGTERM, &old_term_, nullptr);
    }

  private:
    struct sigaction old_int_ {};
    struct sigaction old_term_ {};
};

/// A child that may have children of its own.
class Child {
  public:
    /// @param own_group  it and what it starts can be signalled together, but not by the terminal
    Child(pid_t pid, bool own_group) : pid_(pid), own_group_(own_group) {}

    /// @returns whether it has ended
    bool poll() {
        int status = 0;
        if (waitpid(pid_, &status, WNOHANG) != pid_) return false;
        exit_code_ = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
        return true;
    }

    void send(int signal) const { kill(own_group_ ? -pid_ : pid_, signal); }

    /// What it left behind ends with it, or would go on writing the trace.
    void end_the_rest() const {
        if (own_group_) kill(-pid_, SIGKILL);
    }

    int exit_code() const { return exit_code_; }

  private:
    pid_t pid_;
    bool own_group_;
    int exit_code_ = 0;
};

/// @returns whether the time was over before the child ended
bool wait_for(Child& child, double seconds) {
    const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                        std::chrono::duration<double>(seconds));
    auto next = end;
    int signals[] = {SIGINT, SIGTERM, SIGKILL};
    std::size_t num_sent = 0;
    bool passed_on = false;
    while (!child.poll()) {
        if (g_interrupt && !passed_on) {
            // With the terminal's Ctrl-C the child has got one, too, if it is in our group.
            if (g_interrupt == SIGTERM || seconds > 0) child.send(g_interrupt);
            passed_on = true;
        }
        if (seconds > 0 && Clock::now() >= next && num_sent < std::size(signals)) {
            child.send(signals[num_sent++]);
            next += kGrace;
        }
        std::this_thread::sleep_for(kPoll);
    }
    child.end_the_rest();
    return num_sent > 0;
}

TracedRun failed(const std::string& message, int exit_code = kExitFailure) {
    TracedRun run;
    run.exit_code = exit_code;
    run.message = message;
    return run;
}

}  // namespace

TracedRun run_traced(const ProgramSetup& setup, const std::vector<std::string>& program,
                     const Environment& environment, config::Config config,
                     const std::string& folder, const std::string& trace, double seconds) {
    ScheduledProgram scheduled;
    scheduled.interposer = setup.interposer;
    scheduled.config = folder + "/traced.resolved.json";
    scheduled.mode = config::to_word(config::Mode::kObserve);
    scheduled.real_libcuda = setup.real_libcuda;
    scheduled.summary = false;
    Environment theirs = scheduled_environment(environment, scheduled);
    theirs.erase("URGENGO_STATS");
    theirs["URGENGO_TRACE"] = absolute(trace);
    theirs["URGENGO_TRACE_KERNELS"] = "1";
    const EnvironmentCheck checked = check_environment(theirs);
    if (!checked.error.empty()) return failed(checked.error, kExitUsage);
    warn(setup.warnings);
    warn(checked.warnings);

    config.mode = config::Mode::kObserve;
    const auto written =
        write_file_atomically(scheduled.config, config::to_resolved_json(config, nullptr, {}));
    if (!written) return failed(written.error());

    const bool own_group = seconds > 0;
    const InterruptGuard guard;
    const pid_t parent = getpid();
    const pid_t pid = fork();
    if (pid < 0) return failed("fork: " + std::generic_category().message(errno));
    if (pid == 0) {
        signal(SIGINT, SIG_DFL);
        signal(SIGTERM, SIG_DFL);
        if (own_group) setpgid(0, 0);
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (getppid() != parent) _exit(kExitFailure);  // it died before the line above
        _exit(become(setup, program, theirs));
    }
    if (own_group) setpgid(pid, pid);  // whoever of the two comes first
    Child child(pid, own_group);
    TracedRun run;
    run.was_stopped = wait_for(child, seconds);
    run.program_exit_code = child.exit_code();
    return run;
}

}  // namespace urgengo::cli
