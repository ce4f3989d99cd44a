// SPDX-License-Identifier: Apache-2.0
//
// The names that a library file shows to the loader, and how to take some of them back.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace urgengo::interposer {

struct DynamicSymbol {
    std::string_view name;    ///< inside the bytes that it was read from
    std::uint64_t value = 0;  ///< two names with one value are one function
    std::size_t offset = 0;   ///< of its Elf64_Sym, from the first byte
};

/// @param bytes  of a 64-bit ELF library for this machine
/// @returns what its .dynsym defines; empty if it is no such file, or is damaged
std::vector<DynamicSymbol> defined_symbols(std::string_view bytes);

/// @param bytes  of a 64-bit ELF library for this machine
/// @returns how many bytes of address space the loader maps it to; 0 if it is no such file, or is
///          damaged
std::size_t mapped_size(std::string_view bytes);

/// Makes names of a library undefined: the loader then looks further, as if the library lacked
/// them.
/// @param names  sorted
void undefine(std::string& bytes, const std::vector<std::string>& names);

}  // namespace urgengo::interposer
