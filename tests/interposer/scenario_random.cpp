// SPDX-License-Identifier: Apache-2.0
//
// Runs random programs and says what became of each: a line with the final memory, the results of
// all calls, what was read back, and whether all went as CUDA promises: calls succeed, host
// functions keep their order. What did not is named by its operations' numbers.
//   random FIRST COUNT       programs of these seeds
//   random SEED 1 verbose    every operation with its result, and every word, too
#include <atomic>
#include <cstdio>
#include <memory>
#include <mutex>
#include <numeric>
#include <thread>

#include "tests/interposer/gpu.h"
#include "tests/interposer/random_program.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr std::size_t kMostFlags = 256;
constexpr std::size_t kWordBytes = 2 * sizeof(std::uint64_t);
constexpr const char* kRight = "all kept";  ///< ends the line; in test_random.cpp too

/// What all programs of the process use.
struct Machine {
    Gpu gpu;
    CUfunction mix = gpu.function(kMixName), long_ = gpu.function("long");
    std::array<CUstream, kFirstPerThreadStream> streams{nullptr,
                                                        make_stream(CU_STREAM_DEFAULT),
                                                        make_stream(CU_STREAM_DEFAULT, -1),
                                                        make_stream(),
                                                        make_stream(CU_STREAM_NON_BLOCKING, -5),
                                                        make_stream(CU_STREAM_NON_BLOCKING, -2)};
    std::array<CUstream, kMaxThreads> capturing{make_stream(), make_stream(), make_stream()};
    std::uint64_t* h_words = make_mapped(2 * kNumHostWords);
    std::uint64_t* flags = make_mapped(kMostFlags);
    CUdeviceptr d_words = 0;

    // The entries of the per-thread flavour.
    decltype(&cuLaunchKernel) launch_ptsz;
    decltype(&cuMemcpyAsync) copy_ptsz;
    decltype(&cuMemcpyDtoH) copy_to_host_ptds;
    decltype(&cuStreamSynchronize) synchronize_ptsz;

    Machine() {
        MUST(cuMemAlloc(&d_words, kWordBytes * (kNumWords - kNumHostWords)));
        const auto find = [](auto& function, const char* name) {
            function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(
                entry_point(name, 7000, CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM));
        };
        find(launch_ptsz, "cuLaunchKernel");
        find(copy_ptsz, "cuMemcpyAsync");
        find(copy_to_host_ptds, "cuMemcpyDtoH");
        find(synchronize_ptsz, "cuStreamSynchronize");
        // Loaded now: a driver that loads at the first launch may wait for the GPU.
        MUST(launch_tiny(gpu.tiny, nullptr));
        MUST(launch_wide(gpu.wide, nullptr));
        MUST(launch_wide(long_, nullptr));
        MUST(launch_store(gpu.store, h_words, 0, nullptr));
        CUdeviceptr word = on_gpu(h_words);
        std::uint64_t value = 0;
        void* parameters[] = {&word, &value};
        MUST(cuLaunchKernel(mix, 1, 1, 1, 1, 1, 1, 0, nullptr, parameters, nullptr));
        MUST(cuCtxSynchronize());
    }

    CUdeviceptr word(int index) const {
        const auto i = static_cast<std::size_t>(index);
        return index < kNumHostWords ? on_gpu(h_words + 2 * i)
                                     : d_words + kWordBytes * (i - kNumHostWords);
    }
};

class Hash {
  public:
    void add(std::uint64_t value) {
        for (int i = 0; i < 8; ++i) {
            hash_ = (hash_ ^ (value & 0xff)) * 0x100000001b3;
            value >>= 8;
        }
    }
    unsigned long long value() const { return hash_; }

  private:
    std::uint64_t hash_ = 0xcbf29ce484222325;
};

/// One program, run once.
class Run {
  public:
    Run(const Machine& machine, Program program, bool verbose);
    ~Run();

    /// @returns whether all went as CUDA promises
    bool run(std::uint64_t seed);

  private:
    /// What a host function gets.
    struct Call {
        Run* run;
        std::uint64_t* word;
        std::uint64_t value;
        int operation;  ///< -1: not on record
    };
    static void CUDA_CB mix_on_host(void* data);
    static void CUDA_CB mix_in_callback(CUstream, CUresult status, void* data);

