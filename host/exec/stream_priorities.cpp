// SPDX-License-Identifier: Apache-2.0
#include "host/exec/stream_priorities.h"

#include <algorithm>

namespace urgengo::exec {

StreamPriorities::Key StreamPriorities::key_of(CUstream stream, StreamFlavor flavor) const {
    if (!is_default_stream(stream)) return {stream, nullptr};
    static thread_local const char t_thread = 0;
    if (stream == CU_STREAM_PER_THREAD || (!stream && flavor == StreamFlavor::kPerThread))
        return {CU_STREAM_PER_THREAD, &t_thread};
    CUcontext context = nullptr;
    if (driver_.cuCtxGetCurrent(&context) != CUDA_SUCCESS) context = nullptr;
    return {CU_STREAM_LEGACY, context};
}

StreamPriorities::Loan* StreamPriorities::find(const Key& key) const {
    const auto loan =
        std::find_if(loans_.begin(), loans_.end(), [&](const Loan& l) { return l.key == key; });
    return loan == loans_.end() ? nullptr : &*loan;
}

bool StreamPriorities::get(CUstream stream, StreamFlavor flavor, int& priority) const {
    const auto function = flavor == StreamFlavor::kPerThread ? driver_.cuStreamGetAttribute_ptsz
                                                             : driver_.cuStreamGetAttribute;
    CUstreamAttrValue value{};
    if (!function || function(stream, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value) != CUDA_SUCCESS)
        return false;
    priority = value.priority;
    return true;
}

bool StreamPriorities::set(CUstream stream, StreamFlavor flavor, int priority) const {
    const auto function = flavor == StreamFlavor::kPerThread ? driver_.cuStreamSetAttribute_ptsz
                                                             : driver_.cuStreamSetAttribute;
    CUstreamAttrValue value{};
    value.priority = priority;
    return function && function(stream, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value) == CUDA_SUCCESS;
}

bool StreamPriorities::lend(CUstream stream, StreamFlavor flavor, int priority) {
    const Key key = key_of(stream, flavor);
    const std::lock_guard lock(mutex_);
    Loan* loan = find(key);
    if (!loan) {
        int own = 0;
        if (!get(stream, flavor, own) || own == priority) return false;  // nothing to lend
        loans_.push_back({key, own, 0});
        loan = &loans_.back();
        ever_lent_.store(true);
    }
    if (!set(stream, flavor, priority)) {
        if (loan->lenders == 0) loans_.erase(loans_.begin() + (loan - loans_.data()));
        return false;
    }
    ++loan->lenders;
    return true;
}

void StreamPriorities::give_back(CUstream stream, StreamFlavor flavor) {
    const Key key = key_of(stream, flavor);
    const std::lock_guard lock(mutex_);
    Loan* loan = find(key);
    if (!loan || --loan->lenders > 0) return;
    set(stream, flavor, loan->own);
    loans_.erase(loans_.begin() + (loan - loans_.data()));
}

int StreamPriorities::own(CUstream stream, StreamFlavor flavor) const {
    const auto function = flavor == StreamFlavor::kPerThread ? driver_.cuStreamGetPriority_ptsz
                                                             : driver_.cuStreamGetPriority;
    int priority = 0;
    if (function)
        ask(
            stream, flavor, [&] { return function(stream, &priority); },
            [&](int own) { priority = own; });
    return priority;
}

void StreamPriorities::program_set(CUstream stream, StreamFlavor flavor) {
    if (!ever_lent_.load()) return;
    const Key key = key_of(stream, flavor);
    const std::lock_guard lock(mutex_);
    if (Loan* loan = find(key)) get(stream, flavor, loan->own);
}

void StreamPriorities::restore(CUstream stream, StreamFlavor flavor) {
    if (!ever_lent_.load()) return;
    const Key key = key_of(stream, flavor);
    const std::lock_guard lock(mutex_);
    if (const Loan* loan = find(key)) set(stream, flavor, loan->own);
}

}  // namespace urgengo::exec
