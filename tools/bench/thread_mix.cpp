// SPDX-License-Identifier: Apache-2.0
//
// Chains as threads of one program, as a spec draws them (thread_mix_spec.h): over one stream or
// several, with a mutex that some of them hold while they launch or until they are done, with waits
// for one another's frames, beside a thread of no chain. It counts what is missed and knows of no
// scheduler.
//
// A frame that finds its thread busy waits; where more than two have arrived when the thread
// becomes free, the oldest are skipped, which is missed. An ordinary driver-API program, for
// sweep.py.
#include <cuda.h>
#include <fmt/format.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <climits>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "host/base/atomic_file.h"
#include "tools/bench/thread_mix_gpu.h"
#include "tools/bench/thread_mix_spec.h"
#include "tools/log/log.h"

namespace urgengo::bench {
namespace {

using SteadyClock = std::chrono::steady_clock;
using Milliseconds = std::chrono::duration<double, std::milli>;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMostWaiting = 2;
constexpr char kBystander[] = "background";

struct Options {
    std::string spec, json;
    double seconds = 4, warmup_s = 0.3, jitter_ms = 3;
    unsigned seed = 1;
    std::size_t stack_kib = 8192;
};

SteadyClock::time_point after(SteadyClock::time_point begin, double ms) {
    return begin + std::chrono::duration_cast<SteadyClock::duration>(Milliseconds(ms));
}

class ChainThread {
  public:
    ChainThread(const MixGpu& gpu, const MixChain& chain, int number, std::mutex& shared)
        : gpu_(gpu), chain_(chain), number_(number), shared_(shared), done_(gpu.make_event()) {
        for (int i = 0; i < chain.streams; ++i) {
            streams_.push_back(gpu.make_stream());
            joins_.push_back(gpu.make_event());
        }
        fork_ = gpu.make_event();
    }

    /// Recorded behind each of its frames.
    CUevent done() const { return done_; }
    void wait_for(CUevent event) { waits_for_ = event; }

    void plan(const Options& options, SteadyClock::time_point begin) {
        std::seed_seq seed{options.seed, static_cast<unsigned>(number_)};
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> jitter(0, std::max(1e-9, options.jitter_ms));
        const double end_ms = (options.warmup_s + options.seconds) * 1000;
        for (double ms = chain_.offset_ms; ms < end_ms; ms += chain_.period_ms) {
            dues_.push_back(after(begin, ms + jitter(random)));
        }
        count_from_ = after(begin, options.warmup_s * 1000);
    }

    void run() {
        prctl(PR_SET_NAME, chain_.name.c_str());
        gpu_.make_current();
        for (std::size_t i = 0; i < dues_.size(); ++i) {
            const auto now = SteadyClock::now();
            if (dues_[i] > now) {
                std::this_thread::sleep_until(dues_[i]);
            } else if (i + kMostWaiting < dues_.size() && dues_[i + kMostWaiting] <= now) {
                count(i, true, 0);
                continue;
            }
            frame();
            count(i, false, Milliseconds(SteadyClock::now() - dues_[i]).count());
        }
    }

    Json report() {
        std::sort(latencies_ms_.begin(), latencies_ms_.end());
        const auto at = [&](double share) {
            if (latencies_ms_.empty()) return 0.0;
            return latencies_ms_[static_cast<std::size_t>(
                share * static_cast<double>(latencies_ms_.size() - 1))];
        };
        return {{"name", chain_.name},
                {"frames", frames_},
                {"missed", missed_},
                {"skipped", skipped_},
                {"latency_ms", {{"p50", at(0.5)}, {"p99", at(0.99)}, {"max", at(1)}}}};
    }