    void run_thread(int thread);
    CUresult run(const Operation& operation);
    CUresult launch_mix(const Operation& operation, CUstream stream, CUdeviceptr word) const;
    CUresult launch_graph(const Operation& operation, CUstream stream);
    CUresult use_pool(const Operation& operation, CUstream stream) const;
    CUresult copy(const Operation& operation, CUstream stream) const;
    CUresult set(const Operation& operation, CUstream stream) const;
    CUresult read_back(const Operation& operation);
    CUresult poll(CUstream stream) const;
    CUresult refused(const Operation& operation, CUstream stream) const;
    Call* new_call(const Operation& operation, int index);

    CUstream stream_of(const Operation& operation) const {
        return operation.stream < kFirstPerThreadStream
                   ? machine_.streams[static_cast<std::size_t>(operation.stream)]
                   : CU_STREAM_PER_THREAD;
    }
    static bool is_per_thread(const Operation& operation) {
        return operation.stream >= kFirstPerThreadStream;
    }
    /// @returns 'operation 7 (host mix, thread 1, stream 3)'
    std::string name_of_operation(int index) const;
    void add_fault(std::string text);
    void check_order();
    std::string faults() const;
    Hash hash_of_words() const;

    const Machine& machine_;
    const Program program_;
    const bool verbose_;
    std::vector<CUevent> events_;
    std::vector<std::atomic<int>> issued_;  ///< by operation
    std::vector<std::atomic<int>> stamps_;  ///< of host functions, by operation
    std::atomic<int> last_stamp_{0};
    std::mutex mutex_;  ///< for these two
    std::vector<std::unique_ptr<Call>> calls_;
    std::vector<std::string> faults_;  ///< in the order in which they were found
    std::array<Hash, kMaxThreads> results_, read_;
};

Run::Run(const Machine& machine, Program program, bool verbose)
    : machine_(machine),
      program_(std::move(program)),
      verbose_(verbose),
      events_(static_cast<std::size_t>(program_.num_events)),
      issued_(program_.operations.size()),
      stamps_(program_.operations.size()) {
    if (static_cast<std::size_t>(program_.num_flags) > kMostFlags) give_up("too many flags", 0);
    constexpr unsigned kFlags[] = {CU_EVENT_DISABLE_TIMING, CU_EVENT_DEFAULT,
                                   CU_EVENT_DISABLE_TIMING | CU_EVENT_BLOCKING_SYNC};
    for (std::size_t i = 0; i < events_.size(); ++i)
        MUST(cuEventCreate(&events_[i], kFlags[i % std::size(kFlags)]));
    std::iota(machine.h_words, machine.h_words + 2 * kNumHostWords, 1);
    std::fill_n(machine.flags, kMostFlags, 0);
    MUST(cuMemsetD8(machine.d_words, 0x5a, kWordBytes * (kNumWords - kNumHostWords)));
    MUST(cuCtxSynchronize());
}

Run::~Run() {
    for (CUevent event : events_) MUST(cuEventDestroy(event));
}

void Run::mix_on_host(void* data) {
    const Call& call = *static_cast<Call*>(data);
    *call.word = 31 * *call.word + call.value;
    if (call.operation < 0) return;
    auto& stamp = call.run->stamps_[static_cast<std::size_t>(call.operation)];
    if (stamp.exchange(++call.run->last_stamp_) != 0)
        call.run->add_fault(call.run->name_of_operation(call.operation) + " ran twice");
}

void Run::mix_in_callback(CUstream, CUresult status, void* data) {
    const Call& call = *static_cast<Call*>(data);
    if (status != CUDA_SUCCESS)
        call.run->add_fault(call.run->name_of_operation(call.operation) + " was told status " +
                            std::to_string(status));
    mix_on_host(data);
}

Run::Call* Run::new_call(const Operation& operation, int index) {
    auto* const word = machine_.h_words + 2 * operation.word;
    const std::lock_guard lock(mutex_);
    calls_.push_back(std::make_unique<Call>(Call{this, word, operation.value, index}));
    return calls_.back().get();
}

bool Run::run(std::uint64_t seed) {
    std::vector<std::thread> others;
    for (int t = 1; t < program_.num_threads; ++t)
        others.emplace_back([this, t] { run_thread(t); });
    run_thread(0);
    for (std::thread& thread : others) thread.join();
    const CUresult end = cuCtxSynchronize();
    if (end != CUDA_SUCCESS) add_fault("the context ended with " + std::to_string(end));
    check_order();
    Hash results, read;
    for (const Hash& hash : results_) results.add(hash.value());
    for (const Hash& hash : read_) read.add(hash.value());
    say("seed %llu: %zu operations, words %016llx, results %016llx, read %016llx, %s",
        static_cast<unsigned long long>(seed), program_.operations.size(), hash_of_words().value(),
        results.value(), read.value(), faults().c_str());
    std::fflush(stdout);  // known, should the next one not end
    return faults_.empty();
}

