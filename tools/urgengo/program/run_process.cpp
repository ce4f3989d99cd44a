// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program/run_process.h"

#include <fmt/format.h>

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <system_error>

#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kKeptBytes = 64 * 1024;
constexpr int kPollMs = 50;

volatile sig_atomic_t g_interrupt = 0;
volatile sig_atomic_t g_from_terminal = 0;

/// Notes SIGINT and SIGTERM while it lives, instead of dying of them.
class InterruptGuard {
  public:
    InterruptGuard() {
        g_interrupt = 0;
        g_from_terminal = 0;
        struct sigaction action {};
        action.sa_flags = SA_SIGINFO;
        action.sa_sigaction = [](int signal, siginfo_t* info, void*) {
            g_from_terminal = info->si_code == SI_KERNEL;
            g_interrupt = signal;
        };
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

std::string errno_text() {
    return std::generic_category().message(errno);
}

std::vector<char*> pointers(std::vector<std::string>& texts) {
    std::vector<char*> list;
    for (std::string& text : texts) list.push_back(text.data());
    list.push_back(nullptr);
    return list;
}

[[noreturn]] void become_child(char** arguments, char** environment, int output, bool keeps_stdout,
                               pid_t parent) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(kExitFailure);  // it died before the line above
    if (output >= 0) {
        dup2(output, STDOUT_FILENO);
        dup2(output, STDERR_FILENO);
    } else if (keeps_stdout) {
        dup2(STDERR_FILENO, STDOUT_FILENO);
    }
    execve(arguments[0], arguments, environment);
    dprintf(STDERR_FILENO, "%s: cannot be started: %s\n", arguments[0], errno_text().c_str());
    _exit(kExitNotFound);
}

/// Appends what can be read now. @returns false at the end of the stream
bool read_available(int fd, std::string& output) {
    char buffer[16384];
    for (;;) {
        const ssize_t count = read(fd, buffer, sizeof buffer);
        if (count == 0) return false;
        if (count < 0) return errno == EAGAIN || errno == EINTR;
        output.append(buffer, static_cast<std::size_t>(count));
        if (output.size() > kKeptBytes) output.erase(0, output.size() - kKeptBytes);
    }
}

/// Passes an interrupt on to the child, once, or interrupts it when its time is over, and ends a
/// child that does not heed it.
class InterruptForwarder {
  public:
    InterruptForwarder(pid_t child, const ProcessOptions& options)
        : child_(child), options_(options), limit_(Clock::now() + options.limit) {}

    void step() {
        const Clock::time_point now = Clock::now();
        if (asked_) {
            if (now >= deadline_) kill(child_, SIGKILL);
        } else if (g_interrupt) {
            // Ctrl-C in a terminal goes to the child as well; a second SIGINT may be one too many.
            ask(g_from_terminal ? 0 : g_interrupt, now);
        } else if (options_.limit.count() > 0 && now >= limit_) {
            timed_out_ = true;
            ask(SIGINT, now);
        }
    }

    bool timed_out() const { return timed_out_; }

  private:
    void ask(int signal, Clock::time_point now) {
        kill(child_, signal);
        asked_ = true;
        deadline_ = now + options_.grace;
    }

    pid_t child_;
    const ProcessOptions& options_;
    Clock::time_point limit_;
    bool asked_ = false;
    bool timed_out_ = false;
    Clock::time_point deadline_{};  ///< once asked
};

/// Until the child ends, not until the stream does: a grandchild may hold the stream open.
/// @param stream  of what it prints; -1: none
int wait_for(pid_t child, int stream, std::string& output, InterruptForwarder& forwarder) {
    bool stream_open = stream >= 0;
    for (;;) {
        int status = 0;
        const pid_t ended = waitpid(child, &status, WNOHANG);
        if (stream_open) stream_open = read_available(stream, output);
        if (ended == child) {
            return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
        }
        forwarder.step();
        ProgressBar::tick();
        pollfd wait{stream_open ? stream : -1, POLLIN, 0};
        poll(&wait, 1, kPollMs);
    }
}

}  // namespace

Result<ProcessResult> run_process(const std::vector<std::string>& arguments,
                                  const Environment& environment, const ProcessOptions& options) {
    std::array<int, 2> pipe_ends{-1, -1};
    if (!options.show_output) {
        if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) return Error{"pipe: " + errno_text()};
        fcntl(pipe_ends[0], F_SETFL, O_NONBLOCK);
    }

    std::vector<std::string> argument_texts = arguments;
    std::vector<std::string> lines = to_lines(environment);
    const std::vector<char*> argv = pointers(argument_texts);
    const std::vector<char*> envp = pointers(lines);
    const InterruptGuard guard;
    const pid_t parent = getpid();
    const pid_t child = fork();
    if (child == 0)
        become_child(const_cast<char**>(argv.data()), const_cast<char**>(envp.data()), pipe_ends[1],
                     options.keeps_stdout, parent);
    const int fork_errno = errno;
    if (pipe_ends[1] >= 0) close(pipe_ends[1]);
    ProcessResult result;
    if (child > 0) {
        InterruptForwarder forwarder(child, options);
        result.exit_code = wait_for(child, pipe_ends[0], result.output, forwarder);
        result.timed_out = forwarder.timed_out();
    }
    if (pipe_ends[0] >= 0) close(pipe_ends[0]);
    if (child < 0) return Error{"fork: " + std::generic_category().message(fork_errno)};
    result.interrupted = g_interrupt != 0;
    return result;
}

Result<bool> run_to_end(const std::vector<std::string>& arguments, const Environment& environment) {
    const auto process = run_process(arguments, environment);
    if (!process) return Error{process.error()};
    if (process->interrupted) return Error{""};
    if (process->exit_code == 0) return true;
    return Error{fmt::format("exit code {} from: {}\n{}", process->exit_code, shell_line(arguments),
                             process->output)};
}

std::string shell_line(const std::vector<std::string>& arguments) {
    const std::string plain =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_./=,:+@%";
    std::string line;
    for (const std::string& argument : arguments) {
        if (!line.empty()) line += ' ';
        if (!argument.empty() && argument.find_first_not_of(plain) == std::string::npos) {
            line += argument;
            continue;
        }
        line += '\'';
        for (const char c : argument) line += c == '\'' ? std::string("'\\''") : std::string(1, c);
        line += '\'';
    }
    return line;
}

}  // namespace urgengo::cli
