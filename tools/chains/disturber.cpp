// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/disturber.h"

#include <fcntl.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <stdexcept>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "tools/chains/stream_results.h"
#include "tools/chains/task_stream.h"

namespace urgengo::chains {

namespace {

using Steady = std::chrono::steady_clock;

constexpr double kShortestPause_ms = 1, kLongestPause_ms = 200;
constexpr std::size_t kLargestMiB = 64, kMiB = 1 << 20, kPage = 4096;
constexpr unsigned kThreads = 256;
// chains_comp for some tens of microseconds.
constexpr int kIterations = 2000;

}  // namespace

/// A kernel's parameters, and results that are not looked at.
struct Disturber::Work {
    DeviceBuffer results{sizeof(StreamResults)};
    int iterations = kIterations;
    CUdeviceptr word = results.get();
    unsigned blocks_before = 0;
    void* parameters[3] = {&iterations, &word, &blocks_before};
};

const std::vector<std::string>& Disturber::kinds() {
    static const std::vector<std::string> names{"allocate",    "allocate_host", "register_host",
                                                "load_module", "graph",         "cooperative",
                                                "synchronize"};
    return names;
}

void Disturber::Options::add_to(CLI::App& command) {
    command.add_option("--disturb", seed,
                       "A thread that belongs to no chain makes calls that wait for all work on "
                       "the GPU, load code and launch cooperatively, at random; its seed");
    command
        .add_option("--disturb-without", without,
                    fmt::format("Of that, not these: {}", fmt::join(kinds(), ", ")))
        ->check(CLI::IsMember(kinds()))
        ->delimiter(',');
    command.add_option("--disturb-state", state_path,
                       "File that says which of its calls is under way, and since when");
}

std::string Disturber::Options::describe() const {
    if (!seed) return "none";
    const std::string left_out = fmt::format("{}", fmt::join(without, ","));
    return left_out.empty() ? fmt::format("{}", *seed)
                            : fmt::format("{}, without {}", *seed, left_out);
}

Disturber::Disturber(const Gpu& gpu, Options options)
    : gpu_(gpu), options_(std::move(options)), random_(options_.seed.value_or(1)) {
    constexpr void (Disturber::*kAll[])() = {
        &Disturber::allocate,           &Disturber::allocate_host, &Disturber::register_host,
        &Disturber::load_module,        &Disturber::launch_graph,  &Disturber::launch_cooperatively,
        &Disturber::synchronize_context};
    for (std::size_t i = 0; i < kinds().size(); ++i) {
        const auto& without = options_.without;
        if (std::find(without.begin(), without.end(), kinds()[i]) == without.end())
            chosen_.push_back(kAll[i]);
    }
    if (chosen_.empty()) throw std::runtime_error("--disturb-without: nothing is left");
    if (options_.state_path.empty()) return;
    state_file_ = open(options_.state_path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (state_file_ < 0) throw std::runtime_error("cannot write " + options_.state_path);
}

Disturber::~Disturber() {
    stop();
    if (state_file_ >= 0) close(state_file_);
}

void Disturber::start() {
    thread_ = std::thread([this] {
        try {
            run();
        } catch (const std::exception&) {
            error_ = std::current_exception();
        }
    });
}

void Disturber::stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
}

void Disturber::rethrow_error() const {
    if (error_) std::rethrow_exception(error_);
}

std::vector<CallReport> Disturber::calls() const {
    std::vector<CallReport> all;
    for (auto [name, times_us] : times_us_) {
        std::sort(times_us.begin(), times_us.end());
        all.push_back({name, times_us.size(), percentile(times_us, 0.50),
                       percentile(times_us, 0.99), times_us.back()});
    }
    return all;
}

void Disturber::run() {
    pthread_setname_np(pthread_self(), "disturber");
    gpu_.bind_thread();
    work_ = std::make_unique<Work>();
    std::uniform_int_distribution<std::size_t> which(0, chosen_.size() - 1);
    while (!stop_.load(std::memory_order_relaxed)) {
        (this->*chosen_[which(random_)])();
        pause();
    }
    tell("");
}

// Short ones are as likely as long ones.
void Disturber::pause() {
    std::uniform_real_distribution<double> exponent(std::log(kShortestPause_ms),
                                                    std::log(kLongestPause_ms));
    const std::chrono::duration<double, std::milli> length(std::exp(exponent(random_)));
    for (const auto end = Steady::now() + length; !stop_ && Steady::now() < end;)
        std::this_thread::sleep_for(std::min<Steady::duration>(
            std::chrono::milliseconds(10),
            std::chrono::duration_cast<Steady::duration>(end - Steady::now())));
}

// A line of fixed length: the call, and since when by CLOCK_MONOTONIC.
void Disturber::tell(const char* call) {
    if (state_file_ < 0) return;
    char line[64];
    const double now_s = std::chrono::duration<double>(Steady::now().time_since_epoch()).count();
    const int size = std::snprintf(line, sizeof line, "%-40s%20.6f\n", call, now_s);
    if (pwrite(state_file_, line, static_cast<std::size_t>(size), 0) != size)
        throw std::runtime_error("cannot write " + options_.state_path);
}

template <typename Call>
void Disturber::timed(const char* name, Call&& call) {
    tell(name);
    const auto begin = Steady::now();
    const CUresult result = call();
    const double us = std::chrono::duration<double, std::micro>(Steady::now() - begin).count();
    tell("-");
    check_cuda(result, name);
    times_us_[name].push_back(us);
}

void Disturber::allocate() {
    std::uniform_int_distribution<std::size_t> size(1, kLargestMiB);
    const std::size_t bytes = size(random_) * kMiB;
    CUdeviceptr memory = 0;
    timed("cuMemAlloc", [&] { return cuMemAlloc(&memory, bytes); });
    pause();
    timed("cuMemFree", [&] { return cuMemFree(memory); });
}

void Disturber::allocate_host() {
    void* memory = nullptr;
    timed("cuMemAllocHost", [&] { return cuMemAllocHost(&memory, kMiB); });
    pause();
    timed("cuMemFreeHost", [&] { return cuMemFreeHost(memory); });
}

void Disturber::register_host() {
    const std::unique_ptr<void, decltype(&std::free)> memory(std::aligned_alloc(kPage, kMiB),
                                                             &std::free);
    timed("cuMemHostRegister", [&] { return cuMemHostRegister(memory.get(), kMiB, 0); });
    pause();
    timed("cuMemHostUnregister", [&] { return cuMemHostUnregister(memory.get()); });
}

void Disturber::load_module() {
    CUmodule module = nullptr;
    CUfunction kernel = nullptr;
    timed("cuModuleLoadData", [&] { return cuModuleLoadData(&module, gpu_.image()); });
    timed("cuModuleGetFunction",
          [&] { return cuModuleGetFunction(&kernel, module, kernel_name(KernelKind::kCompute)); });
    {
        const Stream stream;
        timed("cuLaunchKernel, the first", [&] {
            return cuLaunchKernel(kernel, 1, 1, 1, kThreads, 1, 1, 0, stream.get(),
                                  work_->parameters, nullptr);
        });
        timed("cuStreamSynchronize", [&] { return cuStreamSynchronize(stream.get()); });
    }
    timed("cuModuleUnload", [&] { return cuModuleUnload(module); });
}

void Disturber::launch_graph() {
    const Stream stream;
    CUgraph graph = nullptr;
    CUgraphNode node = nullptr;
    CUgraphExec executable = nullptr;
    CUDA_KERNEL_NODE_PARAMS kernel{};
    kernel.func = gpu_.function(kernel_name(KernelKind::kCompute));
    kernel.gridDimX = static_cast<unsigned>(gpu_.num_sms());
    kernel.gridDimY = kernel.gridDimZ = kernel.blockDimY = kernel.blockDimZ = 1;
    kernel.blockDimX = kThreads;
    kernel.kernelParams = work_->parameters;
    CHAINS_CUDA(cuGraphCreate(&graph, 0));
    CHAINS_CUDA(cuGraphAddKernelNode(&node, graph, nullptr, 0, &kernel));
    timed("cuGraphInstantiate", [&] { return cuGraphInstantiate(&executable, graph, 0); });
    timed("cuGraphUpload", [&] { return cuGraphUpload(executable, stream.get()); });
    timed("cuGraphLaunch", [&] { return cuGraphLaunch(executable, stream.get()); });
    timed("cuStreamSynchronize", [&] { return cuStreamSynchronize(stream.get()); });
    timed("cuGraphExecDestroy", [&] { return cuGraphExecDestroy(executable); });
    CHAINS_CUDA(cuGraphDestroy(graph));
}

// A block on each multiprocessor, all of which must be there at once.
void Disturber::launch_cooperatively() {
    const Stream stream;
    const CUfunction kernel = gpu_.function(kernel_name(KernelKind::kCompute));
    timed("cuLaunchCooperativeKernel", [&] {
        return cuLaunchCooperativeKernel(kernel, static_cast<unsigned>(gpu_.num_sms()), 1, 1,
                                         kThreads, 1, 1, 0, stream.get(), work_->parameters);
    });
    timed("cuStreamSynchronize", [&] { return cuStreamSynchronize(stream.get()); });
}

void Disturber::synchronize_context() {
    timed("cuCtxSynchronize", [] { return cuCtxSynchronize(); });
}

}  // namespace urgengo::chains
