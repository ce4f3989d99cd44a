// SPDX-License-Identifier: Apache-2.0
#include "interposer/elf_symbols.h"

#include "interposer/elf_bytes.h"

#include <elf.h>

#include <algorithm>
#include <cstring>
#include <optional>

namespace urgengo::interposer {
namespace {

#if defined(__x86_64__)
constexpr Elf64_Half kMachine = EM_X86_64;
#elif defined(__aarch64__)
constexpr Elf64_Half kMachine = EM_AARCH64;
#else
#error "the ELF machine number of this architecture is not known"
#endif

}  // namespace

std::vector<DynamicSymbol> defined_symbols(std::string_view bytes) {
    std::vector<DynamicSymbol> symbols;
    const auto header = read_elf<Elf64_Ehdr>(bytes, 0);
    if (!header || std::memcmp(header->e_ident, ELFMAG, SELFMAG) != 0 ||
        header->e_ident[EI_CLASS] != ELFCLASS64 || header->e_machine != kMachine)
        return symbols;
    const auto section_at = [&](std::uint64_t index) {
        return read_elf<Elf64_Shdr>(bytes, header->e_shoff + index * sizeof(Elf64_Shdr));
    };
    for (unsigned i = 0; i < header->e_shnum; ++i) {
        const auto section = section_at(i);
        if (!section || section->sh_type != SHT_DYNSYM) continue;
        const auto strings = section_at(section->sh_link);
        if (!strings) break;
        for (std::uint64_t at = 0; at + sizeof(Elf64_Sym) <= section->sh_size;
             at += sizeof(Elf64_Sym)) {
            const auto symbol = read_elf<Elf64_Sym>(bytes, section->sh_offset + at);
            if (!symbol) break;
            if (symbol->st_shndx == SHN_UNDEF || symbol->st_value == 0) continue;
            const std::string_view name = elf_text_at(bytes, strings->sh_offset + symbol->st_name);
            if (!name.empty()) symbols.push_back({name, symbol->st_value, section->sh_offset + at});
        }
    }
    return symbols;
}

void undefine(std::string& bytes, const std::vector<std::string>& names) {
    for (const DynamicSymbol& s : defined_symbols(bytes)) {
        if (!std::binary_search(names.begin(), names.end(), s.name)) continue;
        Elf64_Sym symbol;
        std::memcpy(&symbol, bytes.data() + s.offset, sizeof symbol);
        symbol.st_value = 0;
        symbol.st_shndx = SHN_UNDEF;
        std::memcpy(bytes.data() + s.offset, &symbol, sizeof symbol);
    }
}

}  // namespace urgengo::interposer
