// SPDX-License-Identifier: Apache-2.0
#include "interposer/unknown_names.h"

#include <elf.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "interposer/elf_symbols.h"
#include "interposer/generated/entry_points.h"
#include "interposer/own_table.h"
#include "interposer/real_driver.h"
#include "interposer/unknown_captures.h"

namespace urgengo::interposer {
namespace {

constexpr std::size_t kMostBytes = 64;  // of a name, with its end

// Behind the strings of the table in memory, so that their places can be told by an offset.
char g_names[kMostUnknownNames][kMostBytes];

void* driver_function(int index) {
    const char* const name = g_names[index];
    void* const function = *name == '\0' ? nullptr : find_in_driver(name);
    return function ? noting_captures(function, name, 0) : nullptr;
}

}  // namespace

// What the loader calls for a spare symbol that has a name: two digits in their names.
// clang-format off
#define FOR_EACH_SPARE(X) \
    X(00, 0) X(01, 1) X(02, 2) X(03, 3) X(04, 4) X(05, 5) X(06, 6) X(07, 7) \
    X(08, 8) X(09, 9) X(10, 10) X(11, 11) X(12, 12) X(13, 13) X(14, 14) X(15, 15) \
    X(16, 16) X(17, 17) X(18, 18) X(19, 19) X(20, 20) X(21, 21) X(22, 22) X(23, 23) \
    X(24, 24) X(25, 25) X(26, 26) X(27, 27) X(28, 28) X(29, 29) X(30, 30) X(31, 31)
// clang-format on
#define DEFINE(digits, index)                                                     \
    extern "C" __attribute__((visibility("default"))) void* ug_spare_##digits() { \
        return driver_function(index);                                            \
    }
FOR_EACH_SPARE(DEFINE)

namespace {

#define ADDRESS(digits, index) &ug_spare_##digits,
void* (*const kSpares[kMostUnknownNames])() = {FOR_EACH_SPARE(ADDRESS)};
#undef ADDRESS
#undef DEFINE
#undef FOR_EACH_SPARE

constexpr std::string_view kSpare = "ug_spare_";

std::uint32_t gnu_hash(std::string_view name) {
    std::uint32_t hash = 5381;
    for (const char c : name) hash = hash * 33 + static_cast<unsigned char>(c);
    return hash;
}

bool is_known(std::string_view name) {
    const auto* const end = kEntryPoints + kNumEntryPoints;
    const auto* const found = std::lower_bound(
        kEntryPoints, end, name,
        [](const EntryPoint& entry, std::string_view n) { return entry.name < n; });
    return found != end && found->name == name;
}

constexpr ElfW(Half) kSomeSection = 1;  // not none, and not absolute: all that the loader asks

// A symbol that the loader finds by its name, with what belongs to it.
struct Found {
    ElfW(Sym) symbol;
    ElfW(Half) version;
    std::uint32_t hash;
};

std::vector<Found> found_symbols(const OwnTable& table, std::uint32_t first) {
    std::vector<Found> all;
    for (std::size_t i = first; i < table.count; ++i) {
        const ElfW(Sym)& symbol = table.symbols[i];
        all.push_back({symbol, table.versions ? table.versions[i] : ElfW(Half){0},
                       gnu_hash(table.strings + symbol.st_name)});
    }
    return all;
}

/// @returns how many spare symbols have got a name; they were hidden (own_symbols.cpp)
std::size_t name_spares(const OwnTable& table, std::vector<Found>& all, std::size_t num_names) {
    std::size_t named = 0;
    for (Found& one : all) {
        const std::string_view its = table.strings + one.symbol.st_name;
        if (!its.starts_with(kSpare)) continue;
        const auto index = static_cast<std::size_t>(10 * (its[kSpare.size()] - '0') +
                                                    its[kSpare.size() + 1] - '0');
        if (index >= num_names) continue;
        one.symbol.st_shndx = kSomeSection;
        one.symbol.st_value = reinterpret_cast<ElfW(Addr)>(kSpares[index]) - table.base;
        one.symbol.st_name = static_cast<ElfW(Word)>(g_names[index] - table.strings);
        one.symbol.st_info = ELF64_ST_INFO(STB_GLOBAL, STT_GNU_IFUNC);
        one.hash = gnu_hash(g_names[index]);
        ++named;
    }
    return named;
}

void write_table(const OwnTable& table, const GnuHash& hash, const std::vector<Found>& all) {
    for (const Found& one : all) {
        const std::uint64_t bits = (std::uint64_t{1} << (one.hash % 64)) |
                                   (std::uint64_t{1} << ((one.hash >> hash.shift) % 64));
        hash.filter[(one.hash / 64) % hash.num_words] |= bits;
    }
    std::fill(hash.buckets, hash.buckets + hash.num_buckets, 0);
    for (std::size_t i = 0; i < all.size(); ++i) {
        const std::size_t bucket = all[i].hash % hash.num_buckets;
        const bool is_last = i + 1 == all.size() || all[i + 1].hash % hash.num_buckets != bucket;
        table.symbols[hash.first_symbol + i] = all[i].symbol;
        if (table.versions) table.versions[hash.first_symbol + i] = all[i].version;
        hash.chains[i] = (all[i].hash & ~1u) | (is_last ? 1u : 0u);
        if (hash.buckets[bucket] == 0)
            hash.buckets[bucket] = static_cast<std::uint32_t>(hash.first_symbol + i);
    }
}

// Not cudaMalloc, nor what else another driver may export.
bool is_of_driver_api(std::string_view name) {
    return name.starts_with("cu") && name.size() > 2 && name[2] >= 'A' && name[2] <= 'Z';
}

}  // namespace

std::vector<std::string_view> unknown_names(std::string_view driver) {
    std::vector<std::string_view> names;
    for (const DynamicSymbol& symbol : defined_symbols(driver))
        if (is_of_driver_api(symbol.name) && symbol.name.size() < kMostBytes &&
            !is_known(symbol.name))
            names.push_back(symbol.name);
    std::sort(names.begin(), names.end());
    names.resize(std::min<std::size_t>(names.size(), kMostUnknownNames));
    return names;
}

bool show_unknown_names(const std::vector<std::string_view>& names) {
    const auto table = find_own_table();
    if (!table) return false;
    const GnuHash hash(table->hash);
    // Offsets of names count upwards, in 32 bits.
    if (hash.num_words == 0 || hash.num_buckets == 0 || g_names[0] < table->strings ||
        g_names[kMostUnknownNames] - table->strings > std::int64_t{0xffffffff})
        return false;
    for (std::size_t i = 0; i < names.size(); ++i) {
        names[i].copy(g_names[i], kMostBytes - 1);
        g_names[i][names[i].size()] = '\0';
    }
    std::vector<Found> all = found_symbols(*table, hash.first_symbol);
    if (name_spares(*table, all, names.size()) != names.size()) return false;
    std::stable_sort(all.begin(), all.end(), [&](const Found& a, const Found& b) {
        return a.hash % hash.num_buckets < b.hash % hash.num_buckets;
    });
    const auto low = [](const void* a, const void* b) { return a < b ? a : b; };
    const auto high = [](const void* a, const void* b) { return a < b ? b : a; };
    const void* const symbols_end = table->symbols + table->count;
    const void* const chains_end = hash.chains + all.size();
    const void* first = low(table->hash, table->symbols);
    const void* end = high(symbols_end, chains_end);
    if (table->versions) {
        first = low(first, table->versions);
        end = high(end, table->versions + table->count);
    }
    return write_own_table(*table, first, end, [&] { write_table(*table, hash, all); });
}

}  // namespace urgengo::interposer
