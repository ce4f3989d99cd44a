// SPDX-License-Identifier: Apache-2.0
#include "host/identity/instances.h"

#include <algorithm>

namespace urgengo::identity {

std::uint64_t Instances::arrived(std::size_t index, nanoseconds when) {
    Chain& chain = chains_[index];
    bool dropped = false;
    Instance frame;
    {
        const std::lock_guard lock(mutex_);
        frame = chain.hinted.add(*chain.state, index, chains_.size(), when, dropped);
    }
    missed(*chain.state, dropped ? 1 : 0);
    return frame.token;
}

Instance Instances::find(std::uint64_t token) {
    const std::lock_guard lock(mutex_);
    const std::size_t index = InstanceRing::chain_of(token, chains_.size());
    return index < chains_.size() ? chains_[index].hinted.find(token, chains_.size()) : Instance{};
}

void Instances::forget(std::uint64_t token) {
    const std::lock_guard lock(mutex_);
    const std::size_t index = InstanceRing::chain_of(token, chains_.size());
    if (index < chains_.size()) chains_[index].hinted.forget(token, chains_.size());
}

void Instances::drop_late(nanoseconds now) {
    for (Chain& chain : chains_) {
        std::uint64_t dropped = 0;
        {
            const std::unique_lock lock(mutex_, std::try_to_lock);
            if (!lock.owns_lock()) return;
            dropped = chain.hinted.drop_before(now - chain.state->deadline());
        }
        missed(*chain.state, dropped);
    }
}

std::optional<nanoseconds> Instances::taken_over(std::size_t index, std::size_t stage,
                                                 std::optional<nanoseconds> slept_since) {
    std::uint64_t skipped = 0;
    std::unique_lock lock(mutex_);
    auto& passages = chains_[index].passages;
    const auto ready = [&](const Passage& p) {
        return stage > 0 && p.next_stage == stage && !p.running;
    };
    // A thread that has slept since its last wait had nothing to do then: of what the stage before
    // had finished by then, it has skipped all that is there no more.
    while (slept_since && std::count_if(passages.begin(), passages.end(), ready) > 1) {
        const auto oldest = std::find_if(passages.begin(), passages.end(), ready);
        if (oldest->finished >= *slept_since) break;
        passages.erase(oldest);
        ++skipped;
    }
    std::optional<nanoseconds> arrival;
    if (const auto next = std::find_if(passages.begin(), passages.end(), ready);
        next != passages.end()) {
        next->running = true;
        ++next->next_stage;
        arrival = next->arrival;
    }
    lock.unlock();
    missed(*chains_[index].state, skipped);
    return arrival;
}

void Instances::entered(std::size_t index, std::size_t stage, nanoseconds arrival) {
    Chain& chain = chains_[index];
    // Frames that never came to their end: the program dropped them on the way.
    const auto is_dropped = [&](const Passage& p) {
        return arrival - p.arrival > chain.state->abandoned_after();
    };
    std::uint64_t dropped = 0;
    {
        const std::lock_guard lock(mutex_);
        dropped = std::erase_if(chain.passages, is_dropped);
        if (chain.passages.size() < InstanceRing::kSize)
            chain.passages.push_back({arrival, stage + 1, true, nanoseconds{0}});
    }
    missed(*chain.state, dropped);
}

void Instances::handed_on(std::size_t index, std::size_t stage, nanoseconds arrival,
                          nanoseconds now) {
    const std::lock_guard lock(mutex_);
    Chain& chain = chains_[index];
    const auto ours =
        std::find_if(chain.passages.begin(), chain.passages.end(), [&](const Passage& p) {
            return p.running && p.next_stage == stage + 1 && p.arrival == arrival;
        });
    if (ours == chain.passages.end()) return;
    if (stage + 1 == chain.state->tasks.size()) return void(chain.passages.erase(ours));
    ours->running = false;
    ours->finished = now;
}

void Instances::forget_passages() {
    const std::lock_guard lock(mutex_);
    for (Chain& chain : chains_) chain.passages.clear();
}

void Instances::forget_passages(std::size_t chain) {
    const std::lock_guard lock(mutex_);
    chains_[chain].passages.clear();
}

void Instances::missed(ChainState& chain, std::uint64_t frames) const {
    for (; frames > 0; --frames) {
        chain.missed();
        if (dropped_) dropped_(chain);
    }
}

}  // namespace urgengo::identity
