// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/driver_question.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <thread>

#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr char kEnd = '\0';  // of an answer: what the driver starts may hold the pipe open for long
constexpr milliseconds kLook{100};
constexpr milliseconds kReapLimit{2000};
constexpr milliseconds kReapPoll{1};

bool write_all(int fd, const std::string& text) {
    for (std::size_t done = 0; done < text.size();) {
        const ssize_t count = write(fd, text.data() + done, text.size() - done);
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return false;
        done += static_cast<std::size_t>(count);
    }
    return true;
}

[[noreturn]] void answer(const std::function<std::string()>& ask, int output) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    // What the driver prints is not for our user, and our exit handlers are not for the child.
    const int null = open("/dev/null", O_WRONLY | O_CLOEXEC);
    dup2(null, STDOUT_FILENO);
    dup2(null, STDERR_FILENO);
    unsetenv("CUDA_INJECTION64_PATH");
    unsetenv("CUDA_LAUNCH_BLOCKING");
    _exit(write_all(output, ask() + kEnd) ? 0 : 1);
}

/// @returns the answer, without its end
Result<std::string> read_answer(int input, milliseconds limit) {
    const auto deadline = steady_clock::now() + limit;
    std::string text;
    while (text.empty() || text.back() != kEnd) {
        const auto left =
            std::chrono::duration_cast<milliseconds>(deadline - steady_clock::now()).count();
        if (left <= 0) return Error{"the driver does not answer"};
        pollfd wait{input, POLLIN, 0};
        ProgressBar::tick();
        if (poll(&wait, 1, static_cast<int>(std::min<long>(left, kLook.count()))) <= 0) continue;
        char buffer[4096];
        const ssize_t count = read(input, buffer, sizeof buffer);
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0) return Error{"the driver crashed"};
        text.append(buffer, static_cast<std::size_t>(count));
    }
    text.pop_back();
    return text;
}

/// A process that hangs inside the kernel's driver cannot be ended: it is left behind then.
void end(pid_t child) {
    kill(child, SIGKILL);
    const auto deadline = steady_clock::now() + kReapLimit;
    while (waitpid(child, nullptr, WNOHANG) == 0 && steady_clock::now() < deadline) {
        std::this_thread::sleep_for(kReapPoll);
    }
}

}  // namespace

Result<std::string> ask_in_child(const std::function<std::string()>& ask, milliseconds limit) {
    std::array<int, 2> pipe_ends{};
    if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) return Error{"no pipe"};
    const pid_t child = fork();
    if (child == 0) answer(ask, pipe_ends[1]);
    close(pipe_ends[1]);
    Result<std::string> text = Error{"no process"};
    if (child > 0) {
        text = read_answer(pipe_ends[0], limit);
        end(child);
    }
    close(pipe_ends[0]);
    return text;
}

}  // namespace urgengo::cli
