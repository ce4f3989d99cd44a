// SPDX-License-Identifier: Apache-2.0
//
// Scanning PTX: words, and the few marks that matter.
#include "tools/simgpu/image/ptx_text.h"

#include <algorithm>
#include <cctype>
#include <charconv>

namespace urgengo::simgpu {
namespace {

/// Hands out words and single marks, without comments.
class Scanner {
  public:
    explicit Scanner(std::string_view text) : text_(text) {}

    /// @returns the next token; empty at the end
    std::string_view next() {
        skip();
        if (at_ >= text_.size()) return {};
        const std::size_t begin = at_;
        if (text_[at_] == '"') {
            at_ = std::min(text_.find('"', at_ + 1), text_.size() - 1) + 1;
        } else if (is_word(text_[at_])) {
            while (at_ < text_.size() && is_word(text_[at_])) ++at_;
        } else {
            ++at_;
        }
        return text_.substr(begin, at_ - begin);
    }

  private:
    static bool is_word(char c) {
        return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '$' ||
               c == '.' || c == '%';
    }

    void skip() {
        while (at_ < text_.size()) {
            if (text_.compare(at_, 2, "//") == 0) {
                at_ = std::min(text_.find('\n', at_), text_.size());
            } else if (text_.compare(at_, 2, "/*") == 0) {
                at_ = std::min(text_.find("*/", at_ + 2), text_.size() - 2) + 2;
            } else if (std::isspace(static_cast<unsigned char>(text_[at_])) != 0) {
                ++at_;
            } else {
                return;
            }
        }
    }

    std::string_view text_;
    std::size_t at_ = 0;
};

std::size_t to_number(std::string_view word) {
    std::size_t number = 0;
    std::from_chars(word.data(), word.data() + word.size(), number);
    return number;
}

/// @returns the bytes of a scalar type such as .u64; 0 if the word is none
std::size_t bytes_of(std::string_view word) {
    constexpr std::string_view kKinds = "usbf";
    if (word.size() < 3 || word[0] != '.' || kKinds.find(word[1]) == std::string_view::npos) {
        return 0;
    }
    const std::size_t bits = to_number(word.substr(2));
    return bits % 8 == 0 ? bits / 8 : 0;
}

/// Reads what stands between the parentheses of an entry.
void read_params(Scanner& scanner, KernelImage& kernel) {
    std::size_t end = 0;
    std::size_t bytes = 0;
    std::size_t alignment = 0;
    bool is_pointer = false;  // then .align is that of what it points to
    const auto add = [&] {
        if (bytes == 0) return;
        const std::size_t step = alignment == 0 ? bytes : alignment;
        end = (end + step - 1) / step * step;
        kernel.param_offsets.push_back(end);
        kernel.param_bytes.push_back(bytes);
        end += bytes;
        bytes = alignment = 0;
        is_pointer = false;
    };
    for (auto word = scanner.next(); !word.empty() && word != ")"; word = scanner.next()) {
        if (word == ",") {
            add();
        } else if (word == ".ptr") {
            is_pointer = true;
        } else if (word == ".align") {
            const std::size_t number = to_number(scanner.next());
            if (!is_pointer) alignment = number;
        } else if (word == "[") {
            const std::size_t scalar = bytes;
            if (alignment == 0) alignment = scalar;
            bytes = scalar * to_number(scanner.next());
        } else if (const std::size_t scalar = bytes_of(word); scalar != 0) {
            bytes = scalar;
        }
    }
    add();
}

}  // namespace

bool is_ptx(std::string_view text) {
    return Scanner(text).next() == ".version";
}

std::map<std::string, KernelImage> read_ptx_entries(std::string_view text) {
    std::map<std::string, KernelImage> kernels;
    Scanner scanner(text);
    for (auto word = scanner.next(); !word.empty(); word = scanner.next()) {
        if (word != ".entry") continue;
        KernelImage& kernel = kernels[std::string(scanner.next())];
        kernel = {};
        // Up to the body: parameters, then directives.
        for (word = scanner.next(); !word.empty() && word != "{" && word != ";";
             word = scanner.next()) {
            if (word == "(") {
                read_params(scanner, kernel);
            } else if (word == ".maxntid") {
                std::size_t product = to_number(scanner.next());
                for (int i = 0; i < 2; ++i) {
                    if (scanner.next() != ",") break;
                    product *= to_number(scanner.next());
                }
                kernel.max_threads = static_cast<int>(product);
            }
        }
    }
    return kernels;
}

}  // namespace urgengo::simgpu
