// SPDX-License-Identifier: Apache-2.0
//
// Makes traces for tests: a file's bytes record by record (TraceBuilder), and threads that live
// through frames in virtual time and leave the records of it (TracedThread).
#pragma once

#include <cstdint>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "host/base/hash.h"
#include "urgengo/abi/trace_record.h"

namespace urgengo::testing {

class TraceBuilder {
  public:
    TraceBuilder() {
        header.magic = abi::kTraceMagic;
        header.version = abi::kTraceVersion;
        header.record_bytes = sizeof(abi::TraceRecord);
        header.chunk_records = abi::kTraceChunkRecords;
        header.max_chunks = 1 << 20;
        header.mark_ns = 1000;
        header.pause_ns = 500;
        header.driver_version = 13000;
        header.sm_clock_mhz = 1980;
        header.memory_clock_mhz = 3201;
        std::strcpy(header.gpu, "Test GPU");
    }

    abi::TraceHeader header{};

    /// @returns the record, to be filled in; valid until the next one is added
    abi::TraceRecord& add(std::uint32_t thread, abi::TraceKind kind, std::int64_t time_ns) {
        abi::TraceRecord& record = records_[thread].emplace_back();
        record.kind = kind;
        record.task = -1;
        record.thread = thread;
        record.time_ns = time_ns;
        return record;
    }

    /// Adds the text's records, once. @returns its hash
    std::uint64_t text(std::uint32_t thread, const std::string& text) {
        const std::uint64_t hash = fnv1a64(text);
        if (!texts_.emplace(hash, text).second) return hash;
        for (std::size_t at = 0; at < text.size(); at += sizeof(abi::TraceText::bytes)) {
            abi::TraceText& part = add(thread, abi::TraceKind::kText, 0).text;
            part.hash = hash;
            part.offset = static_cast<std::uint16_t>(at);
            part.length = static_cast<std::uint16_t>(text.size());
            std::memcpy(part.bytes, text.data() + at,
                        std::min(sizeof part.bytes, text.size() - at));
        }
        return hash;
    }

    /// The file. Threads' chunks take turns, as they would.
    std::string bytes() {
        std::string chunks;
        header.chunks = 0;
        for (std::size_t first = 0, left = 1; left > 0; first += abi::kTraceChunkRecords) {
            left = 0;
            for (const auto& [thread, records] : records_) {
                if (first >= records.size()) continue;
                std::vector<abi::TraceRecord> chunk(abi::kTraceChunkRecords);
                for (std::size_t i = 0; i < chunk.size() && first + i < records.size(); ++i) {
                    chunk[i] = records[first + i];
                }
                chunks.append(reinterpret_cast<const char*>(chunk.data()),
                              chunk.size() * sizeof(abi::TraceRecord));
                ++header.chunks;
                ++left;
            }
        }
        return std::string(reinterpret_cast<const char*>(&header), sizeof header) + chunks;
    }

  private:
    std::map<std::uint32_t, std::vector<abi::TraceRecord>> records_;
    std::map<std::uint64_t, std::string> texts_;
};

/// A kernel, as a test launches it.
struct TestKernel {
    std::string name;
    std::uint32_t grid_blocks = 1;
    std::uint16_t block_threads = 32;
    std::int64_t gpu_ns = 100'000;
    double utilization = 0.5;
};

/// A thread with a stream of its own. Its CPU takes 5 us a launch; its GPU is nobody else's.
class TracedThread {
  public:
    static constexpr std::int64_t kLaunchNs = 5000;
    static constexpr std::uint64_t kGpuEpochNs = 1'000'000'000'000;  ///< what %globaltimer is ahead

    TracedThread(TraceBuilder& trace, std::uint32_t id, const std::string& name,
                 std::int64_t begin_ns = 1'000'000)
        : trace_(trace), id_(id), now_ns_(begin_ns) {
        rename(name);
    }

    std::int64_t now_ns() const { return now_ns_; }

    void rename(const std::string& name) {
        abi::TraceRecord& record = trace_.add(id_, abi::TraceKind::kThread, now_ns_);
        std::strncpy(record.name, name.c_str(), sizeof record.name - 1);
        record.cpu_us = cpu_us();
    }

