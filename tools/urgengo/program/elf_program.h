// SPDX-License-Identifier: Apache-2.0
//
// What a program's ELF file says about how it is loaded and where it looks for the GPU's driver.
// Reads the file and nothing else; a file that is cut short or garbled gives what could be read.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace urgengo::cli {

struct ElfProgram {
    bool is_64_bit = false;
    bool is_little_endian = false;
    std::uint16_t machine = 0;        ///< EM_*; this and the rest only if 64-bit, little endian
    std::string loader;               ///< PT_INTERP; empty: statically linked
    std::vector<std::string> needed;  ///< DT_NEEDED
    std::vector<std::string> rpath;  ///< folders, searched before LD_LIBRARY_PATH; $ORIGIN replaced
    std::vector<std::string>
        runpath;  ///< folders, searched after it; if there are any, rpath is not
    /// Names of libcuda that stand anywhere in the file as text, as the program would hand them to
    /// dlopen. DT_NEEDED's are not among them.
    std::vector<std::string> driver_names;
};

/// @returns nothing if the file is no ELF file, or cannot be read
std::optional<ElfProgram> read_elf_program(const std::string& path);

}  // namespace urgengo::cli
