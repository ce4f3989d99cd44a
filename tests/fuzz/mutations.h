// SPDX-License-Identifier: Apache-2.0
//
// Changes that bring a reader into trouble: bytes and numbers that are extreme, parts that are
// missing, doubled or of another file.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <random>
#include <vector>

namespace urgengo::fuzz {

using Bytes = std::vector<std::byte>;

class Mutations {
  public:
    explicit Mutations(std::uint32_t seed) : random_(seed) {}

    /// @param seeds  not empty
    Bytes next(const std::vector<Bytes>& seeds) {
        Bytes bytes = seeds[below(seeds.size())];
        for (std::size_t changes = 1 + below(8); changes > 0; --changes)
            change(bytes, seeds[below(seeds.size())]);
        return bytes;
    }

  private:
    std::size_t below(std::size_t end) { return end == 0 ? 0 : random_() % end; }

    /// @returns a place in the bytes; half of them near the begin, where heads are
    std::size_t place(const Bytes& bytes) {
        return below(random_() % 2 == 0 ? std::min<std::size_t>(bytes.size(), 512) : bytes.size());
    }

    void change(Bytes& bytes, const Bytes& other) {
        if (bytes.empty()) bytes = other;
        if (bytes.empty()) return;
        const std::size_t at = place(bytes);
        const std::size_t length = std::min(1 + below(64), bytes.size() - at);
        const auto from = bytes.begin() + static_cast<std::ptrdiff_t>(at);
        switch (random_() % 8) {
            case 0:
                bytes[at] = static_cast<std::byte>(random_());
                return;
            case 1:
                bytes[at] ^= std::byte{1} << below(8);
                return;
            case 2:
                return put_number(bytes, at);
            case 3:
                bytes.erase(from, from + static_cast<std::ptrdiff_t>(length));
                return;
            case 4: {
                const Bytes copy(from, from + static_cast<std::ptrdiff_t>(length));
                bytes.insert(from, copy.begin(), copy.end());
                return;
            }
            case 5:
                bytes.resize(at);
                return;
            case 6: {  // the other's end
                const std::size_t cut = std::min(at, other.size());
                bytes.resize(at);
                bytes.insert(bytes.end(), other.begin() + static_cast<std::ptrdiff_t>(cut),
                             other.end());
                return;
            }
            default:
                return put_word(bytes, at);
        }
    }

    void put_number(Bytes& bytes, std::size_t at) {
        constexpr std::uint64_t kNumbers[] = {0,
                                              1,
                                              0x7f,
                                              0xff,
                                              0x7fff,
                                              0xffff,
                                              0x7fffffff,
                                              0x80000000,
                                              0xffffffff,
                                              0x7fffffffffffffff,
                                              0x8000000000000000,
                                              0xffffffffffffffff};
        const std::uint64_t number = kNumbers[below(std::size(kNumbers))];
        const std::size_t size = std::size_t{1} << below(4);
        std::memcpy(bytes.data() + at, &number, std::min(size, bytes.size() - at));
    }

    void put_word(Bytes& bytes, std::size_t at) {
        constexpr const char* kWords[] = {"-1",   "1e999", "18446744073709551616",
                                          "null", "[",     "{",
                                          "]",    "}",     "\"",
                                          "*a",   "&a ",   "\n ",
                                          "nan",  ".inf",  "0.1",
                                          "true"};
        const char* const word = kWords[below(std::size(kWords))];
        const auto* const begin = reinterpret_cast<const std::byte*>(word);
        bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), begin,
                     begin + std::strlen(word));
    }

    std::mt19937 random_;
};

}  // namespace urgengo::fuzz
