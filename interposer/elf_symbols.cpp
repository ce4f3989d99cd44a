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

// A driver takes 100 MiB: what says that it takes more than this is damaged.
constexpr std::uint64_t kMostMapped = std::uint64_t{4} << 30;

std::optional<Elf64_Ehdr> library_header(std::string_view bytes) {
    const auto header = read_elf<Elf64_Ehdr>(bytes, 0);
    if (!header || std::memcmp(header->e_ident, ELFMAG, SELFMAG) != 0 ||
        header->e_ident[EI_CLASS] != ELFCLASS64 || header->e_machine != kMachine)
        return {};
    return header;
}

}  // namespace

std::vector<DynamicSymbol> defined_symbols(std::string_view bytes) {
    std::vector<DynamicSymbol> symbols;
    const auto header = library_header(bytes);
    if (!header) return symbols;
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

std::size_t mapped_size(std::string_view bytes) {
    const auto header = library_header(bytes);
    if (!header || header->e_phentsize != sizeof(Elf64_Phdr)) return 0;
    std::uint64_t first = 0, end = 0;
    for (unsigned i = 0; i < header->e_phnum; ++i) {
        const auto segment = read_elf<Elf64_Phdr>(bytes, header->e_phoff + i * sizeof(Elf64_Phdr));
        if (!segment) return 0;
        if (segment->p_type != PT_LOAD) continue;
        const std::uint64_t segment_end = segment->p_vaddr + segment->p_memsz;
        // In a file the loader can map they are in order, and hardly larger than the file.
        if (segment->p_vaddr < end || segment_end < segment->p_vaddr ||
            segment->p_filesz > bytes.size())
            return 0;
        if (end == 0) first = segment->p_vaddr;
        end = segment_end;
    }
    constexpr std::uint64_t kPage = 4096;
    const std::uint64_t size = (end - first / kPage * kPage + kPage - 1) / kPage * kPage;
    return size > kMostMapped ? 0 : size;
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
