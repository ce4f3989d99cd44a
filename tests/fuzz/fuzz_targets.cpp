// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/fuzz_targets.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/config/config_reader.h"
#include "host/config/profile_reader.h"
#include "host/config/resolved_config.h"
#include "host/observe/page_folder.h"
#include "host/observe/status_page.h"
#include "tools/trace/run_export.h"
#include "tools/trace/run_reader.h"
#include "tools/trace/run_summary.h"
#include "tools/trace/trace_reader.h"
#include "tools/urgengo/page/frame_follower.h"
#include "tools/urgengo/page/page_reader.h"
#include "tools/urgengo/top/top_view.h"

namespace urgengo::fuzz {
namespace {

std::string_view text_of(Input input) {
    return {reinterpret_cast<const char*>(input.data()), input.size()};
}

/// A folder in memory, for readers of files; it goes with the process.
class Folder {
  public:
    Folder() {
        std::error_code unknown;
        std::string name = std::filesystem::is_directory("/dev/shm", unknown)
                               ? "/dev/shm/urgengo_fuzz_XXXXXX"
                               : "/tmp/urgengo_fuzz_XXXXXX";
        if (!mkdtemp(name.data())) std::abort();
        path = name;
    }
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
    std::string path;
};

/// The file has these bytes, and no others. It stays the same file: it may be mapped.
void fill(const std::string& path, Input input) {
    const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    const auto size = static_cast<off_t>(input.size());
    if (file < 0 || ftruncate(file, size) != 0 ||
        pwrite(file, input.data(), input.size(), 0) != size)
        std::abort();
    close(file);
}

/// Late frames whose story is told: all of them would take the square of the input's length.
constexpr std::size_t kMostStories = 4;

}  // namespace

void page(Input input) {
    static const Folder folder;
    static const std::string stem = folder.path + "/page";
    fill(stem + observe::kPageSuffix, input);
    if (const auto follower = cli::FrameFollower::open(stem)) {
        follower->follow();
        follower->follow();
    }
    const auto page = cli::parse_page(input, std::chrono::seconds(3));
    if (!page) return;
    cli::TopOptions options;
    options.tasks = true;
    (void)cli::top_lines({*page}, options);
    (void)cli::top_json({*page}).dump();
}

void control(Input input) {
    static const Folder folder;
    static const observe::StatusPage status({folder.path, ""}, {}, std::chrono::seconds(1));
    if (!status.is_shared()) std::abort();
    fill(status.stem() + observe::kControlSuffix, input);
    (void)status.control_path();
    const auto word = status.control_word();
    if (!word) return;
    for (std::uint32_t back = 0; back <= abi::kControlRing; ++back)
        (void)status.control_request(*word - (back << 8));
    (void)status.wait_for_control(*word + 1);
}

void run(Input input) {
    const std::string_view text = text_of(input);
    const auto run = trace::parse_run({text.data(), text.size()}, "run");
    if (!run) return;
    const trace::RunStory story = trace::tell(*run);
    (void)trace::summarize(*run, story);
    const std::vector<std::size_t> late = trace::late_frames(story);
    for (std::size_t i = 0; i < std::min(late.size(), kMostStories); ++i) {
        (void)trace::outcome_words(*run, story.frames[late[i]]);
        (void)trace::frame_story(*run, story, late[i]);
        (void)trace::held_behind(story, late[i]);
        (void)trace::meanwhile(story, late[i]);
    }
    (void)trace::to_perfetto(*run, story);
    (void)trace::to_chrome(*run, story);
    (void)trace::to_csv(*run, story);
    std::vector<char> copy(text.begin(), text.end());
    trace::mark_overwritten(copy, [](std::uint64_t offset) { return offset; });
    (void)trace::parse_run(copy, "copy");
}

void trace(Input input) {
    const auto trace = trace::parse_trace(text_of(input), "trace");
    if (!trace) return;
    (void)trace->gpu();
    (void)trace->driver();
    for (const trace::ThreadTrace& thread : trace->threads())
        for (const abi::TraceRecord* record : thread.events) {
            (void)thread.name_at(record->time_ns);
            if (record->kind == abi::TraceKind::kLaunch) (void)launch_name(*trace, *record);
        }
}

void config(Input input) {
    (void)config::parse_config(std::string(text_of(input)), "chains.yaml", "");
}

void profile(Input input) {
    (void)config::parse_profile(text_of(input), "profile");
}

void resolved(Input input) {
    const auto resolved = config::parse_resolved_json(text_of(input), "resolved");
    if (!resolved) return;
    // What has been read can be written, and read again.
    const config::Profile* const profile = resolved->profile ? &*resolved->profile : nullptr;
    const std::string text = config::to_resolved_json(resolved->config, profile, resolved->source);
    if (!config::parse_resolved_json(text, "written")) __builtin_trap();
}

}  // namespace urgengo::fuzz
