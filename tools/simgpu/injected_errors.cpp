// SPDX-License-Identifier: Apache-2.0
//
// The text of SIMGPU_FAIL.
#include "tools/simgpu/injected_errors.h"

#include <fmt/format.h>

#include <charconv>

namespace urgengo::simgpu {
namespace {

template <typename T>
bool read_whole(std::string_view text, T& number) {
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, number);
    return error == std::errc{} && stop == end;
}

/// Takes what stands before the separator off the text.
std::string_view take(std::string_view& text, char separator) {
    const std::size_t end = text.find(separator);
    const std::string_view taken = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    return taken;
}

}  // namespace

Result<std::vector<InjectedError>> parse_injected_errors(std::string_view text) {
    std::vector<InjectedError> errors;
    while (!text.empty()) {
        const std::string_view item = take(text, ',');
        std::string_view rest = item;
        InjectedError error{std::string(take(rest, ':')), 0, 0};
        const std::string_view call = take(rest, ':');
        const bool valid = !error.function.empty() && read_whole(call, error.call) &&
                           error.call > 0 && read_whole(rest, error.code) && error.code >= 0;
        if (!valid) {
            return Error{fmt::format(
                "SIMGPU_FAIL: found '{}', accepted: <exported function>:<number of the call, from "
                "1>:<CUresult as a number>",
                item)};
        }
        errors.push_back(std::move(error));
    }
    return errors;
}

}  // namespace urgengo::simgpu
