// SPDX-License-Identifier: Apache-2.0
//
// Cubins and fat binaries. The layouts are those of what nvcc of CUDA 13.0 writes, as readelf and a
// hex dump show it.
#include "tools/simgpu/image/image.h"

#include <elf.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string_view>

#include "tools/simgpu/image/ptx_text.h"

namespace urgengo::simgpu {
namespace {

using Bytes = std::span<const std::byte>;

constexpr std::uint16_t kElfMachineCuda = 190;

// The wrapper that nvcc puts around a fat binary in a host program.
constexpr std::uint32_t kWrapperMagic = 0x466243b1;
constexpr std::size_t kWrapperData = 8;
// A fat binary: magic, version (2 bytes), size of this header (2), bytes that follow (8); then
// entries, each with its own header.
constexpr std::uint32_t kFatbinMagic = 0xba55ed50;
constexpr std::size_t kFatbinHeaderBytes = 16;
constexpr std::size_t kEntryHeaderSize = 4;
constexpr std::size_t kEntryPayloadSize = 8;
constexpr std::size_t kEntryFlags = 40;
constexpr std::size_t kLeastEntryHeaderBytes = 48;
constexpr std::uint64_t kCompressedFlags = 0x2000 | 0x8000;  // LZ4, Zstandard
enum EntryKind : std::uint16_t { kPtx = 1, kElf = 2 };

// The records of a .nv.info section: format, attribute, then a value of one or two bytes in place,
// or a size (2 bytes) and so many bytes.
constexpr std::uint8_t kSizedValue = 4;
constexpr std::uint8_t kMaxThreads = 0x05;     // x, y, z
constexpr std::uint8_t kParamInfo = 0x17;      // index (4), number (2), offset (2), packed (4)
constexpr std::uint8_t kRegisterCount = 0x2f;  // symbol (4), registers (4); of .nv.info itself
constexpr std::size_t kParamInfoBytes = 12;
constexpr std::size_t kMaxThreadsBytes = 12;
constexpr unsigned kParamSizeShift = 18;  // of the packed word: what is above is the size

template <typename T>
std::optional<T> read(Bytes bytes, std::size_t at) {
    if (at > bytes.size() || bytes.size() - at < sizeof(T)) return std::nullopt;
    T value;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
}

std::optional<Bytes> part_of(Bytes bytes, std::uint64_t begin, std::uint64_t size) {
    if (begin > bytes.size() || size > bytes.size() - begin) return std::nullopt;
    return bytes.subspan(begin, size);
}

/// Calls `visit(attribute, value)` for each record that has a sized value.
template <typename Visitor>
void for_each_record(Bytes info, Visitor visit) {
    for (std::size_t at = 0; at + 4 <= info.size();) {
        const auto format = std::to_integer<std::uint8_t>(info[at]);
        const auto attribute = std::to_integer<std::uint8_t>(info[at + 1]);
        const std::size_t size = format == kSizedValue ? *read<std::uint16_t>(info, at + 2) : 0;
        const auto value = part_of(info, at + 4, size);
        if (!value) return;
        if (format == kSizedValue) visit(attribute, *value);
        at += 4 + size;
    }
}

void read_info(Bytes info, KernelImage& kernel) {
    for_each_record(info, [&kernel](std::uint8_t attribute, Bytes value) {
        if (attribute == kParamInfo && value.size() >= kParamInfoBytes) {
            const std::size_t number = *read<std::uint16_t>(value, 4);
            if (kernel.param_bytes.size() <= number) {
                kernel.param_bytes.resize(number + 1);
                kernel.param_offsets.resize(number + 1);
            }
            kernel.param_offsets[number] = *read<std::uint16_t>(value, 6);
            kernel.param_bytes[number] = *read<std::uint32_t>(value, 8) >> kParamSizeShift;
        } else if (attribute == kMaxThreads && value.size() >= kMaxThreadsBytes) {
            kernel.max_threads =
                static_cast<int>(*read<std::uint32_t>(value, 0) * *read<std::uint32_t>(value, 4) *
                                 *read<std::uint32_t>(value, 8));
        }
    });
}

/// @returns what follows the prefix in a section's name; empty if it does not begin so
std::string_view after(std::string_view name, std::string_view prefix) {
    return name.starts_with(prefix) ? name.substr(prefix.size()) : std::string_view{};
}

/// The sections of an ELF file, by name.
class Sections {
  public:
    explicit Sections(Bytes elf) : elf_(elf) {
        const auto header = read<Elf64_Ehdr>(elf, 0);
        if (!header) return;
        for (std::size_t i = 0; i < header->e_shnum; ++i) {
            const auto its = read<Elf64_Shdr>(elf, header->e_shoff + i * sizeof(Elf64_Shdr));
            if (!its) return;
            headers_.push_back(*its);
        }
        if (header->e_shstrndx < headers_.size()) names_ = contents(header->e_shstrndx);
    }

    std::size_t count() const { return headers_.size(); }
    const Elf64_Shdr& header(std::size_t i) const { return headers_[i]; }
    std::string_view name(std::size_t i) const { return text(names_, headers_[i].sh_name); }

    /// @returns nothing for a section that has no bytes, or lies outside the file
    Bytes contents(std::size_t i) const {
        if (i >= headers_.size() || headers_[i].sh_type == SHT_NOBITS) return {};
        return part_of(elf_, headers_[i].sh_offset, headers_[i].sh_size).value_or(Bytes{});
    }

