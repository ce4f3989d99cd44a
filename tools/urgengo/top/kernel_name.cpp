// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/kernel_name.h"

#include <algorithm>

namespace urgengo::cli {
namespace {

bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

/// Takes "4gemm" from the text's begin. @returns "gemm", or what there is of it; empty: it is none
std::string_view take_identifier(std::string_view& text) {
    std::size_t length = 0, digits = 0;
    for (; digits < text.size() && digits < 4 && is_digit(text[digits]); ++digits)
        length = length * 10 + static_cast<std::size_t>(text[digits] - '0');
    if (digits == 0) return {};
    const std::string_view identifier = text.substr(digits, length);
    text.remove_prefix(std::min(digits + length, text.size()));
    return identifier;
}

}  // namespace

// The grammar: https://itanium-cxx-abi.github.io/cxx-abi/abi.html#mangling. A kernel is
// _Z <identifier> ..., or _ZN <identifier> <identifier> ... in namespaces; templates' arguments,
// from I on, come behind what is shown.
std::string short_kernel_name(std::string_view name) {
    if (name.substr(0, 2) != "_Z") return std::string(name);
    std::string_view rest = name.substr(2);
    const bool is_nested = !rest.empty() && rest[0] == 'N';
    if (is_nested) rest.remove_prefix(1);
    if (rest.substr(0, 2) == "St") rest.remove_prefix(2);
    std::string_view last;
    do {
        const std::string_view identifier = take_identifier(rest);
        if (identifier.empty()) break;
        last = identifier;
    } while (is_nested);
    return std::string(last.empty() ? name : last);
}

}  // namespace urgengo::cli
