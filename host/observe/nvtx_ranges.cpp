// SPDX-License-Identifier: Apache-2.0
#include "host/observe/nvtx_ranges.h"

#include <pthread.h>

#include <algorithm>
#include <new>

#include "host/base/hash.h"

namespace urgengo::observe {
namespace {

// A pointer and not the stack itself: a library that is opened late has little of this storage.
__attribute__((tls_model("initial-exec"))) thread_local RangeStack* t_ranges = nullptr;
__attribute__((tls_model("initial-exec"))) thread_local bool t_ended = false;

void end_thread(void* ranges) {
    t_ranges = nullptr;
    t_ended = true;
    delete static_cast<RangeStack*>(ranges);
}

// @returns whether there is a key, made once, by whose destructor stacks end with their threads
bool thread_key(pthread_key_t& key) {
    struct Key {
        pthread_key_t key{};
        bool made = false;
    };
    static const Key the_key = [] {
        Key made;
        made.made = pthread_key_create(&made.key, end_thread) == 0;
        return made;
    }();
    key = the_key.key;
    return the_key.made;
}

}  // namespace

void RangeStack::push(std::string_view name, const void* domain) {
    if (++epoch_ == 0) epoch_ = 1;
    if (depth_ == kMaxDepth) {
        ++deeper_;
        return;
    }
    name = name.substr(0, kMaxNameBytes);
    Range& range = ranges_[static_cast<std::size_t>(depth_++)];
    range.domain = domain;
    range.hash = fnv1a64(name);
    range.length = name.size();
    name.copy(range.name, name.size());  // of no name, too, which may have no data
}

void RangeStack::pop(const void* domain) {
    if (deeper_ > 0) {  // of whatever domain: they were not kept
        --deeper_;
    } else {
        int i = depth_ - 1;
        while (i >= 0 && ranges_[static_cast<std::size_t>(i)].domain != domain) --i;
        if (i < 0) return;
        std::copy(ranges_.begin() + i + 1, ranges_.begin() + depth_, ranges_.begin() + i);
        --depth_;
    }
    if (++epoch_ == 0) epoch_ = 1;
}

const RangeStack* this_thread_ranges() {
    return t_ranges;
}

RangeStack* make_this_thread_ranges() {
    if (t_ranges || t_ended) return t_ranges;
    pthread_key_t key;
    if (!thread_key(key)) return nullptr;
    auto* ranges = new (std::nothrow) RangeStack;
    if (ranges && pthread_setspecific(key, ranges) != 0) {
        delete ranges;
        return nullptr;
    }
    return t_ranges = ranges;
}

}  // namespace urgengo::observe
