// SPDX-License-Identifier: Apache-2.0
//
// How long a small urgent copy waits beside large ones, and what cutting those costs. An ordinary
// driver-API program of two threads: one copies 512 MB after the other to the GPU, the other 64 KB
// at random times. It runs itself for every row, bare and under UrgenGo with a config of its own,
// in turns, and prints a table:
//
//   urgengo_copy_bench --interposer lib/urgengo/libcuda.so.1 --slice-mib 2,10,32 --out copies.json
#include <cuda.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "host/base/atomic_file.h"
#include "host/config/file_text.h"
#include "host/config/resolved_config.h"
#include "tools/log/log.h"
#include "tools/results.h"
#include "urgengo/urgengo.h"

namespace urgengo::bench {
namespace {

using SteadyClock = std::chrono::steady_clock;
using Json = nlohmann::ordered_json;
constexpr std::size_t kMiB = 1 << 20;
constexpr char kUrgent[] = "ug_urgent", kBulk[] = "ug_bulk";

#define MUST(call) must((call), #call)
void must(CUresult result, const char* call) {
    if (result == CUDA_SUCCESS) return;
    tools::log_error("{} answers {}", call, static_cast<int>(result));
    std::exit(1);
}

struct Options {
    std::string interposer, out, json;
    std::vector<int> slice_mib{1, 2, 10, 32};
    int rounds = 3;
    double seconds = 3;
    std::size_t large_mib = 512, small_kib = 64;
    int behind_us = 0;
    bool to_host = false, only_held = false;
    unsigned seed = 1;
};

struct Row {
    std::string name;
    bool loaded = false;
    bool hold = false;
    int slice_mib = 0;
};

double ms_since(SteadyClock::time_point begin) {
    return std::chrono::duration<double, std::milli>(SteadyClock::now() - begin).count();
}

// --- one row, in this process

/// What one thread copies: device memory, page-locked host memory, and a stream.
class Copier {
  public:
    Copier(const char* name, std::size_t bytes, bool to_host)
        : name_(name), bytes_(bytes), to_host_(to_host) {
        MUST(cuMemAlloc(&device_, bytes));
        MUST(cuMemHostAlloc(&host_, bytes, CU_MEMHOSTALLOC_PORTABLE));
        MUST(cuStreamCreate(&stream_, CU_STREAM_NON_BLOCKING));
    }
    /// One copy, waited for, as an instance of the thread's chain if UrgenGo is there.
    /// @param behind  what its stream is busy with before, as with a kernel
    /// @returns how long it took from then on, ms
    double copy(const ug_hints* hints, std::chrono::microseconds behind = {}) {
        if (hints) hints->task_begin(hints->arrival(name_, 0, UG_CLOCK_MONOTONIC), name_);
        behind_ = behind;
        if (behind.count() > 0) MUST(cuLaunchHostFunc(stream_, &Copier::be_busy, this));
        const auto begin = SteadyClock::now();
        if (to_host_)
            MUST(cuMemcpyDtoHAsync(host_, device_, bytes_, stream_));
        else
            MUST(cuMemcpyHtoDAsync(device_, host_, bytes_, stream_));
        called_ms_ = ms_since(begin);
        MUST(cuStreamSynchronize(stream_));
        const double ms = ms_since(behind.count() > 0 ? reached_ : begin);
        if (hints) hints->task_end();
        return ms;
    }
    double called_ms() const { return called_ms_; }

  private:
    static void CUDA_CB be_busy(void* copier) {
        auto& self = *static_cast<Copier*>(copier);
        std::this_thread::sleep_for(self.behind_);
        self.reached_ = SteadyClock::now();
    }

