// SPDX-License-Identifier: Apache-2.0
#include "interposer/ld_cache.h"

#include <cstdint>
#include <cstring>
#include <optional>

namespace urgengo::interposer {
namespace {

// glibc's cache-file format: a header, then the entries, then the strings. An old-format cache may
// precede it; the header is then found by its magic.
constexpr std::string_view kMagic = "glibc-ld.so.cache1.1";
constexpr std::size_t kHeaderBytes = 48;
constexpr std::size_t kNumEntriesOffset = 20;

struct Entry {
    std::int32_t flags;
    std::uint32_t key;    // offset of the soname, from the header
    std::uint32_t value;  // offset of the path
    std::uint32_t os_version;
    std::uint64_t hwcap;
};
static_assert(sizeof(Entry) == 24);

#if defined(__x86_64__)
constexpr std::int32_t kFlags = 0x0303;  // an ELF library for libc6, x86-64
#elif defined(__aarch64__)
constexpr std::int32_t kFlags = 0x0a03;  // an ELF library for libc6, AArch64
#else
#error "the loader's cache flags of this architecture are not known"
#endif

template <typename T>
std::optional<T> read(std::string_view bytes, std::size_t offset) {
    if (offset > bytes.size() || bytes.size() - offset < sizeof(T)) return {};
    T value;
    std::memcpy(&value, bytes.data() + offset, sizeof value);
    return value;
}

std::string_view string_at(std::string_view bytes, std::size_t offset) {
    if (offset >= bytes.size()) return {};
    const std::size_t end = bytes.find('\0', offset);
    return end == std::string_view::npos ? std::string_view{} : bytes.substr(offset, end - offset);
}

}  // namespace

std::vector<std::string> find_in_ld_cache(std::string_view cache, std::string_view soname) {
    std::vector<std::string> paths;
    const std::size_t header = cache.find(kMagic);
    if (header == std::string_view::npos) return paths;
    cache.remove_prefix(header);
    const auto count = read<std::uint32_t>(cache, kNumEntriesOffset);
    if (!count) return paths;
    for (std::uint32_t i = 0; i < *count; ++i) {
        const auto entry = read<Entry>(cache, kHeaderBytes + i * sizeof(Entry));
        if (!entry) break;
        if (entry->flags != kFlags || string_at(cache, entry->key) != soname) continue;
        const std::string_view path = string_at(cache, entry->value);
        if (!path.empty()) paths.emplace_back(path);
    }
    return paths;
}

}  // namespace urgengo::interposer
