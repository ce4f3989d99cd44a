// SPDX-License-Identifier: Apache-2.0
#include "interposer/own_table.h"

#include <dlfcn.h>
#include <elf.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>

#include "interposer/generated/entry_points.h"

namespace urgengo::interposer {
namespace {

// The hash table says how many symbols there are: the last one is the end of the longest chain.
std::size_t count_symbols(std::uint32_t* table) {
    const GnuHash hash(table);
    std::uint32_t last = *std::max_element(hash.buckets, hash.buckets + hash.num_buckets);
    if (last < hash.first_symbol) return hash.first_symbol;
    while ((hash.chains[last - hash.first_symbol] & 1) == 0) ++last;
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

}  // namespace

std::optional<OwnTable> find_own_table() {
    Dl_info info;
    link_map* self = nullptr;
    if (!dladdr1(reinterpret_cast<void*>(&urgengo_entry_points), &info,
                 reinterpret_cast<void**>(&self), RTLD_DL_LINKMAP) ||
        !self)
        return std::nullopt;
    OwnTable table;
    table.base = self->l_addr;
    for (const ElfW(Dyn)* d = self->l_ld; d->d_tag != DT_NULL; ++d) {
        // The loader has made these absolute, unless the table is read-only.
        const ElfW(Addr) at =
            d->d_un.d_ptr < table.base ? d->d_un.d_ptr + table.base : d->d_un.d_ptr;
        if (d->d_tag == DT_SYMTAB) table.symbols = reinterpret_cast<ElfW(Sym)*>(at);
        if (d->d_tag == DT_STRTAB) table.strings = reinterpret_cast<const char*>(at);
        if (d->d_tag == DT_VERSYM) table.versions = reinterpret_cast<ElfW(Half)*>(at);
        if (d->d_tag == DT_GNU_HASH) table.hash = reinterpret_cast<std::uint32_t*>(at);
    }
    if (!table.symbols || !table.strings || !table.hash) return std::nullopt;
    table.count = count_symbols(table.hash);
    table.protection = protection_at(reinterpret_cast<ElfW(Addr)>(table.symbols));
    if (table.protection < 0) return std::nullopt;
    return table;
}

bool write_own_table(const OwnTable& table, const void* first, const void* end,
                     void (*write)(void*), void* argument) {
    const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
    const std::uintptr_t begin = reinterpret_cast<std::uintptr_t>(first) & ~(page - 1);
    const std::size_t size =
        (reinterpret_cast<std::uintptr_t>(end) - begin + page - 1) & ~(page - 1);
    void* const start = reinterpret_cast<void*>(begin);
    // Never without PROT_EXEC if it was there: another thread may run code on the same page.
    if (mprotect(start, size, table.protection | PROT_WRITE) != 0) return false;
    write(argument);
    mprotect(start, size, table.protection);
    return true;
}

}  // namespace urgengo::interposer
