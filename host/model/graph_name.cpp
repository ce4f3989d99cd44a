// SPDX-License-Identifier: Apache-2.0
#include "host/model/graph_name.h"

#include <fmt/format.h>

#include <charconv>

namespace urgengo::model {
namespace {

constexpr std::string_view kBegin = "(graph of ";

}  // namespace

std::string graph_name(std::size_t kernels, std::uint32_t hash) {
    return fmt::format("{}{} kernel{}, {:08x})", kBegin, kernels, kernels == 1 ? "" : "s", hash);
}

std::size_t kernels_of(std::string_view name) {
    if (!name.starts_with(kBegin)) return 1;
    name.remove_prefix(kBegin.size());
    std::size_t kernels = 1;
    const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), kernels);
    const bool is_one = error == std::errc() &&
                        std::string_view(end, name.data() + name.size()).starts_with(" kernel");
    return is_one ? kernels : 1;
}

}  // namespace urgengo::model
