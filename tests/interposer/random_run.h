// SPDX-License-Identifier: Apache-2.0
//
// One random program, run once: what became of it, and whether all went as CUDA promises: calls
// succeed, host functions keep their order.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "tests/interposer/random_machine.h"
#include "tests/interposer/random_program.h"

namespace twin {

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
    static CUresult register_and_back();
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

}  // namespace twin
