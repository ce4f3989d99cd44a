// SPDX-License-Identifier: Apache-2.0
#include "interposer/lifecycle.h"

#include <pthread.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <string>
#include <vector>

#include "host/base/atomic_file.h"
#include "host/base/log.h"
#include "host/base/own_log.h"
#include "host/base/roomy_stack.h"
#include "host/base/settings.h"
#include "host/config/names.h"
#include "host/observe/mode_word.h"
#include "interposer/boundary.h"
#include "interposer/control.h"
#include "interposer/kernel_times.h"
#include "interposer/nvtx_events.h"
#include "interposer/nvtx_tool.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"
#include "interposer/run_conditions.h"

namespace urgengo::interposer {

constinit EveryCall g_every_call;
constinit thread_local ThisThread t_this;

namespace {

std::mutex g_start_mutex;
// Made once and never destroyed: threads of the program may launch until the process is gone.
runtime::Runtime* g_runtime = nullptr;
Settings* g_settings = nullptr;
observe::TraceWriter* g_trace = nullptr;  // stays mapped to the end
std::atomic<const char*> g_trip_reason{nullptr};
std::atomic<bool> g_in_child{false};
pthread_key_t g_thread_key;

__attribute__((tls_model("initial-exec"))) thread_local bool t_ended = false;

void end_thread(void* state) {
    auto* thread = static_cast<runtime::ThreadState*>(state);
    t_this.state = nullptr;
    t_ended = true;
    if (is_armed()) g_runtime->thread_exit(*thread);
    delete thread;
    t_this.line.passes = false;
    t_this.line.ask_again();
}

// In a forked child CUDA does not work, and whatever a lock of ours protected may be half-done. A
// child of a parent that has not started may start itself, but not if another thread of the parent
// was about to: the lock is taken for ever then.
void in_forked_child() {
    own_log().forked();
    if (g_every_call.state.load(std::memory_order_relaxed) == State::kCold &&
        g_start_mutex.try_lock()) {
        g_start_mutex.unlock();
        return;
    }
    g_every_call.state.store(State::kOff, std::memory_order_release);
    g_in_child.store(true, std::memory_order_relaxed);
}

// At exit: what was counted. Touches no driver: it may be gone.
void report() {
    if (g_in_child.load(std::memory_order_relaxed)) return;  // the parent's numbers
    g_runtime->status().retire();
    // What a test run or a car's log should tell: something in the config is not as it seems.
    std::vector<std::string> warnings;
    if (g_runtime->mode() != abi::StatusMode::kOff) warnings = g_runtime->report().warnings();
    for (const std::string& line : warnings) log_line(line);
    {
        const Inside inside;  // CUPTI calls the driver
        g_runtime->finish_trace();
    }
    if (g_trace) g_trace->close();
    const auto statistics = g_runtime->report().statistics();
    const char* reason = g_trip_reason.load();
    const std::string mode =
        reason ? "tripped" : observe::to_word(g_runtime->status().header().mode.load());
    const std::string guard = g_runtime->guard().summary();
    if (g_settings->summary) log_text(observe::to_table(statistics, mode, guard));
    if (!g_settings->stats.empty()) {
        const std::string json = observe::to_json(statistics, mode, reason ? reason : "", guard,
                                                  g_runtime->report().bystanders(),
                                                  g_runtime->gate_keeper().counts(), warnings);
        if (const auto written = write_file_atomically(g_settings->stats, json); !written)
            log_line("URGENGO_STATS: " + written.error());
        OwnTime::write(g_settings->stats);
    }
    note(LogDetail::kInfo, "the program ends; mode {}", mode);
    own_log().finish();
}

template <typename Tell>
void tell_ranges(Tell&& tell) {
    if (!acts_already()) return;
    const Inside inside;
    protect([&] {
        if (auto* thread = this_thread()) tell(*thread);
    });
}

const config::TaskProfile* find_profile(const config::ResolvedConfig& resolved,
                                        const std::string& chain, const std::string& task) {
    if (!resolved.profile) return nullptr;
    for (const auto& its_chain : resolved.profile->chains)
        for (const auto& its_task : its_chain.tasks)
            if (its_chain.name == chain && its_task.name == task) return &its_task;
    return nullptr;
}

/// With what UrgenGo starts, for its own log.
void note_start(const config::ResolvedConfig& resolved) {
    if (!own_log().tells(LogDetail::kInfo)) return;
    const char* const connections = std::getenv("CUDA_DEVICE_MAX_CONNECTIONS");
    int driver = 0;
    if (available().cuDriverGetVersion) available().cuDriverGetVersion(&driver);
    note(LogDetail::kInfo, "UrgenGo {} in process {}: mode {}, {} chains, config {}",
         URGENGO_VERSION, getpid(), config::to_word(resolved.config.mode),
         resolved.config.chains.size(), g_settings->config);
    note(LogDetail::kInfo, "driver {}.{}, CUDA_DEVICE_MAX_CONNECTIONS {}", driver / 1000,
         driver % 1000 / 10, connections ? connections : "not set");
    for (const config::Chain& chain : resolved.config.chains)
        for (const config::Task& task : chain.tasks) {
            const auto* const profile = find_profile(resolved, chain.name, task.name);
            if (profile && !profile->kernels.empty())
                note(LogDetail::kDebug, "task '{}' of chain '{}' has a plan of {} kernels",
                     task.name, chain.name, profile->kernels.size());
            else
                note(LogDetail::kInfo, "task '{}' of chain '{}' has no plan: {}", task.name,
                     chain.name,
                     profile             ? "its profile has no kernels"
                     : !resolved.profile ? "the config has no profile (urgengo profile)"
                                         : "the profile does not know it");
        }
}

/// @param say  lines for stderr: not said here, under the lock
State make_runtime(std::vector<std::string>& say) {
    g_settings = new Settings(read_settings());
    if (g_settings->config.empty()) {
        say.emplace_back(
            "URGENGO_CONFIG is not set: the program runs as if UrgenGo were not there");
        return State::kOff;
    }
    auto resolved = config::load_for_interposer(g_settings->config);
    if (!resolved) {
        say.push_back(resolved.error() + "; the program runs as if UrgenGo were not there");
        return State::kOff;
    }
    if (const std::string& asked = g_settings->mode; !asked.empty()) {
        const auto mode = config::from_word<config::Mode>(asked);
        if (!mode) {
            say.push_back("URGENGO_MODE: found '" + asked +
                          "', accepted: " + config::all_words<config::Mode>() +
                          "; the program runs as if UrgenGo were not there");
            return State::kOff;
        }
        resolved->config.mode = *mode;
        resolved->mode_is_asked = true;
    }
    if (resolved->config.mode == config::Mode::kOff) return State::kOff;

    if (!g_settings->wrong.empty()) say.push_back(g_settings->wrong);
    if (const std::string error = own_log().start(g_settings->log.detail, g_settings->log.file);
        !error.empty())
        say.push_back("URGENGO_LOG_FILE: " + error + "; no log is written");
    note_start(*resolved);
    if (!g_settings->trace.empty()) {
        auto trace = observe::TraceWriter::create(g_settings->trace);
        if (trace)
            g_trace = *trace;
        else
            say.push_back("URGENGO_TRACE: " + trace.error() + "; no trace is written");
    }
    const config::NvtxEvents resolved_nvtx = resolved->config.nvtx;
    const std::string conditions = run_conditions(
        resolved->config, resolved->profile ? &*resolved->profile : nullptr, g_settings->config);
    auto& clock = *new SteadyClock;  // as the runtime, never destroyed
    g_runtime =
        new runtime::Runtime(std::move(*resolved), OwnTime::measured(available()), clock,
                             kernel_times(*g_settings, g_trace), g_settings->test_holds,
                             {g_settings->share.folder, g_settings->share.group},
                             {g_settings->records.trace, g_settings->records.flight, conditions});
    if (const std::string& note = g_runtime->observers().records.note(); !note.empty())
        say.push_back("URGENGO_RUN_TRACE: cannot be written: " + note);
    if (const std::string note = g_runtime->gate_keeper().note(); !note.empty())
        say.push_back(note);
    if (const std::string& note = g_runtime->status().note();
        !note.empty() && g_settings->share.is_asked_for)
        say.push_back(
            "the status page cannot be made, so `urgengo ctl` and `top` do not find this "
            "process: " +
            note);
    if (pthread_key_create(&g_thread_key, end_thread) != 0) return State::kOff;
    listen_to_ranges(
        {[](std::string_view name) {
             tell_ranges([&](auto& thread) { g_runtime->resolver().range_pushed(thread, name); });
         },
         [] { tell_ranges([](auto& thread) { g_runtime->resolver().range_popped(thread); }); }});
    ask_for_nvtx_events(resolved_nvtx, *g_settings);
    std::atexit(report);
    listen_to_control(*g_runtime);
    g_runtime->watch_bystanders(g_every_call.bystander_launched);
    g_every_call.changes_copies.store(g_runtime->copies().changes_any(), std::memory_order_relaxed);
    return State::kArmed;
}

void start_once(void* /*unused*/) noexcept {
    std::vector<std::string> lines;
    bool failed = false;
    {
        const std::lock_guard lock(g_start_mutex);
        if (g_every_call.state.load(std::memory_order_relaxed) != State::kCold) return;
        State state = State::kOff;
        try {
            state = make_runtime(lines);
        } catch (...) {
            failed = true;
        }
        // What made a runtime of no use was seen late: no `urgengo ctl` is to find it, or wait for
        // its answer.
        if (state == State::kOff && g_runtime) {
            g_runtime->status().retire();
            g_runtime->status().tripped();
        }
        g_every_call.this_thread =
            reinterpret_cast<char*>(&t_this) - static_cast<char*>(__builtin_thread_pointer());
        g_every_call.state.store(state, std::memory_order_release);
    }
    for (const std::string& line : lines) log_line(line);
    if (failed) log_line("could not start; the program runs as if UrgenGo were not there");
}

}  // namespace

void watch_forks() {
    pthread_atfork(nullptr, nullptr, in_forked_child);
}

void start() {
    const int saved_errno = errno;
    // Before our lock: it takes the loader's, which a library's constructor that calls us holds.
    load_real_driver();
    on_roomy_stack(start_once, nullptr);
    // Not under our lock. A tool is loaded, which may need more stack than what is ours.
    if (is_armed()) on_large_stack(start_nvtx_events, nullptr);
    errno = saved_errno;
}

void trip(const char* reason) {
    const char* none = nullptr;
    const bool is_first = g_trip_reason.compare_exchange_strong(none, reason);
    if (!is_first || !g_runtime) {
        if (g_runtime) g_runtime->stop();
        g_every_call.state.store(State::kOff, std::memory_order_release);
    } else {
        g_runtime->trip();
    }
    if (!is_first) return;
    char line[768];  // there may be no memory
    const char* const records = g_runtime ? g_runtime->observers().records.path().c_str() : "";
    std::snprintf(line, sizeof line,
                  "EXIT: %s; from here on UrgenGo only counts frames, and changes nothing%s%s",
                  reason, *records ? "; what it did before: urgengo trace info " : "", records);
    log_line(line);
}

runtime::Runtime& the_runtime() {
    return *g_runtime;
}

runtime::ThreadState* this_thread() {
    if (t_this.state) [[likely]]
        return t_this.state;
    if (t_ended) return nullptr;
    t_this.state = new runtime::ThreadState(t_this.line, gettid());
    pthread_setspecific(g_thread_key, t_this.state);
    return t_this.state;
}

}  // namespace urgengo::interposer