    static std::string_view text(Bytes strings, std::size_t at) {
        if (at >= strings.size()) return {};
        const auto* const begin = reinterpret_cast<const char*>(strings.data()) + at;
        return {begin, strnlen(begin, strings.size() - at)};
    }

  private:
    Bytes elf_;
    Bytes names_;
    std::vector<Elf64_Shdr> headers_;
};

/// Reads the register counts, which are kept by symbol.
void read_registers(const Sections& sections, Bytes info,
                    std::map<std::string, KernelImage>& kernels) {
    for (std::size_t i = 0; i < sections.count(); ++i) {
        if (sections.header(i).sh_type != SHT_SYMTAB) continue;
        const Bytes symbols = sections.contents(i);
        const Bytes names = sections.contents(sections.header(i).sh_link);
        for_each_record(info, [&](std::uint8_t attribute, Bytes value) {
            const auto index = read<std::uint32_t>(value, 0);
            const auto num_regs = read<std::uint32_t>(value, 4);
            if (attribute != kRegisterCount || !num_regs) return;
            const auto symbol = read<Elf64_Sym>(symbols, *index * sizeof(Elf64_Sym));
            if (!symbol) return;
            const auto found = kernels.find(std::string(Sections::text(names, symbol->st_name)));
            if (found != kernels.end()) found->second.num_regs = static_cast<int>(*num_regs);
        });
    }
}

void read_elf(Bytes elf, std::map<std::string, KernelImage>& kernels) {
    const Sections sections(elf);
    // Kernels first: the others add to them.
    for (std::size_t i = 0; i < sections.count(); ++i) {
        const auto kernel = after(sections.name(i), ".nv.info.");
        if (!kernel.empty()) read_info(sections.contents(i), kernels[std::string(kernel)]);
    }
    for (std::size_t i = 0; i < sections.count(); ++i) {
        if (sections.name(i) == ".nv.info") {
            read_registers(sections, sections.contents(i), kernels);
        }
        const auto found = kernels.find(std::string(after(sections.name(i), ".nv.shared.")));
        if (found != kernels.end()) found->second.shared_bytes = sections.header(i).sh_size;
    }
}

}  // namespace

/// Fills an Image.
class ImageReader {
  public:
    explicit ImageReader(Image& image) : image_(image) {}

    void read_any(const std::byte* data) {
        std::uint32_t magic = 0;
        // One byte after the other: a text may be shorter than any header.
        for (std::size_t i = 0; i < sizeof magic; ++i) {
            if (data[i] == std::byte{0}) return;
            magic |= std::to_integer<std::uint32_t>(data[i]) << (8 * i);
        }
        if (magic == kWrapperMagic) {
            const std::byte* fatbin = nullptr;
            std::memcpy(&fatbin, data + kWrapperData, sizeof fatbin);
            if (fatbin != nullptr) read_any(fatbin);
        } else if (magic == kFatbinMagic) {
            const std::uint64_t bytes = *read<std::uint64_t>({data, kFatbinHeaderBytes}, 8);
            read_fatbin({data + kFatbinHeaderBytes, bytes});
        } else if (std::memcmp(data, ELFMAG, SELFMAG) == 0) {
            if (std::to_integer<unsigned char>(data[EI_CLASS]) != ELFCLASS64) return;
            const auto header = *read<Elf64_Ehdr>({data, sizeof(Elf64_Ehdr)}, 0);
            if (header.e_machine != kElfMachineCuda) return;
            const std::uint64_t end =
                std::max(header.e_shoff + std::uint64_t{header.e_shnum} * header.e_shentsize,
                         header.e_phoff + std::uint64_t{header.e_phnum} * header.e_phentsize);
            read_elf({data, end}, image_.kernels_);
            image_.understood_ = true;
        } else {
            read_text(reinterpret_cast<const char*>(data));
        }
    }

  private:
    void read_fatbin(Bytes entries) {
        image_.understood_ = true;
        for (std::size_t at = 0; at + kLeastEntryHeaderBytes <= entries.size();) {
            const auto kind = *read<std::uint16_t>(entries, at);
            const auto header_bytes = *read<std::uint32_t>(entries, at + kEntryHeaderSize);
            const auto bytes = *read<std::uint64_t>(entries, at + kEntryPayloadSize);
            const auto flags = *read<std::uint64_t>(entries, at + kEntryFlags);
            const auto payload = part_of(entries, at + header_bytes, bytes);
            if (!payload || header_bytes == 0) return;
            if ((flags & kCompressedFlags) != 0) {
                image_.compressed_ = true;
            } else if (kind == kElf) {
                read_elf(*payload, image_.kernels_);
            } else if (kind == kPtx) {
                const auto* const text = reinterpret_cast<const char*>(payload->data());
                read_text({text, strnlen(text, payload->size())});
            }
            at += header_bytes + bytes;
        }
    }

    void read_text(std::string_view text) {
        if (!is_ptx(text)) return;
        image_.understood_ = true;
        // Machine code knows better, where there is some.
        image_.kernels_.merge(read_ptx_entries(text));
    }

    Image& image_;
};

Image Image::parse(const void* data) {
    Image image;
    ImageReader(image).read_any(static_cast<const std::byte*>(data));
    return image;
}

const KernelImage* Image::find(const std::string& kernel) const {
    const auto it = kernels_.find(kernel);
    return it == kernels_.end() ? nullptr : &it->second;
}

}  // namespace urgengo::simgpu
