// SPDX-License-Identifier: Apache-2.0
//
// The text of SIMGPU_FAIL.
#include "tools/simgpu/api/injected_errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
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

bool breaks_context(int code) {
    // cuda.h: "This leaves the process in an inconsistent state and any further CUDA work will
    // return the same error." No CUDA header here: illegal address, launch timeout, assert,
    // hardware stack error, illegal instruction, misaligned address, invalid address space, invalid
    // PC, launch failed, tensor memory leak; and an uncorrectable ECC error.
    constexpr std::array kCodes = {700, 702, 710, 714, 715, 716, 717, 718, 719, 721, 214};
    return std::find(kCodes.begin(), kCodes.end(), code) != kCodes.end();
}

Result<std::vector<InjectedError>> parse_injected_errors(std::string_view text) {
    std::vector<InjectedError> errors;
    while (!text.empty()) {
        const std::string_view item = take(text, ',');
        std::string_view rest = item;
        InjectedError error{.name = std::string(take(rest, ':'))};
        if (error.name == "kernel" || error.name == "fault") {
            error.on =
                error.name == "kernel" ? InjectedError::On::kLaunch : InjectedError::On::kKernelEnd;
            error.name = take(rest, ':');
        }
        const std::string_view call = take(rest, ':');
        const bool valid =
            !error.name.empty() && read_whole(call, error.call) && error.call > 0 &&
            read_whole(rest, error.code) && error.code >= 0 &&
            (error.on != InjectedError::On::kKernelEnd || breaks_context(error.code));
        if (!valid) {
            return Error{fmt::format(
                "SIMGPU_FAIL: found '{}', accepted: <exported function>:<number of the call, from "
                "1>:<CUresult as a number>; in the function's place kernel:<name>, or, with a "
                "result that makes the context unusable, fault:<name>",
                item)};
        }
        errors.push_back(std::move(error));
    }
    return errors;
}

}  // namespace urgengo::simgpu