  private:
    void launch_all() {
        const CUstream first = streams_.front();
        if (waits_for_) MIX_MUST(cuStreamWaitEvent(first, waits_for_, 0));
        const std::size_t num_streams = streams_.size();
        if (num_streams > 1) {
            MIX_MUST(cuEventRecord(fork_, first));
            for (std::size_t i = 1; i < num_streams; ++i) {
                MIX_MUST(cuStreamWaitEvent(streams_[i], fork_, 0));
            }
        }
        for (int i = 0; i < chain_.kernels; ++i) {
            gpu_.launch(number_, chain_.kernel_us,
                        streams_[static_cast<std::size_t>(i) % num_streams]);
        }
        for (std::size_t i = 1; i < num_streams; ++i) {
            MIX_MUST(cuEventRecord(joins_[i], streams_[i]));
            MIX_MUST(cuStreamWaitEvent(first, joins_[i], 0));
        }
        MIX_MUST(cuEventRecord(done_, first));
    }

    void frame() {
        std::unique_lock lock(shared_, std::defer_lock);
        if (chain_.locks != MixLock::kNever) lock.lock();
        launch_all();
        if (chain_.locks == MixLock::kLaunching) lock.unlock();
        MIX_MUST(cuStreamSynchronize(streams_.front()));
    }

    void count(std::size_t frame, bool skipped, double latency_ms) {
        if (dues_[frame] < count_from_) return;
        ++frames_;
        skipped_ += skipped;
        missed_ += skipped || latency_ms > chain_.deadline_ms;
        if (!skipped) latencies_ms_.push_back(latency_ms);
    }