    const char* name_;
    std::size_t bytes_;
    bool to_host_;
    CUdeviceptr device_ = 0;
    void* host_ = nullptr;
    CUstream stream_ = nullptr;
    double called_ms_ = 0;
    std::chrono::microseconds behind_{};
    SteadyClock::time_point reached_;
};

Json run_row(const Options& options) {
    prctl(PR_SET_NAME, kBulk);
    CUdevice device = 0;
    CUcontext context = nullptr;
    char gpu[256] = {};
    MUST(cuInit(0));
    MUST(cuDeviceGet(&device, 0));
    MUST(cuDeviceGetName(gpu, sizeof gpu - 1, device));
    MUST(cuDevicePrimaryCtxRetain(&context, device));
    MUST(cuCtxSetCurrent(context));
    ug_hints loaded;
    const bool there = ug_hints_load(&loaded);
    const ug_hints* hints = there ? &loaded : nullptr;
    Copier large(kBulk, options.large_mib * kMiB, options.to_host);
    Copier small(kUrgent, options.small_kib * 1024, options.to_host);
    for (int i = 0; i < 3; ++i) large.copy(hints);

    std::vector<double> alone_ms, beside_ms, call_ms, wait_ms, idle_ms;
    auto begin = SteadyClock::now();
    while (ms_since(begin) < options.seconds * 300) alone_ms.push_back(large.copy(hints));

    const std::chrono::microseconds behind(options.behind_us);
    std::atomic<bool> done{false}, idle{true};
    std::thread urgent([&] {
        prctl(PR_SET_NAME, kUrgent);
        MUST(cuCtxSetCurrent(context));
        std::mt19937 random(options.seed);
        std::uniform_real_distribution<double> pause_ms(5, 40);
        for (int i = 0; i < 20; ++i) idle_ms.push_back(small.copy(hints, behind));
        idle = false;
        while (!done) {
            std::this_thread::sleep_for(
                std::chrono::duration<double, std::milli>(pause_ms(random)));
            wait_ms.push_back(small.copy(hints, behind));
        }
    });
    while (idle) std::this_thread::yield();
    begin = SteadyClock::now();
    while (ms_since(begin) < options.seconds * 1000) {
        beside_ms.push_back(large.copy(hints));
        call_ms.push_back(large.called_ms());
    }
    done = true;
    urgent.join();
    const char* status = !there                 ? "not loaded"
                         : loaded.status() == 1 ? "scheduling"
                                                : "loaded, off";
    return {{"gpu", gpu},           {"urgengo", status},
            {"alone_ms", alone_ms}, {"beside_ms", beside_ms},
            {"call_ms", call_ms},   {"wait_ms", wait_ms},
            {"idle_ms", idle_ms}};
}

// --- all rows

std::string config_of(const Row& row) {
    config::Config config;
    for (const auto& [name, deadline] :
         {std::pair{kUrgent, std::chrono::milliseconds(20)}, {kBulk, std::chrono::seconds(10)}}) {
        config::Chain chain;
        chain.name = name;
        chain.period = chain.deadline = deadline;
        chain.tasks = {{name, name}};
        config.chains.push_back(chain);
    }
    config.scheduler.copies.hold = row.hold;
    config.scheduler.copies.slice_bytes = static_cast<std::int64_t>(row.slice_mib) * 1'048'576;
    return config::to_resolved_json(config, nullptr, {});
}

/// Runs this program again. @returns what it wrote; ends the program if it failed
Json run_child(const Options& options, const Row& row, const std::string& folder) {
    const std::string json = folder + "/run.json", config = folder + "/config.json",
                      stats = folder + "/stats.json";
    std::vector<std::string> arguments{"/proc/self/exe",
                                       "--json",
                                       json,
                                       "--seconds",
                                       fmt::format("{}", options.seconds),
                                       "--large-mib",
                                       fmt::format("{}", options.large_mib),
                                       "--small-kib",
                                       fmt::format("{}", options.small_kib),
                                       "--behind-us",
                                       std::to_string(options.behind_us),
                                       "--seed",
                                       std::to_string(options.seed)};
    if (options.to_host) arguments.push_back("--to-host");
    if (row.loaded && !write_file_atomically(config, config_of(row))) std::exit(1);
    const pid_t child = fork();
    if (child == 0) {
        if (row.loaded) {
            setenv("LD_PRELOAD", options.interposer.c_str(), 1);
            setenv("URGENGO_CONFIG", config.c_str(), 1);
            setenv("URGENGO_STATS", stats.c_str(), 1);
        }
        std::vector<char*> argv;
        for (std::string& argument : arguments) argv.push_back(argument.data());
        argv.push_back(nullptr);
        execv(argv[0], argv.data());
        _exit(127);
    }
    int status = 0;
    const bool ran = child > 0 && waitpid(child, &status, 0) == child && status == 0;
    const auto read = [](const std::string& path) {
        const auto text = config::read_file(path);
        return text ? Json::parse(*text, nullptr, false) : Json();
    };
    Json run = ran ? read(json) : Json();
    if (!run.is_object() || run.at("urgengo") != (row.loaded ? "scheduling" : "not loaded")) {
        tools::log_error("{}: the run failed, or UrgenGo was {}", row.name,
                         run.is_object() ? run.at("urgengo").get<std::string>() : "not heard of");
        std::exit(1);
    }
    if (row.loaded) run["chains"] = read(stats).at("chains");
    return run;
}

double at(std::vector<double> values, double share) {
    if (values.empty()) return 0;
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

std::vector<double> all_of(const std::vector<Json>& runs, const char* what) {
    std::vector<double> all;
    for (const Json& run : runs)
        for (const double value : run.at(what)) all.push_back(value);
    return all;
}

std::uint64_t sum_of(const std::vector<Json>& runs, const char* counter) {
    std::uint64_t sum = 0;
    for (const Json& run : runs)
        if (run.contains("chains"))
            for (const Json& chain : run.at("chains"))
                sum += chain.at(counter).get<std::uint64_t>();
    return sum;
}

int run_all(const Options& options, const std::vector<std::string>& command) {
    std::vector<Row> rows{{"bare"}};
    if (!options.only_held) rows.push_back({"copies off", true});
    for (const int mib : options.slice_mib)
        if (!options.only_held)
            rows.push_back({fmt::format("cut at {} MiB", mib), true, false, mib});
    for (const int mib : options.slice_mib)
        rows.push_back({fmt::format("held, cut at {} MiB", mib), true, true, mib});
    char folder[] = "/tmp/urgengo_copy_bench_XXXXXX";
    if (!mkdtemp(folder)) return 1;
    std::vector<std::vector<Json>> runs(rows.size());
    for (int round = 1; round <= options.rounds; ++round)
        for (std::size_t r = 0; r < rows.size(); ++r) {
            tools::log_info("[{}/{}] {}", round, options.rounds, rows[r].name);
            runs[r].push_back(run_child(options, rows[r], folder));
        }
    const std::string remove = fmt::format("{}/", folder);
    for (const char* file : {"run.json", "config.json", "stats.json"})
        unlink((remove + file).c_str());
    rmdir(folder);

    fmt::print("GPU: {}\n{} MiB copies, and {} KiB beside them{}, {}\n\n",
               runs[0][0].at("gpu").get<std::string>(), options.large_mib, options.small_kib,
               options.behind_us > 0 ? fmt::format(", behind {} us", options.behind_us) : "",
               options.to_host ? "to the host" : "to the GPU");
    fmt::print("{:<22}{:>30}{:>26}{:>12}{:>10}{:>8}{:>8}\n", "", "small: ms median, p99, max",
               "large: ms alone, beside", "of bare", "in call", "cut", "holds");
    const double bare_alone = at(all_of(runs[0], "alone_ms"), 0.5);
    const double bare_beside = at(all_of(runs[0], "beside_ms"), 0.5);
    Json json_rows = Json::array();
    for (std::size_t r = 0; r < rows.size(); ++r) {
        const auto wait = all_of(runs[r], "wait_ms");
        const double alone = at(all_of(runs[r], "alone_ms"), 0.5);
        const double beside = at(all_of(runs[r], "beside_ms"), 0.5);
        fmt::print(
            "{:<22}{:>10.3f}{:>10.3f}{:>10.3f}{:>13.3f}{:>13.3f}{:>6.3f}{:>6.3f}{:>10.3f}"
            "{:>8}{:>8}\n",
            rows[r].name, at(wait, 0.5), at(wait, 0.99), at(wait, 1), alone, beside,
            alone / bare_alone, beside / bare_beside, at(all_of(runs[r], "call_ms"), 0.5),
            sum_of(runs[r], "copies_cut"), sum_of(runs[r], "holds"));
        json_rows.push_back({{"row", rows[r].name},
                             {"hold", rows[r].hold},
                             {"slice_mib", rows[r].slice_mib},
                             {"runs", runs[r]}});
    }
    if (options.out.empty()) return 0;
    const Json json{{"format_version", 1},
                    {"program", "urgengo_copy_bench"},
                    {"gpu", runs[0][0].at("gpu")},
                    {"date_utc", utc_now()},
                    {"command_line", command_line_for_results(command)},
                    {"large_mib", options.large_mib},
                    {"small_kib", options.small_kib},
                    {"to_host", options.to_host},
                    {"behind_us", options.behind_us},
                    {"rows", std::move(json_rows)}};
    const auto written = write_file_atomically(options.out, json.dump(1) + "\n");
    if (!written) tools::log_error("{}", written.error());
    return written ? 0 : 1;
}

}  // namespace
}  // namespace urgengo::bench

int main(int argc, char** argv) {
    using namespace urgengo::bench;
    urgengo::tools::set_log_name("urgengo_copy_bench");
    Options options;
    CLI::App app("Times a small copy beside large ones, bare and under UrgenGo.",
                 "urgengo_copy_bench");
    app.add_option("--interposer", options.interposer, "UrgenGo's libcuda.so.1");
    app.add_option("--slice-mib", options.slice_mib, "Sizes of slices [1,2,10,32]")
        ->delimiter(',')
        ->check(CLI::Range(1, 1024));
    app.add_option("--rounds", options.rounds, "Runs of each row, in turns [3]")
        ->check(CLI::Range(1, 1000));
    app.add_option("--seconds", options.seconds, "Length of a run [3]")
        ->check(CLI::Range(0.01, 600.0));
    app.add_option("--large-mib", options.large_mib, "The large copy [512]")
        ->check(CLI::Range(1, 16384));
    app.add_option("--small-kib", options.small_kib, "The small one [64]")
        ->check(CLI::Range(1, 1048576));
    app.add_option("--behind-us", options.behind_us,
                   "The small one's stream is busy for so long before, which is not counted [0]")
        ->check(CLI::Range(0, 1'000'000));
    app.add_flag("--only-held", options.only_held, "Bare and held rows only");
    app.add_flag("--to-host", options.to_host, "Both to the host instead of to the GPU");
    app.add_option("--seed", options.seed, "Of the small copies' times [1]");
    app.add_option("--out", options.out, "Write every run as JSON");
    app.add_option("--json", options.json, "Only run in this process, and write that");
    CLI11_PARSE(app, argc, argv);
    if (!options.json.empty())
        return urgengo::write_file_atomically(options.json, run_row(options).dump() + "\n") ? 0 : 1;
    if (options.interposer.empty()) {
        urgengo::tools::log_error(
            "found no --interposer, accepted: the path of lib/urgengo/libcuda.so.1");
        return 1;
    }
    return run_all(options, {argv, argv + argc});
}