void Run::run_thread(int thread) {
    name_this_thread(program_.thread_names[static_cast<std::size_t>(thread)]);
    MUST(cuCtxSetCurrent(machine_.gpu.context));
    Hash& hash = results_[static_cast<std::size_t>(thread)];
    for (std::size_t i = 0; i < program_.operations.size(); ++i) {
        const Operation& operation = program_.operations[i];
        if (operation.thread != thread) continue;
        for (int earlier : operation.after) issued_[static_cast<std::size_t>(earlier)].wait(0);
        const CUresult result = run(operation);
        hash.add(static_cast<std::uint64_t>(result));
        if (verbose_) say("%zu: %s = %d", i, to_text(operation).c_str(), result);
        const std::string name = name_of_operation(static_cast<int>(i));
        if ((result != CUDA_SUCCESS) != (operation.kind == Kind::kRefused))
            add_fault(name + " = " + std::to_string(result));
        for (int function : operation.waits_for)
            if (stamps_[static_cast<std::size_t>(function)] == 0)
                add_fault(name + " did not wait for " + name_of_operation(function));
        issued_[i] = 1;
        issued_[i].notify_all();
    }
}

CUresult Run::run(const Operation& operation) {
    const CUstream stream = stream_of(operation);
    const auto number = static_cast<std::size_t>(operation.value);
    const int index = static_cast<int>(&operation - program_.operations.data());
    switch (operation.kind) {
        case Kind::kMix:
            return launch_mix(operation, stream, machine_.word(operation.word));
        case Kind::kStore:
            return launch_store(machine_.gpu.store,
                                reinterpret_cast<std::uint64_t*>(machine_.word(operation.word)),
                                operation.value, stream);
        case Kind::kTiny:
            return launch_tiny(machine_.gpu.tiny, stream);
        case Kind::kWide:
            return launch_wide(operation.variant % 2 ? machine_.long_ : machine_.gpu.wide, stream);
        case Kind::kCopy:
            return copy(operation, stream);
        case Kind::kMemset:
            return set(operation, stream);
        case Kind::kWriteValue:
            return cuStreamWriteValue64(stream, machine_.word(operation.word), operation.value,
                                        CU_STREAM_WRITE_VALUE_DEFAULT);
        case Kind::kHostMix: {
            Call* const call = new_call(operation, index);
            return operation.variant % 2 ? cuLaunchHostFunc(stream, mix_on_host, call)
                                         : cuStreamAddCallback(stream, mix_in_callback, call, 0);
        }
        case Kind::kPool:
            return use_pool(operation, stream);
        case Kind::kGraph:
            return launch_graph(operation, stream);
        case Kind::kReadBack:
            return read_back(operation);
        case Kind::kRecord:
            return operation.variant % 2 ? cuEventRecord(events_[number], stream)
                                         : cuEventRecordWithFlags(events_[number], stream, 0);
        case Kind::kWaitEvent:
            return cuStreamWaitEvent(stream, events_[number], CU_EVENT_WAIT_DEFAULT);
        case Kind::kWriteFlag:
            return cuStreamWriteValue64(stream, on_gpu(machine_.flags + number), 1,
                                        CU_STREAM_WRITE_VALUE_DEFAULT);
        case Kind::kWaitFlag:
            return operation.variant % 2
                       ? cuStreamWaitValue32(stream, on_gpu(machine_.flags + number), 1,
                                             CU_STREAM_WAIT_VALUE_EQ)
                       : cuStreamWaitValue64(stream, on_gpu(machine_.flags + number), 1,
                                             CU_STREAM_WAIT_VALUE_GEQ);
        case Kind::kStreamSync:
            return is_per_thread(operation) ? machine_.synchronize_ptsz(nullptr)
                                            : cuStreamSynchronize(stream);
        case Kind::kEventSync:
            return cuEventSynchronize(events_[number]);
        case Kind::kPoll:
            return poll(stream);
        case Kind::kContextSync:
            return cuCtxSynchronize();
        case Kind::kAllocFree: {
            CUdeviceptr memory = 0;
            if (const CUresult result = cuMemAlloc(&memory, 4096)) return result;
            return cuMemFree(memory);
        }
        case Kind::kQuery: {
            const CUresult result = cuStreamQuery(stream);  // either may be right
            return result == CUDA_ERROR_NOT_READY ? CUDA_SUCCESS : result;
        }
        case Kind::kRefused:
            return refused(operation, stream);
    }
    return CUDA_ERROR_UNKNOWN;
}

