// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/compare/started_program.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>
#include <thread>
#include <utility>

#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/interrupts.h"

namespace urgengo::cli {
namespace {

constexpr std::chrono::seconds kTimeToEnd{10};
constexpr std::chrono::milliseconds kLookForEnd{20};

double seconds(const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

[[noreturn]] void become_program(char** arguments, char** environment, bool keeps_stdout,
                                 pid_t parent) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(kExitFailure);  // it died before the line above
    if (keeps_stdout) dup2(STDERR_FILENO, STDOUT_FILENO);
    execve(arguments[0], arguments, environment);
    dprintf(STDERR_FILENO, "%s: cannot be started: %s\n", arguments[0], std::strerror(errno));
    _exit(kExitNotFound);
}

}  // namespace

Result<StartedProgram> StartedProgram::start(std::vector<std::string> arguments,
                                             const Environment& environment, bool keeps_stdout) {
    std::vector<std::string> lines = to_lines(environment);
    const auto pointers = [](std::vector<std::string>& texts) {
        std::vector<char*> list;
        for (std::string& text : texts) list.push_back(text.data());
        list.push_back(nullptr);
        return list;
    };
    std::vector<char*> argv = pointers(arguments), envp = pointers(lines);
    const pid_t parent = getpid();
    const pid_t child = fork();
    if (child == 0) become_program(argv.data(), envp.data(), keeps_stdout, parent);
    if (child < 0) return Error{std::string("fork: ") + std::strerror(errno)};
    return StartedProgram(child);
}

StartedProgram::StartedProgram(StartedProgram&& other) noexcept
    : process_(std::exchange(other.process_, -1)),
      exit_code_(other.exit_code_),
      cpu_s_(other.cpu_s_) {}

StartedProgram::~StartedProgram() {
    if (process_ > 0) end();
}

std::optional<int> StartedProgram::exit_code() {
    if (exit_code_ || process_ <= 0) return exit_code_;
    int status = 0;
    rusage usage{};
    if (wait4(process_, &status, WNOHANG, &usage) != process_) return std::nullopt;
    cpu_s_ = seconds(usage.ru_utime) + seconds(usage.ru_stime);
    exit_code_ = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
    return exit_code_;
}

int StartedProgram::end() {
    using Clock = std::chrono::steady_clock;
    if (!exit_code() && !Interrupts::is_from_terminal()) kill(process_, SIGINT);
    const auto deadline = Clock::now() + kTimeToEnd;
    while (!exit_code()) {
        if (Clock::now() > deadline) kill(process_, SIGKILL);
        std::this_thread::sleep_for(kLookForEnd);
    }
    return *exit_code_;
}

// The name may have brackets and spaces: what follows the last bracket has none.
std::optional<double> cpu_time_of(pid_t process) {
    constexpr int kUserTime = 14, kFirst = 3;
    std::ifstream file("/proc/" + std::to_string(process) + "/stat");
    std::stringstream text;
    text << file.rdbuf();
    const std::string all = text.str();
    const auto bracket = all.rfind(')');
    if (bracket == std::string::npos) return std::nullopt;
    std::istringstream fields(all.substr(bracket + 1));
    std::string skipped;
    for (int i = kFirst; i < kUserTime; ++i) fields >> skipped;
    double user = 0, system = 0;
    if (!(fields >> user >> system)) return std::nullopt;
    return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

}  // namespace urgengo::cli
