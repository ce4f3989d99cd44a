// SPDX-License-Identifier: Apache-2.0
//
// Which calls of the driver API wait for a kernel that does not end, or for a gate that does not
// open, in another stream (parking_table.h)? And do they wait for UrgenGo's under UrgenGo?
//
//   parking bare            each call beside a kernel that spins, and beside a closed gate
//   parking rounds N [ms]   each call N times, while two threads, `urgent` and `loose`, each have a
//                           kernel of `ms` on its way, of which the second one waits behind a gate
//                           under UrgenGo; the rows that end the work's context are left out
//   parking learn N [ms]    the kernels without the calls
//   parking image           writes the kernels' PTX, of which a fat binary is to be made
//
// One line of JSON a call. What spins ends after 2 s by itself. Exit status 2 if CUDA fails,
// 77 without a GPU. PARKING_FATBIN names the fat binary; without one its row is left out. Only the
// driver API: the simulated GPU runs it, too (PARKING_SIMULATED: the kernels write nothing there).
#include "tests/gpu/parking_calls.h"
#include "tests/gpu/parking_table.h"

#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <thread>

namespace parking {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr std::uint64_t kLongest_ns = 2'000'000'000;
constexpr double kPatience_us = 30'000, kMostPatience_us = 1'500'000;
constexpr milliseconds kPeriod{50};  // of rounds
// Of a multiprocessor's thread slots: two such kernels have room beside each other and others.
constexpr unsigned kThreads = 512;

const bool is_simulated = std::getenv("PARKING_SIMULATED") != nullptr;

double us_since(Clock::time_point begin) {
    return std::chrono::duration<double, std::micro>(Clock::now() - begin).count();
}

/// Seen by all contexts at the same address.
SpinWords* make_words() {
    void* words = nullptr;
    MUST(cuMemHostAlloc(&words, sizeof(SpinWords),
                        CU_MEMHOSTALLOC_PORTABLE | CU_MEMHOSTALLOC_DEVICEMAP));
    std::memset(words, 0, sizeof(SpinWords));
    return static_cast<SpinWords*>(words);
}
std::uint32_t load(const std::uint32_t& word) {
    return __atomic_load_n(&word, __ATOMIC_ACQUIRE);
}
void store(std::uint32_t& word, std::uint32_t value) {
    __atomic_store_n(&word, value, __ATOMIC_RELEASE);
}

struct Spinner {
    CUfunction spin = nullptr, nop = nullptr;
    CUstream stream = make_stream();

