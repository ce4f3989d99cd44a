// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_variant.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <utility>
#include <vector>

#include "host/config/config_reader.h"
#include "host/config/limits.h"
#include "host/config/names.h"

namespace urgengo::cli {
namespace {

constexpr std::string_view kLearn = "learn", kEvery = "every=", kNoise = "noise=", kNice = "nice=";
/// An estimate is never less than nothing.
constexpr config::Range<std::int64_t> kNoisePct{1, 100};

std::optional<int> integer(std::string_view text, config::Range<std::int64_t> range) {
    int value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    const bool complete = error == std::errc{} && end == text.data() + text.size();
    if (!complete || value < range.min || value > range.max) return std::nullopt;
    return value;
}

std::optional<unsigned> number(std::string_view text, config::Range<std::int64_t> range) {
    const auto value = integer(text, range);
    return value ? std::optional(static_cast<unsigned>(*value)) : std::nullopt;
}

/// @returns whether `value` was not there before and is now
template <typename T>
bool set_once(std::optional<T>& value, std::optional<T> found) {
    if (value || !found) return false;
    value = found;
    return true;
}

bool read_tracking(std::string_view word, Variant& variant) {
    const auto mark = word.find(kIntervalMark);
    if (!set_once(variant.tracking, config::from_word<config::Tracking>(word.substr(0, mark))))
        return false;
    if (mark == std::string_view::npos) return true;
    variant.eval_interval_us = number(word.substr(mark + 1), config::kEvalIntervalUs);
    return variant.waits_for_batches() && variant.eval_interval_us.has_value();
}

/// Keys that a row may set to a value.
constexpr std::array kKeys{"policy",
                           "binding",
                           "admission",
                           "pack_limit",
                           "lambda",
                           "run_ahead_us",
                           "run_ahead_alone_us",
                           "exempt_utilization",
                           "urgent_percentile",
                           "quantum_us",
                           "priority_levels",
                           "launchers",
                           "plan_margin",
                           "share_limit",
                           "share_slack_us",
                           "guard",
                           "hold",
                           "dispatch"};

/// Of a row, one word says who opens gates, or how the GPU does; after @ the groups' time, us.
std::string dispatch_of(std::string_view value) {
    const auto at = value.find('@');
    const std::string_view word = value.substr(0, at);
    const std::string where = config::from_word<config::DeviceDispatch>(word)
                                  ? fmt::format("where: device, device: {}", word)
                                  : fmt::format("where: {}", word);
    return at == std::string_view::npos
               ? fmt::format("{{{}}}", where)
               : fmt::format("{{{}, group_us: {}}}", where, value.substr(at + 1));
}

bool read_key(std::string_view word, Variant& variant) {
    const auto equals = word.find('=');
    if (equals == std::string_view::npos) return false;
    const std::string key(word.substr(0, equals));
    std::string value(word.substr(equals + 1));
    if (key == "dispatch") value = dispatch_of(value);
    const auto has_key = [&](const auto& k) { return k.first == key; };
    if (std::find(kKeys.begin(), kKeys.end(), key) == kKeys.end() ||
        std::any_of(variant.keys.begin(), variant.keys.end(), has_key))
        return false;
    // The config's own reader says whether it takes the value.
    const std::string yaml = fmt::format(
        "{{version: 1, chains: [{{name: c, period_ms: 1, deadline_ms: 1, tasks: "
        "[{{name: t}}]}}], scheduler: {{{}: {}}}}}",
        key, value);
    if (!config::parse_config(yaml, "row")) return false;
    variant.keys.emplace_back(key, value);
    return true;
}

/// @returns whether it is a change that was not made before
bool read_change(std::string_view word, Variant& variant) {
    if (word == kLearn) return !std::exchange(variant.learn, true);
    if (word.starts_with(kEvery))
        return set_once(variant.every_us, number(word.substr(kEvery.size()), config::kMarkEveryUs));
    if (word.starts_with(kNice))
        return set_once(variant.nice, integer(word.substr(kNice.size()), config::kNice));
    if (word.starts_with(kNoise)) {
        const auto pct = number(word.substr(kNoise.size()), kNoisePct);
        return pct && std::exchange(variant.noise_pct, *pct) == 0;
    }
    if (word.find('=') != std::string_view::npos) return read_key(word, variant);
    return set_once(variant.source, config::from_word<config::ProgressSource>(word)) ||
           read_tracking(word, variant);
}

std::string accepted() {
    return fmt::format(
        "accepted after each '+': {}, {}, {}, {}US, {}PERCENT (up to {}), {}{} to {}, each thing "
        "once; "
        "batched{}US, overlapped{}US ({} to {}); and KEY=VALUE, as the config takes them: {}",
        config::all_words<config::Tracking>(), config::all_words<config::ProgressSource>(), kLearn,
        kEvery, kNoise, kNoisePct.max, kNice, config::kNice.min, config::kNice.max, kIntervalMark,
        kIntervalMark, config::kEvalIntervalUs.min, config::kEvalIntervalUs.max,
        fmt::join(kKeys, ", "));
}

}  // namespace

bool Variant::waits_for_batches() const {
    return tracking == config::Tracking::kBatched || tracking == config::Tracking::kOverlapped;
}

Result<Variant> parse_variant(std::string_view text) {
    Variant variant;
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find(kVariantMark, begin), text.size());
        if (!read_change(text.substr(begin, end - begin), variant)) return Error{accepted()};
        begin = end + 1;
    }
    return variant;
}

std::string scheduler_keys(const Variant& variant) {
    std::vector<std::string> keys, progress;
    if (variant.tracking) keys.push_back("tracking: " + config::to_word(*variant.tracking));
    if (variant.eval_interval_us)
        keys.push_back(fmt::format("eval_interval_us: {}", *variant.eval_interval_us));
    for (const auto& [key, value] : variant.keys) keys.push_back(key + ": " + value);
    if (variant.source) progress.push_back("source: " + config::to_word(*variant.source));
    if (variant.every_us) progress.push_back(fmt::format("every_us: {}", *variant.every_us));
    if (variant.learn) progress.push_back("learn: on");
    if (!progress.empty())
        keys.push_back(fmt::format("progress: {{{}}}", fmt::join(progress, ", ")));
    return keys.empty() ? "" : fmt::format("{{{}}}", fmt::join(keys, ", "));
}

std::string cpu_keys(const Variant& variant) {
    return variant.nice ? fmt::format("{{nice: {}}}", *variant.nice) : "";
}

}  // namespace urgengo::cli
