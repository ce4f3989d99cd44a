// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/row_variant.h"

#include <fmt/format.h>

#include <charconv>
#include <string_view>
#include <vector>

#include "host/config/limits.h"
#include "host/config/names.h"

namespace urgengo::cli {
namespace {

constexpr std::string_view kEvery = "every=";

std::vector<std::string_view> split(std::string_view text) {
    std::vector<std::string_view> parts;
    for (std::size_t mark; (mark = text.find(kVariantMark)) != text.npos;) {
        parts.push_back(text.substr(0, mark));
        text.remove_prefix(mark + 1);
    }
    parts.push_back(text);
    return parts;
}

std::optional<std::int64_t> every_us(std::string_view part) {
    if (!part.starts_with(kEvery)) return std::nullopt;
    part.remove_prefix(kEvery.size());
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), value);
    if (error != std::errc{} || end != part.data() + part.size()) return std::nullopt;
    if (value < config::kMarkEveryUs.min || value > config::kMarkEveryUs.max) return std::nullopt;
    return value;
}

std::string accepted() {
    return fmt::format(
        "accepted after the '+': {}, {}, every={}..{}, or a source and every, as in event+every={}",
        config::all_words<config::Tracking>(), config::all_words<config::ProgressSource>(),
        config::kMarkEveryUs.min, config::kMarkEveryUs.max, config::kMarkEveryUs.min);
}

}  // namespace

bool is_tracking(const std::string& variant) {
    return config::from_word<config::Tracking>(variant).has_value();
}

Result<std::string> variant_keys(const std::string& variant,
                                 std::optional<unsigned> eval_interval_us) {
    if (is_tracking(variant)) {
        if (!eval_interval_us) return "{tracking: " + variant + "}";
        return fmt::format("{{tracking: {}, eval_interval_us: {}}}", variant, *eval_interval_us);
    }
    std::string source, every;
    for (const std::string_view part : split(variant)) {
        if (const auto us = every_us(part); us && every.empty())
            every = fmt::format("every_us: {}", *us);
        else if (config::from_word<config::ProgressSource>(part) && source.empty() && every.empty())
            source = fmt::format("source: {}", part);
        else
            return Error{accepted()};
    }
    const char* comma = source.empty() || every.empty() ? "" : ", ";
    return fmt::format("{{progress: {{{}{}{}}}}}", source, comma, every);
}

}  // namespace urgengo::cli