    const MixGpu& gpu_;
    const MixChain& chain_;
    int number_;
    std::mutex& shared_;
    std::vector<CUstream> streams_;
    std::vector<CUevent> joins_;
    CUevent fork_ = nullptr, done_, waits_for_ = nullptr;
    std::vector<SteadyClock::time_point> dues_;
    SteadyClock::time_point count_from_;
    std::vector<double> latencies_ms_;
    long frames_ = 0, missed_ = 0, skipped_ = 0;
};

void run_bystander(const MixGpu& gpu, const MixBystander& its, int number,
                   const std::atomic<bool>& over) {
    prctl(PR_SET_NAME, kBystander);
    gpu.make_current();
    const CUstream stream = gpu.make_stream();
    while (!over.load(std::memory_order_relaxed)) {
        for (int i = 0; i < its.kernels; ++i) gpu.launch(number, its.kernel_us, stream);
        MIX_MUST(cuStreamSynchronize(stream));
    }
}

/// A chain's thread on a stack of its own, which knows how much of it was used.
class StackedThread {
  public:
    /// @param kib  from 16
    StackedThread(ChainThread& chain, std::size_t kib) : bytes_(kib * 1024) {
        const std::size_t all = kGuardBytes + bytes_;
        void* memory =
            mmap(nullptr, all, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        pthread_attr_t attributes;
        pthread_attr_init(&attributes);
        if (memory == MAP_FAILED || mprotect(memory, kGuardBytes, PROT_NONE) != 0)
            throw std::system_error(errno, std::generic_category(), "mmap");
        stack_ = static_cast<unsigned char*>(memory) + kGuardBytes;
        std::fill_n(stack_, bytes_, kUnused);
        if (pthread_attr_setstack(&attributes, stack_, bytes_) != 0)
            throw std::runtime_error(fmt::format("--stack-kib: found {}, accepted: from {}", kib,
                                                 PTHREAD_STACK_MIN / 1024));
        const auto run = [](void* its) -> void* {
            static_cast<ChainThread*>(its)->run();
            return nullptr;
        };
        if (const int error = pthread_create(&thread_, &attributes, run, &chain))
            throw std::system_error(error, std::generic_category(), "pthread_create");
    }
    /// @returns how many bytes it has used, thread-local storage included
    std::size_t join() {
        pthread_join(thread_, nullptr);
        const auto* end = stack_ + bytes_;
        return static_cast<std::size_t>(
            end - std::find_if(stack_, stack_ + bytes_, [](auto b) { return b != kUnused; }));
    }

  private:
    static constexpr std::size_t kGuardBytes = 65536;
    static constexpr unsigned char kUnused = 0xA5;
    std::size_t bytes_;
    unsigned char* stack_ = nullptr;
    pthread_t thread_{};
};

Json run(const MixSpec& spec, const Options& options) {
    const MixGpu gpu;
    std::mutex shared;
    std::vector<std::unique_ptr<ChainThread>> chains;
    std::map<std::string, CUevent> done;
    for (const MixChain& chain : spec.chains) {
        chains.push_back(
            std::make_unique<ChainThread>(gpu, chain, static_cast<int>(chains.size()), shared));
        done[chain.name] = chains.back()->done();
    }
    const auto begin = after(SteadyClock::now(), 50);
    for (std::size_t i = 0; i < chains.size(); ++i) {
        if (!spec.chains[i].waits_for.empty()) chains[i]->wait_for(done[spec.chains[i].waits_for]);
        chains[i]->plan(options, begin);
    }
    std::atomic<bool> over = false;
    std::thread bystander;
    if (spec.bystander) {
        bystander = std::thread(
            [&] { run_bystander(gpu, *spec.bystander, static_cast<int>(chains.size()), over); });
    }
    std::vector<StackedThread> threads;
    for (auto& chain : chains) threads.emplace_back(*chain, options.stack_kib);
    std::vector<std::size_t> stack_bytes;
    for (StackedThread& thread : threads) stack_bytes.push_back(thread.join());
    over = true;
    if (bystander.joinable()) bystander.join();

    Json report = {{"gpu", gpu.name()}, {"seed", options.seed}, {"seconds", options.seconds}};
    double sum_pct = 0;
    for (std::size_t i = 0; i < chains.size(); ++i) {
        Json its = chains[i]->report();
        its["stack_bytes"] = stack_bytes[i];
        sum_pct += 100 * its["missed"].get<double>() / std::max(1.0, its["frames"].get<double>());
        report["chains"].push_back(std::move(its));
    }
    report["overall_miss_pct"] =
        sum_pct / static_cast<double>(std::max<std::size_t>(1, chains.size()));
    return report;
}

}  // namespace
}  // namespace urgengo::bench

int main(int argc, char** argv) {
    using namespace urgengo::bench;
    urgengo::tools::set_log_name("urgengo_thread_mix");
    Options options;
    CLI::App app{"Chains as threads of one program, as a JSON spec says; counts what is missed"};
    app.add_option("--spec", options.spec, "What the threads do")->required();
    app.add_option("--seconds", options.seconds, "That count [4]");
    app.add_option("--warmup", options.warmup_s, "Seconds before them [0.3]");
    app.add_option("--jitter-ms", options.jitter_ms, "Each frame comes so much late at most [3]");
    app.add_option("--seed", options.seed, "Of the jitter [1]");
    app.add_option("--stack-kib", options.stack_kib, "Of each chain's thread [8192]");
    app.add_option("--json", options.json, "Write the report to this file as well");
    CLI11_PARSE(app, argc, argv);
    try {
        const MixSpec spec = read_mix_spec(options.spec);
        const Json report = run(spec, options);
        for (const Json& its : report["chains"]) {
            fmt::print(
                "{:<15} frames {:>5} missed {:>5}  p50 {:>8.2f} p99 {:>8.2f} max {:>8.2f} ms, "
                "stack {} bytes\n",
                its["name"].get<std::string>(), its["frames"].get<long>(),
                its["missed"].get<long>(), its["latency_ms"]["p50"].get<double>(),
                its["latency_ms"]["p99"].get<double>(), its["latency_ms"]["max"].get<double>(),
                its["stack_bytes"].get<std::size_t>());
        }
        if (options.json.empty()) return 0;
        const auto written = urgengo::write_file_atomically(options.json, report.dump(1) + "\n");
        if (written) return 0;
        urgengo::tools::log_error("{}", written.error());
    } catch (const std::exception& error) {
        urgengo::tools::log_error("{}", error.what());
    }
    return 1;
}