    Spinner() {
        const CUmodule module = make_module();
        MUST(cuModuleGetFunction(&spin, module, "parking_spin"));
        MUST(cuModuleGetFunction(&nop, module, "parking_nop"));
        MUST(launch_nop(nop, stream));
        MUST(cuStreamSynchronize(stream));
    }
    void launch(SpinWords* words, std::uint64_t limit_ns, unsigned blocks = 1,
                unsigned threads = 32) const {
        void* parameters[] = {&words, &limit_ns};
        MUST(cuLaunchKernel(spin, blocks, 1, 1, threads, 1, 1, 0, stream, parameters, nullptr));
    }
    void close_gate(SpinWords* words) const {
        MUST(cuStreamWaitValue32(stream, reinterpret_cast<CUdeviceptr>(&words->word), 1,
                                 CU_STREAM_WAIT_VALUE_GEQ));
        MUST(launch_nop(nop, stream));
    }
};

enum class Beside { kNothing, kKernel, kGate };

struct Measured {
    double us = 0;
    bool waits = false;
    CUresult result = CUDA_SUCCESS;
    bool is_possible = true;
};

/// Makes the call in a thread of its own, and ends what it might wait for when it has taken long.
Measured measure_beside(Beside beside, World world, const Row& row, SpinWords* words,
                        double alone_us) {
    Measured found;
    if (row.place == Place::kInItsContext) world.context = make_context(world.device);
    if (row.place == Place::kInPrimary)
        MUST(cuDevicePrimaryCtxRetain(&world.context, world.device));
    MUST(cuCtxSetCurrent(world.context));
    if (row.place != Place::kHere) world.stream = make_stream();
    const Call call = row.prepare(world);
    MUST(cuCtxSetCurrent(world.context));
    if (!call) return {.is_possible = false};
    const Spinner spinner;
    MUST(cuCtxSynchronize());
    store(words->word, 0);
    store(words->began, 0);
    if (beside == Beside::kKernel) spinner.launch(words, kLongest_ns);
    if (beside == Beside::kGate) spinner.close_gate(words);
    const auto launched = Clock::now();
    while (beside == Beside::kKernel && load(words->began) == 0 && us_since(launched) < 20'000)
        std::this_thread::sleep_for(milliseconds(1));
    std::atomic<bool> done{false};
    std::thread caller([&] {
        MUST(cuCtxSetCurrent(world.context));
        const auto begin = Clock::now();
        found.result = call();
        found.us = us_since(begin);
        done = true;
    });
    const double patience_us = std::min(kPatience_us + 3 * alone_us, kMostPatience_us);
    for (const auto begin = Clock::now(); !done && us_since(begin) < patience_us;)
        std::this_thread::sleep_for(milliseconds(1));
    found.waits = !done && beside != Beside::kNothing;
    store(words->word, 1);
    caller.join();
    if (row.place == Place::kHere) {
        MUST(cuCtxSynchronize());
        MUST(cuStreamDestroy(spinner.stream));
    }
    return found;
}

int run_bare(const World& world) {
    SpinWords* const words = make_words();
    for (const Row& row : rows()) {
        MUST(cuCtxSetCurrent(world.context));
        const auto alone = measure_beside(Beside::kNothing, world, row, words, kLongest_ns * 1e-3);
        if (!alone.is_possible) {
            std::printf("{\"call\": \"%s\", \"skipped\": true}\n", row.name);
            continue;
        }
        const auto kernel = measure_beside(Beside::kKernel, world, row, words, alone.us);
        const auto gate = measure_beside(Beside::kGate, world, row, words, alone.us);
        std::printf(
            "{\"call\": \"%s\", \"parks\": %s, \"alone_us\": %.1f, \"kernel_us\": %.1f, "
            "\"waits_for_kernel\": %s, \"gate_us\": %.1f, \"waits_for_gate\": %s, "
            "\"results\": [%d, %d, %d]}\n",
            row.name, row.parks ? "true" : "false", alone.us, kernel.us,
            kernel.waits ? "true" : "false", gate.us, gate.waits ? "true" : "false",
            int(alone.result), int(kernel.result), int(gate.result));
        std::fflush(stdout);
    }
    return 0;
}

/// A thread that launches its kernel when it is told to, and waits for it.
class Launcher {
  public:
    Launcher(const char* name, const World& world, std::uint64_t limit_ns)
        : limit_ns_(limit_ns), thread_([this, name, world] {
              pthread_setname_np(pthread_self(), name);
              MUST(cuCtxSetCurrent(world.context));
              const Spinner spinner;
              SpinWords* const words = make_words();
              words_ = words;
              for (int round = 1; wait_for(told_, round); ++round) {
                  store(words->began, 0);
                  spinner.launch(words, limit_ns_, world.num_sms, kThreads);
                  reach(launched_, round);
                  MUST(cuStreamSynchronize(spinner.stream));
                  reach(done_, round);
              }
          }) {}
    ~Launcher() {
        reach(told_, -1);
        thread_.join();
    }
    void tell_to_launch() {
        reach(told_, ++round_);
        wait_for(launched_, round_);
    }
    bool has_begun() const { return load(words_->began) != 0; }
    void wait_until_done() { wait_for(done_, round_); }
    unsigned blocks() const { return load(words_->ended); }

  private:
    bool wait_for(int& count, int round) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return count >= round || count < 0; });
        return count >= 0;
    }
    void reach(int& count, int round) {
        {
            const std::lock_guard lock(mutex_);
            count = round;
        }
        changed_.notify_all();
    }

    const std::uint64_t limit_ns_;
    std::mutex mutex_;
    std::condition_variable changed_;
    int told_ = 0, launched_ = 0, done_ = 0;  // under mutex_
    int round_ = 0;
    SpinWords* words_ = nullptr;
    std::thread thread_;
};