CUresult Run::launch_mix(const Operation& operation, CUstream stream, CUdeviceptr word) const {
    std::uint64_t value = operation.value;
    void* parameters[] = {&word, &value};
    CUlaunchAttribute attribute{};
    attribute.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    attribute.value.priority = -static_cast<int>(operation.variant / 8 % 6);
    CUlaunchConfig config{1, 1, 1, 1, 1, 1, 0, stream, &attribute, 1};
    switch (operation.variant % 8) {
        case 0:
            config.numAttrs = 0;
            return cuLaunchKernelEx(&config, machine_.mix, parameters, nullptr);
        case 1:
            return cuLaunchKernelEx(&config, machine_.mix, parameters, nullptr);
        case 2:
            return cuLaunchCooperativeKernel(machine_.mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters);
        case 3:
            if (is_per_thread(operation))
                return machine_.launch_ptsz(machine_.mix, 1, 1, 1, 1, 1, 1, 0, nullptr, parameters,
                                            nullptr);
            [[fallthrough]];
        default:
            return cuLaunchKernel(machine_.mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr);
    }
}

CUresult Run::launch_graph(const Operation& operation, CUstream stream) {
    const CUstream capturing = machine_.capturing[static_cast<std::size_t>(operation.thread)];
    const CUdeviceptr word = machine_.word(operation.word), other = machine_.word(operation.from);
    // In the global mode other threads' calls may fail, which is theirs to know.
    const auto mode = program_.num_threads == 1 ? CU_STREAM_CAPTURE_MODE_GLOBAL
                      : operation.variant % 2   ? CU_STREAM_CAPTURE_MODE_THREAD_LOCAL
                                                : CU_STREAM_CAPTURE_MODE_RELAXED;
    if (const CUresult result = cuStreamBeginCapture(capturing, mode)) return result;
    CUresult sum = launch_mix(operation, capturing, word);
    const auto add = [&sum](CUresult result) {
        if (sum == CUDA_SUCCESS) sum = result;
    };
    add(launch_tiny(machine_.gpu.tiny, capturing));
    add(cuMemcpyDtoDAsync(other, word, sizeof(std::uint64_t), capturing));
    if (operation.word < kNumHostWords)
        add(cuLaunchHostFunc(capturing, mix_on_host, new_call(operation, -1)));
    add(launch_mix(operation, capturing, other));
    CUgraph graph = nullptr;
    CUgraphExec executable = nullptr;
    add(cuStreamEndCapture(capturing, &graph));
    if (sum != CUDA_SUCCESS) return sum;
    add(cuGraphInstantiate(&executable, graph, 0));
    if (sum != CUDA_SUCCESS) return sum;
    for (unsigned i = 0; i <= operation.variant / 2 % 2; ++i)
        add(cuGraphLaunch(executable, stream));
    add(cuGraphExecDestroy(executable));
    add(cuGraphDestroy(graph));
    return sum;
}

CUresult Run::use_pool(const Operation& operation, CUstream stream) const {
    CUdeviceptr memory = 0;
    if (const CUresult result = cuMemAllocAsync(&memory, 256, stream)) return result;
    CUresult sum = cuMemcpyDtoDAsync(memory, machine_.word(operation.from), kWordBytes, stream);
    const auto add = [&sum](CUresult result) {
        if (sum == CUDA_SUCCESS) sum = result;
    };
    add(launch_mix(operation, stream, memory));
    add(cuMemcpyAsync(machine_.word(operation.word), memory, kWordBytes, stream));
    add(cuMemFreeAsync(memory, stream));
    return sum;
}

CUresult Run::copy(const Operation& operation, CUstream stream) const {
    const CUdeviceptr to = machine_.word(operation.word), from = machine_.word(operation.from);
    if (is_per_thread(operation) && operation.variant % 2)
        return machine_.copy_ptsz(to, from, kWordBytes, nullptr);
    if (!stream && operation.variant % 4 == 1) return cuMemcpy(to, from, kWordBytes);
    if (operation.from < kNumHostWords && operation.variant % 4 == 2)
        return cuMemcpyHtoDAsync(to, reinterpret_cast<const void*>(from), kWordBytes, stream);
    if (operation.word < kNumHostWords && operation.variant % 4 == 3)
        return cuMemcpyDtoHAsync(reinterpret_cast<void*>(to), from, kWordBytes, stream);
    return cuMemcpyAsync(to, from, kWordBytes, stream);
}