    void compute(std::int64_t ns) { now_ns_ += ns, cpu_ns_ += ns; }
    void sleep(std::int64_t ns) { now_ns_ += ns; }
    void sleep_until(std::int64_t time_ns) { now_ns_ = std::max(now_ns_, time_ns); }

    /// @param task  what the runtime knew
    void launch(const TestKernel& kernel, int task = -1, std::uint32_t instance = 0,
                std::uint8_t flags = 0) {
        const std::uint64_t hash = trace_.text(id_, kernel.name);
        abi::TraceRecord& record = trace_.add(id_, abi::TraceKind::kLaunch, now_ns_);
        record.task = static_cast<std::int16_t>(task);
        record.instance = instance;
        record.flags = flags;
        if (after_wait_) record.cpu_us = cpu_us();
        after_wait_ = false;
        record.launch.name_hash = hash;
        record.launch.stream = 100 + id_;
        record.launch.grid_blocks = kernel.grid_blocks;
        record.launch.block_threads = kernel.block_threads;
        record.launch.utilization = static_cast<std::uint16_t>(kernel.utilization * 65535);
        compute(kLaunchNs);
        const abi::TraceHeader& header = trace_.header;
        const std::int64_t mark_ns =
            header.mark_ns == 0 ? 0 : std::int64_t{header.mark_ns} + header.pause_ns;
        if (gpu_free_ns_ < now_ns_) {  // the stream was idle: its begin is marked
            gpu_free_ns_ = now_ns_;
            record.launch.gpu_begin_ns = gpu_time(gpu_free_ns_);
        }
        gpu_free_ns_ += mark_ns + kernel.gpu_ns;
        record.launch.gpu_end_ns = gpu_time(gpu_free_ns_);
        ++launched_;
    }

    /// @param spin  the call uses the CPU until it returns
    void wait(abi::TraceWait function = abi::TraceWait::kStream, bool covers = true,
              bool spin = false) {
        const std::int64_t end_ns = std::max(now_ns_, gpu_free_ns_) + 2000;
        abi::TraceRecord& record = trace_.add(id_, abi::TraceKind::kWait, now_ns_);
        if (spin) cpu_ns_ += end_ns - now_ns_;
        now_ns_ = end_ns;
        record.flags = covers ? abi::kTraceCovers : 0;
        record.cpu_us = cpu_us();
        record.wait.end_ns = end_ns;
        record.wait.stream = 100 + id_;
        record.wait.launches = launched_;
        record.wait.function = function;
        launched_ = 0;
        after_wait_ = true;
    }

    void task_begin(int task, std::uint32_t token) {
        hint(abi::TraceKind::kTaskBegin, task, token);
    }
    void task_end(int task, std::uint32_t token) { hint(abi::TraceKind::kTaskEnd, task, token); }
    /// The runtime followed a hint, from whatever thread.
    void instance_begin(int task, std::uint32_t instance) {
        hint(abi::TraceKind::kInstanceBegin, task, instance);
    }

    void push(const std::string& range) {
        const std::uint64_t hash = trace_.text(id_, range);
        trace_.add(id_, abi::TraceKind::kRangePush, now_ns_).hash = hash;
    }
    void pop() { trace_.add(id_, abi::TraceKind::kRangePop, now_ns_); }

  private:
    std::uint32_t cpu_us() const { return static_cast<std::uint32_t>(cpu_ns_ / 1000); }
    static std::uint64_t gpu_time(std::int64_t time_ns) {
        return (kGpuEpochNs + static_cast<std::uint64_t>(time_ns)) & ((std::uint64_t{1} << 48) - 1);
    }

    void hint(abi::TraceKind kind, int task, std::uint32_t instance) {
        abi::TraceRecord& record = trace_.add(id_, kind, now_ns_);
        record.task = static_cast<std::int16_t>(task);
        record.instance = instance;
        record.cpu_us = cpu_us();
        if (kind == abi::TraceKind::kInstanceBegin) record.flags = abi::kTraceHinted;
    }

    TraceBuilder& trace_;
    std::uint32_t id_;
    std::int64_t now_ns_;
    std::int64_t cpu_ns_ = 1'000'000;
    std::int64_t gpu_free_ns_ = 0;
    std::uint32_t launched_ = 0;
    bool after_wait_ = true;
};

}  // namespace urgengo::testing
