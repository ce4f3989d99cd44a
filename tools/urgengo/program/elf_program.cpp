// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program/elf_program.h"

#include <elf.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <string_view>

#include "interposer/elf_bytes.h"

namespace urgengo::cli {
namespace {

using interposer::elf_text_at;
using interposer::read_elf;

namespace fs = std::filesystem;

/// A file's bytes, mapped: programs may be gigabytes.
class MappedFile {
  public:
    explicit MappedFile(const std::string& path) {
        const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
        if (fd < 0) return;
        struct stat info {};
        if (fstat(fd, &info) == 0 && S_ISREG(info.st_mode) && info.st_size > 0) {
            size_ = static_cast<std::size_t>(info.st_size);
            address_ = mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, fd, 0);
        }
        close(fd);
    }
    MappedFile(const MappedFile&) = delete;
    MappedFile& operator=(const MappedFile&) = delete;
    ~MappedFile() {
        if (address_ != MAP_FAILED) munmap(address_, size_);
    }

    std::string_view bytes() const {
        if (address_ == MAP_FAILED) return {};
        return {static_cast<const char*>(address_), size_};
    }

  private:
    void* address_ = MAP_FAILED;
    std::size_t size_ = 0;
};

std::vector<Elf64_Phdr> segments_of(std::string_view bytes, const Elf64_Ehdr& header) {
    std::vector<Elf64_Phdr> segments;
    for (unsigned i = 0; i < header.e_phnum; ++i) {
        const auto segment =
            read_elf<Elf64_Phdr>(bytes, header.e_phoff + std::uint64_t{i} * header.e_phentsize);
        if (!segment) break;
        segments.push_back(*segment);
    }
    return segments;
}

/// Where in the file a virtual address lies.
std::optional<std::uint64_t> file_offset(const std::vector<Elf64_Phdr>& segments,
                                         std::uint64_t address) {
    for (const Elf64_Phdr& segment : segments) {
        if (segment.p_type == PT_LOAD && address >= segment.p_vaddr &&
            address - segment.p_vaddr < segment.p_filesz) {
            return segment.p_offset + (address - segment.p_vaddr);
        }
    }
    return {};
}

std::vector<std::string> folders(std::string list, const std::string& origin) {
    for (const std::string name : {"$ORIGIN", "${ORIGIN}"}) {
        for (std::size_t at = 0; (at = list.find(name, at)) != std::string::npos;) {
            list.replace(at, name.size(), origin);
            at += origin.size();
        }
    }
    std::vector<std::string> found;
    std::size_t start = 0;
    while (start <= list.size()) {
        const std::size_t end = std::min(list.find(':', start), list.size());
        if (end > start) found.push_back(list.substr(start, end - start));
        start = end + 1;
    }
    return found;
}

void read_dynamic(std::string_view bytes, const std::vector<Elf64_Phdr>& segments,
                  const std::string& origin, ElfProgram& program) {
    const auto dynamic = std::find_if(segments.begin(), segments.end(),
                                      [](const Elf64_Phdr& s) { return s.p_type == PT_DYNAMIC; });
    if (dynamic == segments.end()) return;
    std::vector<Elf64_Dyn> entries;
    std::optional<std::uint64_t> strings;
    for (std::uint64_t at = 0; at + sizeof(Elf64_Dyn) <= dynamic->p_filesz;
         at += sizeof(Elf64_Dyn)) {
        const auto entry = read_elf<Elf64_Dyn>(bytes, dynamic->p_offset + at);
        if (!entry || entry->d_tag == DT_NULL) break;
        if (entry->d_tag == DT_STRTAB) strings = file_offset(segments, entry->d_un.d_ptr);
        entries.push_back(*entry);
    }
    if (!strings) return;
    for (const Elf64_Dyn& entry : entries) {
        const std::string text(elf_text_at(bytes, *strings + entry.d_un.d_val));
        if (entry.d_tag == DT_NEEDED) program.needed.push_back(text);
        if (entry.d_tag == DT_RPATH) program.rpath = folders(text, origin);
        if (entry.d_tag == DT_RUNPATH) program.runpath = folders(text, origin);
    }
}

/// Every text in the file whose last part is libcuda.so, with or without a version.
std::vector<std::string> find_driver_names(std::string_view bytes,
                                           const std::vector<std::string>& needed) {
    constexpr std::string_view kLibrary = "libcuda.so";
    std::vector<std::string> names;
    for (std::size_t at = 0; (at = bytes.find(kLibrary, at)) != std::string_view::npos;
         at += kLibrary.size()) {
        const std::size_t before = bytes.find_last_of(std::string_view("\0", 1), at);
        const std::size_t start = before == std::string_view::npos ? 0 : before + 1;
        const std::string text(elf_text_at(bytes, start));
        const std::string_view version =
            std::string_view(text).substr(std::min(text.size(), at - start + kLibrary.size()));
        const bool is_name = (start == at || bytes[at - 1] == '/') &&
                             version.find_first_not_of(".0123456789") == std::string_view::npos;
        const auto is_known = [&](const std::vector<std::string>& list) {
            return std::find(list.begin(), list.end(), text) != list.end();
        };
        if (is_name && !text.empty() && !is_known(names) && !is_known(needed)) {
            names.push_back(text);
        }
    }
    return names;
}

}  // namespace

std::optional<ElfProgram> read_elf_program(const std::string& path) {
    const MappedFile file(path);
    const std::string_view bytes = file.bytes();
    if (bytes.size() < EI_NIDENT || !bytes.starts_with(ELFMAG)) return {};
    ElfProgram program;
    program.is_64_bit = bytes[EI_CLASS] == ELFCLASS64;
    program.is_little_endian = bytes[EI_DATA] == ELFDATA2LSB;
    const auto header = read_elf<Elf64_Ehdr>(bytes, 0);
    if (!header || !program.is_64_bit || !program.is_little_endian) return program;
    program.machine = header->e_machine;
    const std::vector<Elf64_Phdr> segments = segments_of(bytes, *header);
    for (const Elf64_Phdr& segment : segments) {
        if (segment.p_type == PT_INTERP) program.loader = elf_text_at(bytes, segment.p_offset);
    }
    std::error_code ignored;
    const fs::path real = fs::canonical(path, ignored);
    read_dynamic(bytes, segments, real.parent_path().string(), program);
    program.driver_names = find_driver_names(bytes, program.needed);
    return program;
}

}  // namespace urgengo::cli
