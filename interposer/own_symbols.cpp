// SPDX-License-Identifier: Apache-2.0
//
// The table is read-only after loading, and is made writable for the few changes. The loader looks
// a name up in this very table, so dlsym, dlvsym and lazy binding all follow. A program that was
// bound eagerly (-z now) has its answers already: for it `urgengo run` preloads a copy of us
// without those names (tools/urgengo/program/pruned_library.h).
#include "interposer/own_symbols.h"

#include <elf.h>
#include <link.h>

#include <algorithm>
#include <cstring>
#include <map>

#include "host/base/log.h"
#include "host/base/settings.h"
#include "interposer/driver_file.h"
#include "interposer/generated/entry_points.h"
#include "interposer/own_table.h"
#include "interposer/unknown_names.h"

namespace urgengo::interposer {
namespace {

struct Change {
    ElfW(Sym) * symbol;
    void* function;  // null: hide it
};

// What has to change, given where the driver has each of our names.
std::vector<Change> changes(const OwnTable& table, const std::vector<std::string_view>& names,
                            const std::vector<std::uint64_t>& places) {
    std::map<std::uint64_t, int> standing_for;  // a place in the driver, by index
    for (int i = 0; i < kNumEntryPoints; ++i) {
        if (places[i] == 0) continue;
        const auto [one, is_new] = standing_for.emplace(places[i], i);
        if (!is_new && kEntryPoints[i].overridden && !kEntryPoints[one->second].overridden)
            one->second = i;
    }
    std::vector<Change> all;
    for (std::size_t i = 0; i < table.count; ++i) {
        ElfW(Sym)* const symbol = table.symbols + i;
        if (symbol->st_shndx == SHN_UNDEF) continue;
        const std::string_view name = table.strings + symbol->st_name;
        if (name.starts_with("ug_spare_")) all.push_back({symbol, nullptr});
        const auto found = std::lower_bound(names.begin(), names.end(), name);
        if (found == names.end() || *found != name) continue;
        const int index = static_cast<int>(found - names.begin());
        if (places[index] == 0) {
            all.push_back({symbol, nullptr});
        } else if (const int other = standing_for[places[index]]; other != index) {
            all.push_back({symbol, kEntryPoints[other].function});
        }
    }
    return all;
}

bool make(const OwnTable& table, const std::vector<Change>& all) {
    if (all.empty()) return true;
    return write_own_table(table, all.front().symbol, all.back().symbol + 1, [&] {
        for (const Change& change : all) {
            if (change.function) {
                change.symbol->st_value =
                    reinterpret_cast<ElfW(Addr)>(change.function) - table.base;
            } else {
                change.symbol->st_shndx = SHN_UNDEF;
                change.symbol->st_value = 0;
            }
        }
    });
}

// @returns whether our table is as it should be
bool try_to_match(std::string_view driver) {
    const std::vector<std::string_view> names = [] {
        std::vector<std::string_view> all;
        for (const EntryPoint& e : kEntryPoints) all.emplace_back(e.name);
        return all;
    }();
    const std::vector<std::uint64_t> places = places_in(driver, names);
    // Not a driver: loading it will say so, if a call ever needs it.
    if (places.empty()) return true;
    const auto table = find_own_table();
    if (!table || !make(*table, changes(*table, names, places))) return false;
    // Last: it gives symbols other places. Only on request: it has been tried with drivers of the
    // tests alone.
    if (!read_settings().new_names) return true;
    const std::vector<std::string_view> unknown = unknown_names(driver);
    if (!unknown.empty() && !show_unknown_names(unknown))
        log_line("names of the driver that UrgenGo does not know are not found through it");
    return true;
}

}  // namespace

void match_exports_to_driver(std::string_view driver) {
    if (!try_to_match(driver))
        log_line(
            "names that the driver lacks could not be hidden: calling them fails, where "
            "without UrgenGo they would not be found");
}

}  // namespace urgengo::interposer