CUresult Run::set(const Operation& operation, CUstream stream) const {
    const CUdeviceptr word = machine_.word(operation.word);
    const auto value = static_cast<unsigned>(operation.value);
    switch (operation.variant % 4) {
        case 0:
            return cuMemsetD8Async(word, static_cast<unsigned char>(value), 5, stream);
        case 1:
            return cuMemsetD16Async(word, static_cast<unsigned short>(value), 3, stream);
        case 2:
            if (!stream) return cuMemsetD32(word, value, 4);
            [[fallthrough]];
        default:
            return cuMemsetD32Async(word, value, 4, stream);
    }
}

CUresult Run::read_back(const Operation& operation) {
    std::uint64_t found = 0;
    const auto copy = is_per_thread(operation) ? machine_.copy_to_host_ptds : cuMemcpyDtoH;
    const CUresult result = copy(&found, machine_.word(operation.word), sizeof found);
    read_[static_cast<std::size_t>(operation.thread)].add(found);
    if (verbose_) say("read %016llx", static_cast<unsigned long long>(found));
    return result;
}

CUresult Run::poll(CUstream stream) const {
    while (true) {
        const CUresult result = cuStreamQuery(stream);
        if (result != CUDA_ERROR_NOT_READY) return result;
        std::this_thread::yield();
    }
}

CUresult Run::refused(const Operation& operation, CUstream stream) const {
    switch (operation.variant) {
        case 0:
            return cuLaunchKernel(machine_.gpu.tiny, 0, 1, 1, 1, 1, 1, 0, stream, nullptr, nullptr);
        case 1:
            return cuLaunchKernel(machine_.gpu.tiny, 1, 1, 1, 2048, 1, 1, 0, stream, nullptr,
                                  nullptr);
        default:
            return cuMemsetD32Async(machine_.word(0) + 1, 0, 1, stream);
    }
}

std::string Run::name_of_operation(int index) const {
    const Operation& operation = program_.operations[static_cast<std::size_t>(index)];
    return "operation " + std::to_string(index) + " (" + name_of(operation.kind) + ", thread " +
           std::to_string(operation.thread) + ", stream " + std::to_string(operation.stream) + ")";
}

void Run::add_fault(std::string text) {
    const std::lock_guard lock(mutex_);
    faults_.push_back(std::move(text));
}

/// When all has ended.
void Run::check_order() {
    const auto stamp = [this](int index) -> int {
        return stamps_[static_cast<std::size_t>(index)];
    };
    for (int i = 0; i < static_cast<int>(program_.operations.size()); ++i)
        if (program_.operations[static_cast<std::size_t>(i)].kind == Kind::kHostMix &&
            stamp(i) == 0)
            add_fault(name_of_operation(i) + " never ran");
    for (const auto& [first, second] : program_.in_order)
        if (stamp(first) > stamp(second) && stamp(second) != 0)
            add_fault(name_of_operation(first) + " ran after " + name_of_operation(second));
}

std::string Run::faults() const {
    if (faults_.empty()) return kRight;
    constexpr std::size_t kMost = 6;
    std::string text = "wrong: ";
    for (std::size_t i = 0; i < faults_.size() && i < kMost; ++i)
        text += (i ? "; " : "") + faults_[i];
    if (faults_.size() > kMost) text += "; and " + std::to_string(faults_.size() - kMost) + " more";
    return text;
}

Hash Run::hash_of_words() const {
    Hash hash;
    for (int i = 0; i < kNumWords; ++i) {
        std::array<std::uint64_t, 2> word;
        MUST(cuMemcpyDtoH(word.data(), machine_.word(i), sizeof word));
        hash.add(word[0]);
        hash.add(word[1] & 0xffff);  // the rest is a time
        if (verbose_) say("word %d: %016llx", i, static_cast<unsigned long long>(word[0]));
    }
    return hash;
}

int random(const Arguments& arguments) {
    if (arguments.size() < 2) give_up("random needs the first seed and how many", 0);
    const std::uint64_t first = std::stoull(arguments[0]), count = std::stoull(arguments[1]);
    const Machine machine;
    bool right = true;
    for (std::uint64_t seed = first; seed < first + count; ++seed)
        right &= Run(machine, make_program(seed, simulated()), arguments.size() > 2).run(seed);
    return right ? 0 : 1;
}

const Scenario s1("random", random);

}  // namespace
}  // namespace twin
