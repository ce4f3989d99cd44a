// SPDX-License-Identifier: Apache-2.0
//
// Our own dynamic symbol table, as the loader has mapped it: what it finds in us is what stands
// here. It is read-only, and made writable for the few changes (own_symbols.h, unknown_names.h).
#pragma once

#include <link.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

namespace urgengo::interposer {

struct OwnTable {
    ElfW(Addr) base = 0;  ///< of the library: symbols' values count from it
    ElfW(Sym) * symbols = nullptr;
    std::size_t count = 0;
    const char* strings = nullptr;
    ElfW(Half) * versions = nullptr;  ///< of each symbol; null: there are none
    std::uint32_t* hash = nullptr;    ///< GNU's hash table
    int protection = 0;               ///< of its pages
};

/// GNU's hash table: a header, a filter, and for each bucket the first symbol of a chain.
struct GnuHash {
    explicit GnuHash(std::uint32_t* table)
        : num_buckets(table[0]),
          first_symbol(table[1]),
          num_words(table[2]),
          shift(table[3]),
          filter(reinterpret_cast<std::uint64_t*>(table + 4)),
          buckets(table + 4 + num_words * (sizeof(std::uint64_t) / sizeof(std::uint32_t))),
          chains(buckets + num_buckets) {}
    std::uint32_t num_buckets, first_symbol, num_words, shift;
    std::uint64_t* filter;
    std::uint32_t* buckets;
    std::uint32_t* chains;  ///< hashes of symbols from first_symbol on; odd: the last of its chain
};

/// @returns nothing if it is not as we know such tables
std::optional<OwnTable> find_own_table();

/// Calls write() while the bytes from `first` to `end`, which lie in the table's pages, are
/// writable. @returns false if they cannot be: nothing was called
bool write_own_table(const OwnTable& table, const void* first, const void* end,
                     void (*write)(void*), void* argument);

template <typename Write>
bool write_own_table(const OwnTable& table, const void* first, const void* end, Write&& write) {
    return write_own_table(
        table, first, end,
        [](void* its) { (*static_cast<std::remove_reference_t<Write>*>(its))(); }, &write);
}

}  // namespace urgengo::interposer
