// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/gpu_model.h"

#include <algorithm>
#include <cassert>

namespace urgengo::sim {
namespace {

constexpr std::uint32_t kWarp = 32;

/// Blocks on the fullest multiprocessor.
std::uint64_t fullest(std::uint64_t blocks, std::uint64_t num_sms) {
    return (blocks + num_sms - 1) / num_sms;
}

std::uint64_t room(const GpuShape& shape) {
    return static_cast<std::uint64_t>(shape.num_sms) *
           static_cast<std::uint64_t>(shape.threads_per_sm);
}

}  // namespace

GpuModel::GpuModel(const GpuShape& shape)
    : shape_(shape),
      connections_(static_cast<std::size_t>(shape.num_connections)),
      is_held_(connections_.size()) {}

int GpuModel::add_stream() {
    Stream stream;
    stream.connection = static_cast<int>(streams_.size()) % shape_.num_connections;
    streams_.push_back(stream);
    return static_cast<int>(streams_.size()) - 1;
}

void GpuModel::launch(int stream, const KernelWork& work) {
    append({stream, work, now_});
}

void GpuModel::join(int stream, int other) {
    if (stream == other) return;
    KernelWork work;
    work.joins = other;
    append({stream, work, now_, at(other).num_launched});
}

void GpuModel::append(const Command& command) {
    Stream& its = at(command.stream);
    ++its.num_launched;
    connections_[static_cast<std::size_t>(its.connection)].push_back(command);
    release(its.connection);
    dispatch();
}

// Who is first in the queue goes as soon as its stream is free.
void GpuModel::release(int connection) {
    const auto place = static_cast<std::size_t>(connection);
    auto& queue = connections_[place];
    while (!queue.empty() && !is_held_[place] && !at(queue.front().stream).is_busy) {
        const auto [stream, work, launched, awaited] = queue.front();
        queue.pop_front();
        Stream& its = at(stream);
        its.is_busy = true;
        its.work = work;
        its.awaited = awaited;
        if (work.joins >= 0) {
            if (!begin_join(stream)) joining_.push_back(stream);
            continue;
        }
        if (work.word >= 0) {
            is_held_[place] = true;
            begin_gate(stream);
            continue;
        }
        if (work.is_mark) {
            waiting_marks_.push_back(stream);
            begin_marks();
            continue;
        }
        const nanoseconds gap =
            resident_blocks_ + whole_blocks_ > 0 ? shape_.gap_shared : shape_.gap;
        const nanoseconds ready =
            std::max(launched + shape_.start, its.has_run ? its.last_end + gap : now_);
        if (ready > now_)
            gaps_.push(ready, 0, stream);
        else
            make_ready(stream);
    }
}

// Numbers go round, as those of a word that a stream waits for.
bool GpuModel::is_open(const KernelWork& gate) const {
    const auto word = static_cast<std::size_t>(gate.word);
    const std::uint32_t number = word < words_.size() ? words_[word] : 0;
    return static_cast<std::int32_t>(number - gate.number) >= 0;
}

void GpuModel::begin_gate(int stream) {
    const KernelWork& gate = at(stream).work;
    if (is_open(gate))
        marks_.push(now_ + gate.mark, 0, stream);
    else
        gated_.push_back(stream);
}

void GpuModel::open(int word, std::uint32_t number, nanoseconds late) {
    const auto place = static_cast<std::size_t>(word);
    if (place >= words_.size()) words_.resize(place + 1);
    words_[place] = number;
    std::erase_if(gated_, [&](int stream) {
        const KernelWork& gate = at(stream).work;
        if (gate.word != word || !is_open(gate)) return false;
        marks_.push(now_ + late, 0, stream);
        return true;
    });
}

/// @returns whether it is over already
bool GpuModel::begin_join(int stream) {
    const Stream& its = at(stream);
    if (at(its.work.joins).num_ended < its.awaited) return false;
    end_command(stream);
    return true;
}

// The other stream has come further.
void GpuModel::end_joins(int other) {
    const auto is_over = [&](int stream) {
        return at(stream).work.joins == other && at(other).num_ended >= at(stream).awaited;
    };
    for (std::size_t i = 0; i < joining_.size();) {
        const int stream = joining_[i];
        if (!is_over(stream)) {
            ++i;
            continue;
        }
        joining_.erase(joining_.begin() + static_cast<std::ptrdiff_t>(i));
        end_command(stream);
        i = 0;  // others may have waited for this one
    }
}

void GpuModel::make_ready(int stream) {
    Stream& its = at(stream);
    its.undispatched = its.work.blocks;
    its.order = num_ready_++;
    ready_.insert({its.work.priority, its.order, stream});
}

// An event needs no slot, a mark kernel one.
void GpuModel::begin_marks() {
    KernelWork warp;
    warp.block_threads = kWarp;
    std::erase_if(waiting_marks_, [&](int stream) {
        const nanoseconds time = at(stream).work.mark;
        if (time.count() > 0 && room_for(warp) == 0) return false;
        marks_.push(now_ + time, 0, stream);
        return true;
    });
}

void GpuModel::dispatch() {
    if (!waiting_marks_.empty()) begin_marks();
    while (!ready_.empty()) {
        Stream& its = at(ready_.begin()->stream);
        const bool is_short = its.undispatched <= its.work.num_short;
        const std::uint32_t alike = its.undispatched - (is_short ? 0 : its.work.num_short);
        const auto blocks =
            static_cast<std::uint32_t>(std::min<std::uint64_t>(alike, room_for(its.work)));
        if (blocks == 0) break;
        int group = static_cast<int>(groups_.size());
        if (free_groups_.empty()) {
            groups_.emplace_back();
        } else {
            group = free_groups_.back();
            free_groups_.pop_back();
        }
        groups_[static_cast<std::size_t>(group)] = {ready_.begin()->stream, blocks};
        const double block_ns = is_short ? its.work.short_ns : its.work.block_ns;
        its.undispatched -= blocks;
        its.running += blocks;
        if (is_whole(its.work)) {
            whole_.add(block_ns, group);
            whole_blocks_ += blocks;
        } else {
            clock_.add(block_ns, group);
            used_threads_ += std::uint64_t{blocks} * its.work.block_threads;
            resident_blocks_ += blocks;
            spread_ = std::min(shared_sms(), spread_ + blocks);
        }
        if (its.undispatched == 0) ready_.erase(ready_.begin());
    }
    share();
}

// Blocks that it has room for now.
std::uint64_t GpuModel::room_for(const KernelWork& work) const {
    if (is_whole(work)) return shared_sms() - spread_;
    const std::uint64_t threads = shared_sms() * static_cast<std::uint64_t>(shape_.threads_per_sm);
    return (threads - used_threads_) / work.block_threads;
}

void GpuModel::share() {
    if (resident_blocks_ == 0) return;
    clock_.set_rate(1.0 / static_cast<double>(fullest(resident_blocks_, spread_)));
}

void GpuModel::end_group(int group) {
    const auto [stream, blocks] = groups_[static_cast<std::size_t>(group)];
    free_groups_.push_back(group);
    Stream& its = at(stream);
    its.running -= blocks;
    if (is_whole(its.work)) {
        whole_blocks_ -= blocks;
    } else {
        used_threads_ -= std::uint64_t{blocks} * its.work.block_threads;
        resident_blocks_ -= blocks;
        spread_ = std::min(spread_, resident_blocks_);
    }
    if (its.running == 0 && its.undispatched == 0) end_command(stream);
}

void GpuModel::end_command(int stream) {
    Stream& its = at(stream);
    its.is_busy = false;
    if (its.work.word >= 0) is_held_[static_cast<std::size_t>(its.connection)] = false;
    if (its.work.joins >= 0) {
        // What comes next follows the later of the two.
        const Stream& other = at(its.work.joins);
        its.has_run |= other.has_run;
        its.last_end = std::max(its.last_end, other.last_end);
    } else if (!its.work.is_mark || its.work.mark.count() > 0) {
        // An event takes nothing of its stream.
        its.has_run = true;
        its.last_end = now_;
    }
    ++its.num_ended;
    ended_.push_back({stream, its.work.tag});
    if (!joining_.empty()) end_joins(stream);
}

nanoseconds GpuModel::next() const {
    return std::min({gaps_.next(), marks_.next(), clock_.next(), whole_.next()});
}

const std::vector<EndedKernel>& GpuModel::advance(nanoseconds now) {
    assert(now <= next());
    ended_.clear();
    now_ = now;
    clock_.advance(now);
    whole_.advance(now);
    // All that is due at one moment happens before blocks are handed out.
    while (clock_.is_due()) end_group(clock_.pop());
    while (whole_.is_due()) end_group(whole_.pop());
    while (marks_.next() <= now) end_command(marks_.pop().subject);
    while (gaps_.next() <= now) make_ready(gaps_.pop().subject);
    dispatch();
    // A release may end joins.
    for (std::size_t i = 0; i < ended_.size(); ++i) release(at(ended_[i].stream).connection);
    if (!ended_.empty()) dispatch();
    return ended_;
}

double GpuModel::time_alone_ns(const GpuShape& shape, std::uint32_t blocks,
                               std::uint32_t block_threads, double block_ns) {
    const auto num_sms = static_cast<std::uint64_t>(shape.num_sms);
    const std::uint64_t wave = room(shape) / block_threads;
    const std::uint64_t rounds =
        blocks / wave * fullest(wave, num_sms) + fullest(blocks % wave, num_sms);
    return block_ns * static_cast<double>(rounds);
}

}  // namespace urgengo::sim
