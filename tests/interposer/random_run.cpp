// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/random_run.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <numeric>
#include <thread>
#include <utility>

namespace twin {
namespace {

constexpr const char* kRight = "all kept";  ///< ends the line; in test_random.cpp too

}  // namespace

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

}  // namespace twin
