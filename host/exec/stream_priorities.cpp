// SPDX-License-Identifier: Apache-2.0
#include "host/exec/stream_priorities.h"

#include <algorithm>

namespace urgengo::exec {

StreamPriorities::Loan* StreamPriorities::find(const StreamKey& key) const {
    const auto loan =
        std::find_if(loans_.begin(), loans_.end(), [&](const Loan& l) { return l.key == key; });
    return loan == loans_.end() ? nullptr : &*loan;
}

bool StreamPriorities::get(CUstream stream, StreamFlavor flavor, int& priority) const {
    const auto function =
        of_flavor(flavor, driver_.cuStreamGetAttribute, driver_.cuStreamGetAttribute_ptsz);
    CUstreamAttrValue value{};
    if (!function || function(stream, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value) != CUDA_SUCCESS)
        return false;
    priority = value.priority;
    return true;
}

bool StreamPriorities::set(CUstream stream, StreamFlavor flavor, int priority) const {
    const auto function =
        of_flavor(flavor, driver_.cuStreamSetAttribute, driver_.cuStreamSetAttribute_ptsz);
    CUstreamAttrValue value{};
    value.priority = priority;
    return function && function(stream, CU_LAUNCH_ATTRIBUTE_PRIORITY, &value) == CUDA_SUCCESS;
}

bool StreamPriorities::lend(CUstream stream, StreamFlavor flavor, int priority) {
    const StreamKey key = stream_key(driver_, stream, flavor);
    const std::lock_guard lock(mutex_);
    Loan* loan = find(key);
    const bool is_new = !loan;
    if (is_new) {
        int own = 0;
        if (!get(stream, flavor, own) || own == priority) return false;  // nothing to lend
        loans_.push_back({key, own, 0});
        loan = &loans_.back();
        ever_lent_.store(true);
    }
    if (!set(stream, flavor, priority)) {
        if (is_new) loans_.erase(loans_.begin() + (loan - loans_.data()));
        return false;
    }
    ++loan->lenders;
    return true;
}

void StreamPriorities::give_back(CUstream stream, StreamFlavor flavor) {
    const StreamKey key = stream_key(driver_, stream, flavor);
    const std::lock_guard lock(mutex_);
    Loan* loan = find(key);
    if (!loan || --loan->lenders > 0) return;
    // A refusal may pass; until it has, the program's questions are still answered for it.
    if (!set(stream, flavor, loan->own) && !set(stream, flavor, loan->own)) return;
    loans_.erase(loans_.begin() + (loan - loans_.data()));
}

int StreamPriorities::own(CUstream stream, StreamFlavor flavor) const {
    const auto function =
        of_flavor(flavor, driver_.cuStreamGetPriority, driver_.cuStreamGetPriority_ptsz);
    int priority = 0;
    if (function)
        ask(
            stream, flavor, [&] { return function(stream, &priority); },
            [&](int own) { priority = own; });
    return priority;
}

void StreamPriorities::forget(CUstream stream) {
    if (!ever_lent_.load()) return;
    const std::lock_guard lock(mutex_);
    std::erase_if(loans_, [&](const Loan& l) {
        return l.lenders == 0 && (!stream || l.key.stream == stream);
    });
}

void StreamPriorities::give_back_refused() {
    if (!ever_lent_.load()) return;
    const std::lock_guard lock(mutex_);
    std::erase_if(loans_, [&](const Loan& l) {
        // A default stream is another one in this thread.
        return l.lenders == 0 && !is_default_stream(l.key.stream) &&
               set(l.key.stream, StreamFlavor::kLegacy, l.own);
    });
}

void StreamPriorities::restore(CUstream stream, StreamFlavor flavor) {
    if (!ever_lent_.load()) return;
    const StreamKey key = stream_key(driver_, stream, flavor);
    const std::lock_guard lock(mutex_);
    if (const Loan* loan = find(key)) set(stream, flavor, loan->own);
}

}  // namespace urgengo::exec