struct Rounds {
    const World& world;
    Launcher urgent, loose;
    Clock::time_point next = Clock::now();

    Rounds(const World& its, std::uint64_t limit_ns)
        : world(its), urgent("urgent", its, limit_ns), loose("loose", its, limit_ns) {}

    /// @param[out] was_gated  the second kernel had not begun when the call was made
    Measured run(const Call& call, bool& was_gated) {
        next = std::max(next + kPeriod, Clock::now());
        std::this_thread::sleep_until(next);
        urgent.tell_to_launch();
        loose.tell_to_launch();
        std::this_thread::sleep_for(milliseconds(2));
        was_gated = !loose.has_begun();
        Measured found;
        if (call) {
            const auto begin = Clock::now();
            found.result = call();
            found.us = us_since(begin);
        }
        urgent.wait_until_done();
        loose.wait_until_done();
        return found;
    }
};

int run_rounds(const World& world, int num_rounds, std::uint64_t limit_ns, bool with_calls) {
    pthread_setname_np(pthread_self(), "parking");
    // A thread of no chain, as UrgenGo knows from its launches.
    const Spinner spinner;
    for (int i = 0; i < 3; ++i) MUST(launch_nop(spinner.nop, spinner.stream));
    MUST(cuStreamSynchronize(spinner.stream));
    Rounds rounds(world, limit_ns);
    constexpr int kWarmUp = 3;
    unsigned expected = 0;
    bool was_gated = false;
    for (int i = 0; i < (with_calls ? kWarmUp : num_rounds); ++i, ++expected)
        rounds.run({}, was_gated);
    for (const Row& row : parking::rows()) {
        if (!with_calls || row.place != Place::kHere) continue;
        std::string times;
        int gated = 0, failed = 0;
        for (int i = 0; i < num_rounds; ++i) {
            World its = world;
            const Call call = row.prepare(its);
            MUST(cuCtxSetCurrent(world.context));
            if (!call) break;
            MUST(cuCtxSynchronize());
            // A call that unloads code makes all kernels new: the next launch of each has no gate.
            if (row.parks) {
                rounds.run({}, was_gated);
                ++expected;
            }
            const Measured found = rounds.run(call, was_gated);
            ++expected;
            gated += was_gated;
            failed += found.result != CUDA_SUCCESS;
            times += (i == 0 ? "" : ", ") + std::to_string(found.us);
        }
        std::printf("{\"call\": \"%s\", \"us\": [%s], \"gated\": %d, \"failed\": %d}\n", row.name,
                    times.c_str(), gated, failed);
        std::fflush(stdout);
    }
    const unsigned blocks = expected * world.num_sms;
    const bool are_right =
        is_simulated || (rounds.urgent.blocks() == blocks && rounds.loose.blocks() == blocks);
    std::printf("{\"rounds\": %u, \"right\": %s}\n", expected, are_right ? "true" : "false");
    return are_right ? 0 : 1;
}

}  // namespace
}  // namespace parking

int main(int argc, char** argv) {
    using namespace parking;
    const std::string what = argc > 1 ? argv[1] : "";
    if (what == "image") return std::fputs(kPtx, stdout) < 0;
    if (what != "bare" && what != "rounds" && what != "learn") {
        std::fprintf(stderr, "parking: accepted: bare, rounds N [ms], learn N [ms], image\n");
        return 2;
    }
    int num_devices = 0;
    if (cuInit(0) != CUDA_SUCCESS || cuDeviceGetCount(&num_devices) != CUDA_SUCCESS ||
        num_devices == 0)
        return 77;
    World world;
    MUST(cuDeviceGet(&world.device, 0));
    int num_sms = 0;
    MUST(cuDeviceGetAttribute(&num_sms, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT, world.device));
    world.num_sms = static_cast<unsigned>(num_sms);
    world.context = make_context(world.device);
    world.stream = make_stream();
    if (what == "bare") return run_bare(world);
    const int num_rounds = argc > 2 ? std::atoi(argv[2]) : 3;
    const auto ms = static_cast<std::uint64_t>(argc > 3 ? std::atoi(argv[3]) : 20);
    return run_rounds(world, num_rounds, ms * 1'000'000, what == "rounds");
}
