// SPDX-License-Identifier: Apache-2.0
//
// Times are whole tenths of a microsecond, so that another C library's logarithm changes nothing.
#include "tests/support/lockstep_chains.h"

#include <array>
#include <cmath>
#include <fstream>
#include <memory>
#include <random>
#include <span>
#include <vector>

#include <fmt/format.h>

#include "host/config/resolved_config.h"
#include "host/runtime/as_planned.h"
#include "host/runtime/runtime.h"
#include "tests/support/lockstep_gpu.h"
#include "tools/chains/arrivals.h"
#include "tools/chains/kernel_mix.h"
#include "tools/chains/scenario.h"

namespace urgengo::testing {
namespace {

using runtime::Launch;
using runtime::Runtime;
using runtime::ThreadState;

constexpr nanoseconds kLaunch{2'300};        ///< what a launch takes of its thread
constexpr nanoseconds kSlowLaunch{150'000};  ///< of a launch-bound one
constexpr int kNumStreams = 4;               ///< of a task that forks
constexpr double kNoise = 0.1;  ///< kernels take so much more or less, a frame's all alike
constexpr std::array kLockers = {0, 2, 4};
const CUfunction kCompute = reinterpret_cast<CUfunction>(0x10);

nanoseconds rounded_us(double us) {
    return nanoseconds(100 * std::max(1L, std::lround(us * 10)));
}

chains::Workload ten_chains() {
    chains::MixSettings mix;
    mix.gpu_scale = 0.75;
    chains::Workload workload;
    for (const chains::ChainSpec& spec : chains::paper_chains()) {
        chains::Chain chain{spec.name, spec.period_ms, spec.deadline_ms, {}};
        chain.place = workload.chains.size();
        for (const chains::TaskSpec& task : spec.tasks)
            chain.tasks.push_back(
                chains::build_task(task, spec.cpu_ms / double(spec.tasks.size()),
                                   chains::task_seed(7, chain.place, chain.tasks.size()), mix,
                                   {1, 1}, LockstepGpu::kNumSms));
        workload.chains.push_back(chain);
    }
    return workload;
}

std::uint64_t waves(const chains::Kernel& kernel) {
    constexpr std::uint64_t kRoom = LockstepGpu::kNumSms * LockstepGpu::kBlocksPerSm;
    return (static_cast<std::uint64_t>(kernel.grid) + kRoom - 1) / kRoom;
}

config::TaskProfile profile_of(const chains::Task& task, bool forks, nanoseconds launch) {
    config::TaskProfile profile;
    profile.name = task.name;
    profile.cpu_time = rounded_us(task.cpu_ms * 1000);
    std::uint32_t i = 0;
    for (const chains::Kernel& kernel : task.kernels) {
        config::KernelProfile its{chains::kernel_name(kernel.kind),
                                  static_cast<std::uint64_t>(kernel.grid),
                                  static_cast<std::uint32_t>(kernel.block),
                                  rounded_us(kernel.est_us),
                                  kernel.utilization,
                                  10,
                                  i * launch,
                                  forks ? i % kNumStreams : 0};
        profile.kernels.push_back(its);
        ++i;
    }
    profile.segments = {{profile.cpu_time, i, i, i, "stream", rounded_us(task.isolated_ms * 1000)}};
    return profile;
}

class Program {
  public:
    explicit Program(const LockstepScenario& scenario)
        : scenario_(scenario), workload_(ten_chains()) {
        if (!scenario.log_path.empty()) log_.open(scenario.log_path);
        factors_.f_a = scenario.f_a;
        factors_.f_d = scenario.f_d;
        factors_.tight = chains::tight_chains(0.4);
        gpu_.driver.names[kCompute] = chains::kernel_name(chains::KernelKind::kCompute);
        gpu_.on_mark = [this](CUstream stream, std::uint64_t word0) {
            ++outcome_.marks;
            note(fmt::format("{} mark {} {:x}", gpu_.threads.now().count(), id(stream), word0));
        };
    }

    LockstepOutcome run() {
        runtime_ = std::make_unique<Runtime>(resolved(), gpu_.driver.api, gpu_.threads);
        for (const chains::Chain& chain : workload_.chains)
            gpu_.threads.add([this, &chain] { run_chain(chain); });
        if (scenario_.bystander) gpu_.threads.add([this] { run_bystander(); });
        gpu_.threads.run();
        return outcome_;
    }

  private:
    /// A thread of the program's, and its streams.
    struct Thread {
        ThreadState state{};
        int index = 0;
        std::vector<CUevent> events{};

        CUstream stream(std::size_t branch = 0) const {
            return reinterpret_cast<CUstream>(0x1000 + 0x100 * std::uint64_t(index) +
                                              0x10 * branch);
        }
    };
    static std::uint64_t id(CUstream stream) { return reinterpret_cast<std::uint64_t>(stream); }

    nanoseconds period(const chains::Chain& chain) const {
        return rounded_us(factors_.period_ms(chain) * 1000);
    }
    nanoseconds deadline(const chains::Chain& chain) const {
        return rounded_us(factors_.deadline_ms(chain) * 1000);
    }

    nanoseconds launch_time(std::size_t place) const {
        return scenario_.launch_bound && place % 2 == 1 ? kSlowLaunch : kLaunch;
    }

    config::ResolvedConfig resolved() const {
        config::ResolvedConfig resolved;
        config::Profile profile;
        resolved.config.scheduler = scenario_.scheduler;
        for (const chains::Chain& chain : workload_.chains) {
            config::Chain its;
            its.name = chain.name;
            its.period = period(chain);
            its.deadline = deadline(chain);
            its.on_late = config::OnLate::kExit;
            its.arrival = config::ArrivalFrom::kHint;
            config::ChainProfile profiled{chain.name, {}};
            for (const chains::Task& task : chain.tasks) {
                its.tasks.push_back({task.name, chain.name + "*"});
                profiled.tasks.push_back(
                    profile_of(task, scenario_.forks, launch_time(chain.place)));
            }
            resolved.config.chains.push_back(its);
            profile.chains.push_back(profiled);
        }
        if (scenario_.has_profile) resolved.profile = profile;
        return resolved;
    }

    void run_chain(const chains::Chain& chain) {
        Thread thread;
        thread.index = static_cast<int>(chain.place);
        for (int i = 0; i < kNumStreams; ++i) thread.events.push_back(gpu_.create_event());
        std::mt19937 random(scenario_.seed * 100 + static_cast<std::uint32_t>(chain.place));
        const auto frames = chains::plan_frames(
            chain, chain.place, {scenario_.seed, period(chain), scenario_.duration, false});
        for (const chains::PlannedFrame& frame : frames) {
            const nanoseconds arrival = Lockstep::kStart + frame.arrival / 100 * 100;
            if (gpu_.threads.now() < arrival) gpu_.threads.sleep_for(arrival - gpu_.threads.now());
            const double factor = 1 - kNoise + 2 * kNoise * double(random() % 1001) / 1000;
            const bool is_over = run_frame(thread, chain, frame, arrival, factor);
            ++outcome_.frames;
            outcome_.missed += !is_over || gpu_.threads.now() > arrival + deadline(chain);
        }
        runtime_->thread_exit(thread.state);
    }

    /// @returns whether it came to its end
    bool run_frame(Thread& thread, const chains::Chain& chain, const chains::PlannedFrame& frame,
                   nanoseconds arrival, double factor) {
        const std::uint64_t instance =
            runtime_->frames().arrival(&thread.state, chain.name.c_str(), arrival);
        for (std::size_t i = 0; i < chain.tasks.size(); ++i) {
            if (runtime_->frames().task_begin(thread.state, instance, chain.tasks[i].name.c_str()))
                return false;
            gpu_.threads.sleep_for(frame.cpu[i] / 100 * 100);
            run_task(thread, chain.tasks[i], factor);
            runtime_->frames().task_end(thread.state);
        }
        return true;
    }

    void run_task(Thread& thread, const chains::Task& task, double factor) {
        const bool locks = scenario_.locks && std::find(kLockers.begin(), kLockers.end(),
                                                        thread.index) != kLockers.end();
        while (locks && is_locked_) gpu_.threads.wait_for([this] { return !is_locked_; });
        is_locked_ = is_locked_ || locks;
        std::size_t i = 0;
        for (const chains::Kernel& kernel : task.kernels) {
            const nanoseconds block = rounded_us(kernel.est_us * factor / double(waves(kernel)));
            const std::size_t branch = scenario_.forks ? i % kNumStreams : 0;
            launch(thread, thread.stream(branch),
                   {kCompute, static_cast<std::uint64_t>(kernel.grid), block});
            if (i++ == 0 && scenario_.forks)
                for (std::size_t b = 1; b < kNumStreams; ++b) order(thread, 0, b);
        }
        for (std::size_t b = 1; scenario_.forks && b < kNumStreams; ++b) order(thread, b, 0);
        is_locked_ = is_locked_ && !locks;

        runtime::Wait wait;
        wait.stream = thread.stream();
        runtime_->waits().before(thread.state, wait);
        gpu_.synchronize(thread.stream());
        runtime_->waits().after(thread.state, wait, true);
    }

    /// Lets what is launched on one branch from now on wait for what is on the other.
    void order(Thread& thread, std::size_t first, std::size_t then) {
        constexpr auto kFlavor = exec::StreamFlavor::kLegacy;
        const CUevent event = thread.events[first];
        gpu_.record(event, thread.stream(first));
        runtime_->waits().event_recorded(thread.state, event, thread.stream(first), kFlavor, false);
        runtime_->work_on_streams().stream_waits(thread.state, thread.stream(then), kFlavor, event);
        gpu_.wait_event(thread.stream(then), event);
    }

    // As interposer/manual/launch.cpp does it.
    void launch(Thread& thread, CUstream stream, const LockstepGpu::Kernel& kernel) {
        const Launch launch{kernel.function, kernel.grid, chains::kBlockThreads, stream};
        const nanoseconds asked = gpu_.threads.now();
        if (runtime_->planned().goes(thread.state, launch)) {
            const auto& planned = thread.state.line.as_planned;
            forward(thread, stream, kernel, asked, planned.set_priority ? planned.priority : 0);
            return runtime::went_as_planned(thread.state.line);
        }
        const runtime::Grant grant = runtime_->launches().before(thread.state, launch);
        forward(thread, stream, kernel, asked, grant.set_priority ? grant.priority : 0);
        if (grant.task) runtime_->launches().after(thread.state, launch, grant, true);
    }

    void forward(Thread& thread, CUstream stream, const LockstepGpu::Kernel& kernel,
                 nanoseconds asked, int priority) {
        const nanoseconds now = gpu_.threads.now();
        ++outcome_.launches;
        outcome_.held_us += static_cast<std::uint64_t>((now - asked).count() / 1000);
        note(fmt::format("{} thread {} launch {} on {} at {} after {}", now.count(), thread.index,
                         thread.state.line.launches, id(stream), priority, (now - asked).count()));
        gpu_.launch(stream, kernel, priority);
        gpu_.threads.sleep_for(launch_time(static_cast<std::size_t>(thread.index)));
    }

    void run_bystander() {
        Thread thread;
        thread.index = static_cast<int>(workload_.chains.size());
        while (gpu_.threads.now() < Lockstep::kStart + scenario_.duration) {
            for (int i = 0; i < 5; ++i)
                launch(thread, thread.stream(), {kCompute, 300, std::chrono::microseconds(200)});
            gpu_.synchronize(thread.stream());
            gpu_.threads.sleep_for(std::chrono::milliseconds(3));
        }
        runtime_->thread_exit(thread.state);
    }

    void note(const std::string& line) {
        constexpr std::uint64_t kFnvPrime = 0x100000001b3;
        for (const char c : line)
            outcome_.hash = (outcome_.hash ^ static_cast<unsigned char>(c)) * kFnvPrime;
        if (log_.is_open()) log_ << line << '\n';
    }

    const LockstepScenario& scenario_;
    const chains::Workload workload_;
    chains::Scenario factors_;
    LockstepGpu gpu_;
    std::unique_ptr<Runtime> runtime_;
    bool is_locked_ = false;
    std::ofstream log_;
    LockstepOutcome outcome_{.hash = 0xcbf29ce484222325};
};

}  // namespace

LockstepOutcome run_lockstep(const LockstepScenario& scenario) {
    return Program(scenario).run();
}

}  // namespace urgengo::testing
