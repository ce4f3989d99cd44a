// SPDX-License-Identifier: Apache-2.0
//
// The words that stand for the enumerators of config.h, in YAML, in the resolved JSON and on the
// command line: one table per enum, so that reading, writing and error messages cannot disagree.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

#include "host/config/config.h"

namespace urgengo::config {

template <typename E>
struct Word {
    std::string_view word;
    E value;
};

/// The words of enum E, in the order in which error messages list them.
template <typename E>
inline constexpr std::array<Word<E>, 0> kWords{};

template <>
inline constexpr std::array kWords<Mode> = {
    Word<Mode>{"off", Mode::kOff},
    Word<Mode>{"observe", Mode::kObserve},
    Word<Mode>{"shadow", Mode::kShadow},
    Word<Mode>{"enforce", Mode::kEnforce},
};
template <>
inline constexpr std::array kWords<OnLate> = {
    Word<OnLate>{"continue", OnLate::kContinue},
    Word<OnLate>{"demote", OnLate::kDemote},
    Word<OnLate>{"exit", OnLate::kExit},
};
template <>
inline constexpr std::array kWords<ArrivalFrom> = {
    Word<ArrivalFrom>{"first_call", ArrivalFrom::kFirstCall},
    Word<ArrivalFrom>{"hint", ArrivalFrom::kHint},
};
template <>
inline constexpr std::array kWords<Policy> = {
    Word<Policy>{"feasible", Policy::kFeasible},
    Word<Policy>{"urgency", Policy::kUrgency},
    Word<Policy>{"edf", Policy::kEdf},
    Word<Policy>{"eqdf", Policy::kEqdf},
    Word<Policy>{"saedf", Policy::kSaedf},
    Word<Policy>{"lcuf", Policy::kLcuf},
    Word<Policy>{"sjf", Policy::kSjf},
    Word<Policy>{"hrrn", Policy::kHrrn},
    Word<Policy>{"static", Policy::kStatic},
    Word<Policy>{"fifo", Policy::kFifo},
    Word<Policy>{"utilization", Policy::kUtilization},
};
template <>
inline constexpr std::array kWords<Binding> = {
    Word<Binding>{"none", Binding::kNone},
    Word<Binding>{"task", Binding::kTask},
    Word<Binding>{"kernel", Binding::kKernel},
    Word<Binding>{"static", Binding::kStatic},
};
template <>
inline constexpr std::array kWords<Dispatch> = {
    Word<Dispatch>{"thread", Dispatch::kThread},
    Word<Dispatch>{"host", Dispatch::kHost},
    Word<Dispatch>{"device", Dispatch::kDevice},
    Word<Dispatch>{"auto", Dispatch::kAuto},
};
template <>
inline constexpr std::array kWords<DeviceDispatch> = {
    Word<DeviceDispatch>{"piggyback", DeviceDispatch::kPiggyback},
    Word<DeviceDispatch>{"leased", DeviceDispatch::kLeased},
    Word<DeviceDispatch>{"armed", DeviceDispatch::kArmed},
};
template <>
inline constexpr std::array kWords<Admission> = {
    Word<Admission>{"none", Admission::kNone},
    Word<Admission>{"threshold", Admission::kThreshold},
    Word<Admission>{"packed", Admission::kPacked},
    Word<Admission>{"exclusive", Admission::kExclusive},
    Word<Admission>{"buckets", Admission::kBuckets},
    Word<Admission>{"groups", Admission::kGroups},
};
template <>
inline constexpr std::array kWords<PriorityVia> = {
    Word<PriorityVia>{"auto", PriorityVia::kAuto},
    Word<PriorityVia>{"launch_attribute", PriorityVia::kLaunchAttribute},
    Word<PriorityVia>{"stream_attribute", PriorityVia::kStreamAttribute},
    Word<PriorityVia>{"stream_pool", PriorityVia::kStreamPool},
};
template <>
inline constexpr std::array kWords<ProgressSource> = {
    Word<ProgressSource>{"auto", ProgressSource::kAuto},
    Word<ProgressSource>{"kernel", ProgressSource::kKernel},
    Word<ProgressSource>{"memop", ProgressSource::kMemop},
    Word<ProgressSource>{"event", ProgressSource::kEvent},
};
template <>
inline constexpr std::array kWords<NvtxEvents> = {
    Word<NvtxEvents>{"auto", NvtxEvents::kAuto},
    Word<NvtxEvents>{"on", NvtxEvents::kOn},
    Word<NvtxEvents>{"off", NvtxEvents::kOff},
};
template <>
inline constexpr std::array kWords<Tracking> = {
    Word<Tracking>{"progress", Tracking::kProgress},
    Word<Tracking>{"async", Tracking::kAsync},
    Word<Tracking>{"sync", Tracking::kSync},
    Word<Tracking>{"batched", Tracking::kBatched},
    Word<Tracking>{"overlapped", Tracking::kOverlapped},
};

template <typename E>
std::optional<E> from_word(std::string_view word) {
    for (const auto& entry : kWords<E>) {
        if (entry.word == word) return entry.value;
    }
    return std::nullopt;
}

template <typename E>
std::string to_word(E value) {
    for (const auto& entry : kWords<E>) {
        if (entry.value == value) return std::string(entry.word);
    }
    return {};
}

/// @returns "off, observe, shadow, enforce"
template <typename E>
std::string all_words() {
    std::string list;
    for (const auto& entry : kWords<E>) {
        if (!list.empty()) list += ", ";
        list += entry.word;
    }
    return list;
}

}  // namespace urgengo::config
