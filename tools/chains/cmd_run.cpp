// SPDX-License-Identifier: Apache-2.0
//
// urgengo-chains run: runs the chains for a while and counts missed deadlines. The program is the
// same with and without UrgenGo; the only trace of it is in the hints and in the report.
#include <sys/resource.h>

#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>
#include <thread>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/chains/bystander.h"
#include "tools/chains/chain_runner.h"
#include "tools/chains/cmd.h"
#include "tools/chains/disturber.h"
#include "tools/chains/files.h"
#include "tools/chains/position_truth.h"
#include "tools/chains/scenario_options.h"
#include "tools/log/log.h"
#include "tools/results.h"
#include "urgengo_build_info.h"

namespace urgengo::chains {

namespace {

using std::chrono::nanoseconds;

// Time for all threads to start before the first frame may arrive.
constexpr std::chrono::milliseconds kLead{50};
// With fewer cores, ten chains' busy CPU segments would measure the CPU and not the GPU.
constexpr unsigned kMinCoresToSpin = 4;

// More often, and the sampling itself would be what is measured.
constexpr double kLeastSample_us = 20;

struct RunOptions {
    ScenarioOptions scenario;
    double seconds = 12;
    std::uint32_t seed = 1;
    std::string cpu = "auto";
    std::string queue = "all";
    std::string sync = "spin";
    std::string json_path;
    bool quiet = false;
    bool instances = false;
    bool verify = false;
    bool variable = false;
    bool no_hints = false;
    std::size_t frees = 0;
    std::string stamps_path;
    double sample_us = 500;
    double bystander_ms = 0;
    double bystander_every_ms = 10;
    Disturber::Options disturb;
};

std::atomic<bool> stop_requested{false};
std::atomic<bool> interrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set in a signal handler");

/// The first Ctrl-C ends the run after the frames that have begun; a second one ends the program.
void handle_interrupts() {
    struct sigaction action {};
    action.sa_handler = [](int) {
        interrupted = true;
        stop_requested = true;
    };
    action.sa_flags = SA_RESTART | SA_RESETHAND;
    sigaction(SIGINT, &action, nullptr);
}

nanoseconds from_us(double us) {
    return nanoseconds{static_cast<std::int64_t>(us * 1000)};
}

bool spin_cpu(const std::string& choice) {
    if (choice == "auto") return std::thread::hardware_concurrency() >= kMinCoresToSpin;
    return choice == "spin";
}

double process_cpu_s() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    const auto seconds = [](const timeval& time) {
        return double(time.tv_sec) + double(time.tv_usec) * 1e-6;
    };
    return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

std::string describe_urgengo(bool loaded, int status) {
    if (!loaded) return "not loaded";
    switch (status) {
        case 1:
            return "scheduling";
        case 2:
            return "observing";
        default:
            return "loaded, off";
    }
}

/// Hints that UrgenGo does not get.
ug_hints silent_hints() {
    return {[](const char*, std::int64_t, int) { return ug_instance{0}; },
            [](ug_instance, const char*) { return int{UG_CONTINUE}; }, [] {}, [] { return 0; },
            [](const char*, const char*, ug_position_t*) { return 0; }};
}

bool uses_memory_kernels(const Workload& workload) {
    for (const Chain& chain : workload.chains) {
        for (const Task& task : chain.tasks) {
            for (const Kernel& kernel : task.kernels) {
                if (kernel.kind == KernelKind::kMemory) return true;
            }
        }
    }
    return false;
}

/// Launches each kernel once: the driver loads code at its first launch, which would fall into some
/// chain's first frame.
void load_kernels(Gpu& gpu, const Workload& workload) {
    TaskStream stream(gpu);
    stream.launch(Kernel{KernelKind::kCompute});
    if (uses_memory_kernels(workload)) {
        gpu.prepare_memory_input();
        stream.launch(Kernel{KernelKind::kMemory});
    }
    stream.synchronize();
}

std::vector<std::pair<std::string, std::string>> list_parameters(const RunOptions& options,
                                                                 const Scenario& scenario,
                                                                 const Workload& workload) {
    return {{"f_a", fmt::format("{}", scenario.f_a)},
            {"f_d", fmt::format("{}", scenario.f_d)},
            {"tight", fmt::format("{}", fmt::join(scenario.tight, ","))},
            {"deadlines", scenario.deadlines ? "true" : "false"},
            {"only", fmt::format("{}", fmt::join(options.scenario.only, ","))},
            {"copies", fmt::format("{}", options.scenario.copies)},
            {"merge_tasks", options.scenario.merge_tasks ? "true" : "false"},
            {"seconds", fmt::format("{}", options.seconds)},
            {"seed", fmt::format("{}", options.seed)},
            {"threads", options.scenario.threads},
            {"cpu", options.cpu},
            {"queue", options.queue},
            {"sync", options.sync},
            {"variable", options.variable || workload.variable ? "true" : "false"},
            {"hints", options.no_hints ? "false" : "true"},
            {"frees", fmt::format("{}", options.frees)},
            {"stamps", options.stamps_path.empty() ? "false" : "true"},
            {"bystander_ms", fmt::format("{}", options.bystander_ms)},
            {"bystander_every_ms", fmt::format("{}", options.bystander_every_ms)},
            {"disturb", options.disturb.describe()},
            {"workload_gpu", workload.gpu},
            {"workload_driver", workload.driver},
            {"workload_seed", fmt::format("{}", workload.seed)},
            {"workload_umin", fmt::format("{}", workload.umin)},
            {"workload_umax", fmt::format("{}", workload.umax)},
            {"workload_gpu_scale", fmt::format("{}", workload.gpu_scale)},
            {"workload_memory_share", fmt::format("{}", workload.memory_share)}};
}

using Runners = std::vector<std::unique_ptr<ChainRunner>>;

nanoseconds deadline_of(const Chain& chain, const Scenario& scenario) {
    if (!scenario.deadlines) return nanoseconds::max();
    return nanoseconds{std::int64_t(scenario.deadline_ms(chain) * 1e6)};
}

Runners make_runners(const RunContext& context, const RunOptions& options, const Workload& workload,
                     const Scenario& scenario) {
    Runners runners;
    for (const Chain& chain : workload.chains) {
        ArrivalSettings arrivals;
        arrivals.seed = options.seed;
        arrivals.period = nanoseconds{std::int64_t(scenario.period_ms(chain) * 1e6)};
        arrivals.duration = nanoseconds{std::int64_t(options.seconds * 1e9)};
        arrivals.variable = options.variable || workload.variable;
        runners.push_back(std::make_unique<ChainRunner>(
            context, chain, plan_frames(chain, chain.place, arrivals), deadline_of(chain, scenario),
            chain.place < options.frees));
    }
    return runners;
}

void verify_results(const Runners& runners, const Workload& workload, RunReport& report) {
    const BlockValues values(workload);
    std::string detail;
    for (std::size_t i = 0; i < runners.size(); i++) {
        const Verification found = runners[i]->verify(values);
        report.checksum += found.sum;
        if (found.ok()) continue;
        detail += fmt::format(
            "{}{}: sum {:016x}, expected {:016x}, {} blocks missing, {} out of order",
            detail.empty() ? "" : "; ", workload.chains[i].name, found.sum, found.expected_sum,
            static_cast<int>(found.missing_blocks), found.misordered_blocks);
    }
    report.results = detail.empty() ? "ok" : "BAD";
    report.results_detail =
        detail.empty() ? fmt::format("checksum {:016x}", report.checksum) : detail;
}

void add_chain_reports(const Runners& runners, const Workload& workload, const Scenario& scenario,
                       RunReport& report) {
    for (std::size_t i = 0; i < runners.size(); i++) {
        const Chain& chain = workload.chains[i];
        ChainReport chain_report;
        chain_report.name = chain.name;
        chain_report.period_ms = scenario.period_ms(chain);
        chain_report.deadline_ms = scenario.deadline_ms(chain);
        chain_report.tight = scenario.is_tight(chain);
        summarize(chain_report, runners[i]->records());
        report.chains.push_back(std::move(chain_report));
    }
}

/// @returns once all frames are done, or the run was stopped and the frames begun are done
/// @throws what made a chain give up
void run_to_end(const Runners& runners, RunReport& report) {
    const double cpu_before_s = process_cpu_s();
    const auto begin = Clock::now();
    report.start = (begin + kLead).time_since_epoch();
    for (const auto& runner : runners) runner->start(begin + kLead);
    for (const auto& runner : runners) runner->join();
    report.wall_s = std::chrono::duration<double>(Clock::now() - begin).count();
    report.cpu_cores = (process_cpu_s() - cpu_before_s) / report.wall_s;
    for (const auto& runner : runners) runner->rethrow_error();
}

RunReport describe_run(const RunOptions& options, const Workload& workload,
                       const Scenario& scenario, const Gpu& gpu, const std::string& command_line) {
    RunReport report;
    report.parameters = list_parameters(options, scenario, workload);
    report.arrivals_for = from_us(options.seconds * 1e6);
    report.gpu = gpu.name();
    report.num_sms = gpu.num_sms();
    report.cuda_driver_version = gpu.cuda_driver_version();
    report.kernel_driver_version = gpu.kernel_driver_version();
    report.version = kVersion;
    report.commit = kCommit;
    report.date_utc = utc_now();
    report.command_line = command_line;
    report.cpu_segments = spin_cpu(options.cpu) ? "spin" : "sleep";
    report.results = "not checked";
    return report;
}

int run(const RunOptions& options, const std::string& command_line) {
    const Workload workload = options.scenario.load_workload();
    const Scenario scenario = options.scenario.scenario(workload);
    Gpu gpu(options.sync == "block" ? SyncMode::kBlock : SyncMode::kDriverDefault);
    if (gpu.name() != workload.gpu) {
        tools::log_warning("{} was calibrated on \"{}\", this is \"{}\": calibrate again",
                           options.scenario.workload_path, workload.gpu, gpu.name());
    }
    ug_hints urgengo{};
    const bool urgengo_loaded = ug_hints_load(&urgengo) != 0;
    const ug_hints hints = options.no_hints ? silent_hints() : urgengo;
    load_kernels(gpu, workload);

    RunReport report = describe_run(options, workload, scenario, gpu, command_line);
    RunContext context{gpu, hints, {}, stop_requested};
    context.options.threads = options.scenario.thread_mode();
    context.options.cpu_spin = spin_cpu(options.cpu);
    context.options.keep_latest = options.queue == "latest";
    context.options.stamps = !options.stamps_path.empty();
    const Runners runners = make_runners(context, options, workload, scenario);

    std::optional<PositionTruth> truth;
    if (context.options.stamps) {
        if (options.sample_us > 0 && options.sample_us < kLeastSample_us)
            throw std::runtime_error(fmt::format("--sample-us {}: accepted: 0, or {} and more",
                                                 options.sample_us, kLeastSample_us));
        check_writable(options.stamps_path);
        truth.emplace(gpu, hints, runners, from_us(options.sample_us),
                      from_us(options.seconds * 1e6), options.seed);
    }
    std::optional<Bystander> bystander;
    if (options.bystander_ms > 0)
        bystander.emplace(gpu, from_us(options.bystander_ms * 1000),
                          from_us(options.bystander_every_ms * 1000));

    std::optional<Disturber> disturber;
    if (options.disturb.seed) disturber.emplace(gpu, options.disturb);

    handle_interrupts();
    if (truth) truth->begin();
    if (bystander) bystander->start();
    if (disturber) disturber->start();
    run_to_end(runners, report);
    if (disturber) {
        disturber->stop();
        disturber->rethrow_error();
        report.disturber = disturber->calls();
    }
    if (bystander) {
        bystander->stop();
        bystander->rethrow_error();
    }
    StampsFile stamps;
    if (truth) stamps = truth->end();
    report.interrupted = interrupted;
    report.urgengo = describe_urgengo(urgengo_loaded, urgengo.status());
    add_chain_reports(runners, workload, scenario, report);
    if (options.verify && gpu.simulated()) {
        report.results_detail = "the simulated GPU computes nothing";
    } else if (options.verify) {
        verify_results(runners, workload, report);
    }

    std::fputs((options.quiet ? format_overall(report) : format_table(report)).c_str(), stdout);
    if (truth) {
        stamps.command_line = command_line;
        stamps.urgengo = report.urgengo;
        if (!options.quiet) std::fputs(describe_stamps(stamps).c_str(), stdout);
        write_file(options.stamps_path, format_stamps(stamps));
    }
    if (!options.json_path.empty()) {
        write_file(options.json_path, format_json(report, options.instances));
    }
    if (report.interrupted) return kExitInterrupted;
    return report.results == "BAD" ? kExitFailure : 0;
}

}  // namespace

void add_run(CLI::App& app, const std::string& command_line, int& exit_code) {
    auto options = std::make_shared<RunOptions>();
    CLI::App* command = app.add_subcommand("run", "Run the chains and count missed deadlines");
    options->scenario.add_to(*command);
    command->add_option("--seconds", options->seconds, "Frames arrive for this long")
        ->check(CLI::Range(0.1, 86400.0))
        ->capture_default_str();
    command->add_option("--seed", options->seed, "Seed of arrivals and CPU segments")
        ->capture_default_str();
    command
        ->add_option("--cpu", options->cpu,
                     "CPU segments compute or sleep; auto: compute on 4 or more cores")
        ->check(CLI::IsMember({"spin", "sleep", "auto"}))
        ->capture_default_str();
    command
        ->add_option(
            "--queue", options->queue,
            "Process every frame in order, or drop frames that a newer one overtakes while "
            "they wait (counted as missed)")
        ->check(CLI::IsMember({"all", "latest"}))
        ->capture_default_str();
    command
        ->add_option("--sync", options->sync,
                     "How synchronisation waits: as the driver does unasked (spin), or blocked")
        ->check(CLI::IsMember({"spin", "block"}))
        ->capture_default_str();
    command->add_option("--json", options->json_path, "Report to write");
    command->add_flag("--variable", options->variable,
                      "Inputs vary in size from frame to frame, as with `calibrate --variable`");
    command->add_flag("--no-hints", options->no_hints,
                      "Tell UrgenGo nothing about frames and tasks");
    command
        ->add_option("--frees", options->frees,
                     "The first task of so many chains, from C0 on, frees device memory behind its "
                     "launches in every frame")
        ->capture_default_str();
    command->add_flag("--instances", options->instances,
                      "Put every instance into the JSON report: thread, and when it arrived, began "
                      "(its first launch) and ended, on CLOCK_MONOTONIC");
    command->add_option(
        "--stamps", options->stamps_path,
        "File to write: when every launch began and ended on the GPU, as its own blocks say; how "
        "the clocks of GPU and host relate; and where ug_position() saw the GPU at random times");
    command
        ->add_option("--sample-us", options->sample_us,
                     "With --stamps: ask for positions so often, on average; 0: never")
        ->check(CLI::Range(0.0, 1e6))
        ->capture_default_str();
    command
        ->add_option("--bystander", options->bystander_ms,
                     "A thread that belongs to no chain fills the GPU for so many milliseconds "
                     "again and again; 0: none")
        ->check(CLI::Range(0.0, 1000.0))
        ->capture_default_str();
    command
        ->add_option("--bystander-every", options->bystander_every_ms,
                     "From one begin of that to the next, milliseconds")
        ->check(CLI::Range(0.1, 10000.0))
        ->capture_default_str();
    options->disturb.add_to(*command);
    command->add_flag("--verify", options->verify,
                      "Check that every launch ran, once and in order; exit code 1 if not");
    command->add_flag("--quiet", options->quiet, "Print the overall miss ratio only");
    command->callback(
        [options, command_line, &exit_code] { exit_code = run(*options, command_line); });
}

}  // namespace urgengo::chains
