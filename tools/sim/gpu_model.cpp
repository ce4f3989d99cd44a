// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/gpu_model.h"

#include <algorithm>
#include <cassert>

namespace urgengo::sim {
namespace {

/// Blocks on the fullest multiprocessor.
std::uint64_t fullest(std::uint64_t blocks, int num_sms) {
    const auto sms = static_cast<std::uint64_t>(num_sms);
    return (blocks + sms - 1) / sms;
}

std::uint64_t room(const GpuShape& shape) {
    return static_cast<std::uint64_t>(shape.num_sms) *
           static_cast<std::uint64_t>(shape.threads_per_sm);
}

}  // namespace

GpuModel::GpuModel(const GpuShape& shape)
    : shape_(shape),
      connections_(static_cast<std::size_t>(shape.num_connections)),
      free_threads_(room(shape)) {}

int GpuModel::add_stream() {
    Stream stream;
    stream.connection = static_cast<int>(streams_.size()) % shape_.num_connections;
    streams_.push_back(stream);
    return static_cast<int>(streams_.size()) - 1;
}

void GpuModel::launch(int stream, const KernelWork& work) {
    Stream& its = at(stream);
    ++its.num_launched;
    connections_[static_cast<std::size_t>(its.connection)].push_back({stream, work, now_});
    release(its.connection);
    dispatch();
}

// Who is first in the queue goes as soon as its stream is free.
void GpuModel::release(int connection) {
    auto& queue = connections_[static_cast<std::size_t>(connection)];
    while (!queue.empty() && !at(queue.front().stream).is_busy) {
        const auto [stream, work, launched] = queue.front();
        queue.pop_front();
        Stream& its = at(stream);
        its.is_busy = true;
        its.work = work;
        if (work.is_mark) {
            marks_.push(now_ + work.mark, 0, stream);
            continue;
        }
        const nanoseconds gap = resident_blocks_ > 0 ? shape_.gap_shared : shape_.gap;
        const nanoseconds ready =
            std::max(launched + shape_.start, its.has_run ? its.last_end + gap : now_);
        if (ready > now_)
            gaps_.push(ready, 0, stream);
        else
            make_ready(stream);
    }
}

void GpuModel::make_ready(int stream) {
    Stream& its = at(stream);
    its.undispatched = its.work.blocks;
    its.order = num_ready_++;
    ready_.insert({its.work.priority, its.order, stream});
}

void GpuModel::dispatch() {
    while (!ready_.empty()) {
        Stream& its = at(ready_.begin()->stream);
        const std::uint64_t room = free_threads_ / its.work.block_threads;
        const auto blocks =
            static_cast<std::uint32_t>(std::min<std::uint64_t>(its.undispatched, room));
        if (blocks == 0) break;
        int group = static_cast<int>(groups_.size());
        if (free_groups_.empty()) {
            groups_.emplace_back();
        } else {
            group = free_groups_.back();
            free_groups_.pop_back();
        }
        groups_[static_cast<std::size_t>(group)] = {ready_.begin()->stream, blocks};
        clock_.add(its.work.block_ns, group);
        its.undispatched -= blocks;
        its.running += blocks;
        free_threads_ -= std::uint64_t{blocks} * its.work.block_threads;
        resident_blocks_ += blocks;
        if (its.undispatched == 0) ready_.erase(ready_.begin());
    }
    share();
}

void GpuModel::share() {
    if (resident_blocks_ == 0) return;
    clock_.set_rate(1.0 / static_cast<double>(fullest(resident_blocks_, shape_.num_sms)));
}

void GpuModel::end_group(int group) {
    const auto [stream, blocks] = groups_[static_cast<std::size_t>(group)];
    free_groups_.push_back(group);
    Stream& its = at(stream);
    its.running -= blocks;
    free_threads_ += std::uint64_t{blocks} * its.work.block_threads;
    resident_blocks_ -= blocks;
    if (its.running == 0 && its.undispatched == 0) end_command(stream);
}

void GpuModel::end_command(int stream) {
    Stream& its = at(stream);
    its.is_busy = false;
    // An event takes nothing of its stream.
    if (!its.work.is_mark || its.work.mark.count() > 0) {
        its.has_run = true;
        its.last_end = now_;
    }
    ++its.num_ended;
    ended_.push_back({stream, its.work.tag});
}

nanoseconds GpuModel::next() const {
    return std::min({gaps_.next(), marks_.next(), clock_.next()});
}

const std::vector<EndedKernel>& GpuModel::advance(nanoseconds now) {
    assert(now <= next());
    ended_.clear();
    now_ = now;
    clock_.advance(now);
    // All that is due at one moment happens before blocks are handed out.
    while (clock_.is_due()) end_group(clock_.pop());
    while (marks_.next() <= now) end_command(marks_.pop().subject);
    while (gaps_.next() <= now) make_ready(gaps_.pop().subject);
    dispatch();
    for (const EndedKernel& kernel : ended_) release(at(kernel.stream).connection);
    if (!ended_.empty()) dispatch();
    return ended_;
}

double GpuModel::time_alone_ns(const GpuShape& shape, std::uint32_t blocks,
                               std::uint32_t block_threads, double block_ns) {
    const std::uint64_t wave = room(shape) / block_threads;
    const std::uint64_t rounds =
        blocks / wave * fullest(wave, shape.num_sms) + fullest(blocks % wave, shape.num_sms);
    return block_ns * static_cast<double>(rounds);
}

}  // namespace urgengo::sim
