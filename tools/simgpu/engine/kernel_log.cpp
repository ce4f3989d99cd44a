// SPDX-License-Identifier: Apache-2.0
//
// A bounded ring of kernel records.
#include "tools/simgpu/engine/kernel_log.h"

#include <algorithm>

namespace urgengo::simgpu {

void KernelLog::add(const KernelRecord& record) {
    simgpu_kernel_record entry{};
    record.name->copy(entry.name, sizeof entry.name - 1);
    entry.device = static_cast<std::uint32_t>(record.device);
    entry.stream_id = record.stream_id;
    entry.priority = record.priority;
    entry.num_blocks = record.num_blocks;
    entry.start_ns = record.start.count();
    entry.end_ns = record.end.count();
    entry.launch = record.launch;

    std::lock_guard lock(mutex_);
    if (records_.size() == kMaxRecords) records_.pop_front();
    records_.push_back(entry);
}

std::size_t KernelLog::read(simgpu_kernel_record* out, std::size_t max) const {
    std::lock_guard lock(mutex_);
    std::copy_n(records_.begin(), std::min(max, records_.size()), out);
    return records_.size();
}

void KernelLog::clear() {
    std::lock_guard lock(mutex_);
    records_.clear();
}

}  // namespace urgengo::simgpu
