// SPDX-License-Identifier: Apache-2.0
//
// What a shared library tells the loader: the names that it exports, its own name, what it needs.
#pragma once

#include <set>
#include <string>

namespace urgengo::testing {

struct ElfFile {
    std::set<std::string> exports;  ///< defined dynamic symbols, without versions
    std::set<std::string> needed;
    std::string soname;
};

/// Reads a 64-bit ELF library of this machine's byte order, by its section headers.
ElfFile read_elf(const std::string& path);

}  // namespace urgengo::testing
