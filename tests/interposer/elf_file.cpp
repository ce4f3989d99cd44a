// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/elf_file.h"

#include <elf.h>

#include <cstring>
#include <vector>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

namespace urgengo::testing {
namespace {

template <typename T>
std::vector<T> read_array(const std::string& bytes, std::size_t offset, std::size_t size_bytes) {
    REQUIRE(offset + size_bytes <= bytes.size());
    std::vector<T> array(size_bytes / sizeof(T));
    std::memcpy(array.data(), bytes.data() + offset, array.size() * sizeof(T));
    return array;
}

}  // namespace

ElfFile read_elf(const std::string& path) {
    const std::string bytes = read_text(path);
    INFO(path);
    const auto header = read_array<Elf64_Ehdr>(bytes, 0, sizeof(Elf64_Ehdr)).at(0);
    REQUIRE(std::memcmp(header.e_ident, ELFMAG, SELFMAG) == 0);
    const auto sections =
        read_array<Elf64_Shdr>(bytes, header.e_shoff, header.e_shnum * sizeof(Elf64_Shdr));
    const auto text_at = [&](const Elf64_Shdr& section, std::size_t offset) {
        return std::string(bytes.c_str() + sections.at(section.sh_link).sh_offset + offset);
    };

    ElfFile file;
    for (const Elf64_Shdr& section : sections) {
        if (section.sh_type == SHT_DYNSYM)
            for (const auto& s : read_array<Elf64_Sym>(bytes, section.sh_offset, section.sh_size))
                if (s.st_shndx != SHN_UNDEF) file.exports.insert(text_at(section, s.st_name));
        if (section.sh_type == SHT_DYNAMIC)
            for (const auto& d : read_array<Elf64_Dyn>(bytes, section.sh_offset, section.sh_size)) {
                if (d.d_tag == DT_NEEDED) file.needed.insert(text_at(section, d.d_un.d_val));
                if (d.d_tag == DT_SONAME) file.soname = text_at(section, d.d_un.d_val);
            }
    }
    return file;
}

}  // namespace urgengo::testing
