// SPDX-License-Identifier: Apache-2.0
//
// The table is read-only after loading, and is made writable for the few changes. The loader looks
// a name up in this very table, so dlsym, dlvsym and lazy binding all follow. A program that was
// bound eagerly (-z now) has its answers already: for it `urgengo run` preloads a copy of us
// without those names (tools/urgengo/program/pruned_library.h).
#include "interposer/own_symbols.h"

#include <dlfcn.h>
#include <elf.h>
#include <link.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <map>

#include "host/base/log.h"
#include "interposer/driver_file.h"
#include "interposer/generated/entry_points.h"

namespace urgengo::interposer {
namespace {

// Our own dynamic symbol table, as the loader mapped it.
struct SymbolTable {
    ElfW(Sym) * symbols = nullptr;
    std::size_t count = 0;
    const char* strings = nullptr;
    int protection = PROT_READ;  // of its pages
};

// GNU's hash table says how many symbols there are: the last one is the end of the longest chain.
std::size_t count_symbols(const std::uint32_t* hash) {
    const std::uint32_t num_buckets = hash[0], first = hash[1], bloom_words = hash[2];
    const std::uint32_t* const buckets =
        hash + 4 + bloom_words * (sizeof(ElfW(Addr)) / sizeof(std::uint32_t));
    const std::uint32_t* const chains = buckets + num_buckets;
    std::uint32_t last = *std::max_element(buckets, buckets + num_buckets);
    if (last < first) return first;
    while ((chains[last - first] & 1) == 0) ++last;
    return last + 1;
}

// PROT_* of the segment that holds `address`.
int protection_at(ElfW(Addr) address) {
    struct Query {
        ElfW(Addr) address;
        int protection;
    } query{address, -1};
    dl_iterate_phdr(
        [](dl_phdr_info* info, std::size_t, void* data) {
            auto* q = static_cast<Query*>(data);
            for (int i = 0; i < info->dlpi_phnum; ++i) {
                const ElfW(Phdr)& segment = info->dlpi_phdr[i];
                if (segment.p_type != PT_LOAD ||
                    q->address - (info->dlpi_addr + segment.p_vaddr) >= segment.p_memsz)
                    continue;
                q->protection = ((segment.p_flags & PF_R) ? PROT_READ : 0) |
                                ((segment.p_flags & PF_W) ? PROT_WRITE : 0) |
                                ((segment.p_flags & PF_X) ? PROT_EXEC : 0);
                return 1;
            }
            return 0;
        },
        &query);
    return query.protection;
}

bool find_own_table(SymbolTable& table, ElfW(Addr) & base) {
    Dl_info info;
    link_map* self = nullptr;
    if (!dladdr1(reinterpret_cast<void*>(&urgengo_entry_points), &info,
                 reinterpret_cast<void**>(&self), RTLD_DL_LINKMAP) ||
        !self)
        return false;
    base = self->l_addr;
    const std::uint32_t* hash = nullptr;
    for (const ElfW(Dyn)* d = self->l_ld; d->d_tag != DT_NULL; ++d) {
        // The loader has made these absolute, unless the table is read-only.
        const ElfW(Addr) at = d->d_un.d_ptr < base ? d->d_un.d_ptr + base : d->d_un.d_ptr;
        if (d->d_tag == DT_SYMTAB) table.symbols = reinterpret_cast<ElfW(Sym)*>(at);
        if (d->d_tag == DT_STRTAB) table.strings = reinterpret_cast<const char*>(at);
        if (d->d_tag == DT_GNU_HASH) hash = reinterpret_cast<const std::uint32_t*>(at);
    }
    if (!table.symbols || !table.strings || !hash) return false;
    table.count = count_symbols(hash);
    table.protection = protection_at(reinterpret_cast<ElfW(Addr)>(table.symbols));
    return table.protection >= 0;
}

struct Change {
    ElfW(Sym) * symbol;
    void* function;  // null: hide it
};

// What has to change, given where the driver has each of our names.
std::vector<Change> changes(const SymbolTable& table, const std::vector<std::string_view>& names,
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

bool apply(const SymbolTable& table, ElfW(Addr) base, const std::vector<Change>& all) {
    if (all.empty()) return true;
    const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
    const auto first = reinterpret_cast<std::uintptr_t>(all.front().symbol) & ~(page - 1);
    const auto end = reinterpret_cast<std::uintptr_t>(all.back().symbol + 1);
    const std::size_t size = (end - first + page - 1) & ~(page - 1);
    void* const start = reinterpret_cast<void*>(first);
    // Never without PROT_EXEC if it was there: another thread may run code on the same page.
    if (mprotect(start, size, table.protection | PROT_WRITE) != 0) return false;
    for (const Change& change : all) {
        if (change.function) {
            change.symbol->st_value = reinterpret_cast<ElfW(Addr)>(change.function) - base;
        } else {
            change.symbol->st_shndx = SHN_UNDEF;
            change.symbol->st_value = 0;
        }
    }
    mprotect(start, size, table.protection);
    return true;
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
    SymbolTable table;
    ElfW(Addr) base = 0;
    return find_own_table(table, base) && apply(table, base, changes(table, names, places));
}

}  // namespace

void match_exports_to_driver(std::string_view driver) {
    if (!try_to_match(driver))
        log_line(
            "names that the driver lacks could not be hidden: calling them fails, where "
            "without UrgenGo they would not be found");
}

}  // namespace urgengo::interposer
