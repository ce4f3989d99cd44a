// SPDX-License-Identifier: Apache-2.0
#include "interposer/ld_cache.h"

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>

#include "tests/support/catch.h"

using urgengo::interposer::find_in_ld_cache;

namespace {

struct Library {
    std::string soname, path;
    std::int32_t flags;
};

// Writes a cache as ldconfig does (glibc-ld.so.cache1.1).
std::string make_cache(const std::vector<Library>& libraries) {
    std::string strings, entries;
    const auto offset = 48 + 24 * libraries.size();
    const auto append = [](std::string& out, auto value) {
        out.append(reinterpret_cast<const char*>(&value), sizeof value);
    };
    for (const Library& l : libraries) {
        append(entries, l.flags);
        append(entries, static_cast<std::uint32_t>(offset + strings.size()));
        strings += l.soname + '\0';
        append(entries, static_cast<std::uint32_t>(offset + strings.size()));
        strings += l.path + '\0';
        append(entries, std::uint32_t{0});
        append(entries, std::uint64_t{0});
    }
    std::string cache = "glibc-ld.so.cache1.1";
    append(cache, static_cast<std::uint32_t>(libraries.size()));
    append(cache, static_cast<std::uint32_t>(strings.size()));
    cache.resize(48);
    return cache + entries + strings;
}

#if defined(__x86_64__)
constexpr std::int32_t kNative = 0x0303, kForeign = 0x0803;
#else
constexpr std::int32_t kNative = 0x0a03, kForeign = 0x0303;
#endif

}  // namespace

TEST_CASE("The loader's cache gives this architecture's paths in order", "[interposer][ld_cache]") {
    const std::string cache = make_cache({{"libcuda.so.1", "/lib32/libcuda.so.1", kForeign},
                                          {"libcuda.so.1", "/a/libcuda.so.1", kNative},
                                          {"libcudart.so.1", "/a/libcudart.so.1", kNative},
                                          {"libcuda.so.1", "/b/libcuda.so.1", kNative}});
    CHECK(find_in_ld_cache(cache, "libcuda.so.1") ==
          std::vector<std::string>{"/a/libcuda.so.1", "/b/libcuda.so.1"});
    CHECK(find_in_ld_cache(cache, "libcuda.so").empty());
    // An old-format cache may stand before the new one; offsets count from the new header.
    CHECK(find_in_ld_cache("ld.so-1.7.0" + std::string(53, '\0') + cache, "libcuda.so.1").size() ==
          2);
}

TEST_CASE("The loader's cache gives nothing when it is damaged", "[interposer][ld_cache]") {
    const std::string cache = make_cache({{"libcuda.so.1", "/a/libcuda.so.1", kNative}});
    for (std::size_t length = 0; length < cache.size(); ++length)
        CHECK(find_in_ld_cache(cache.substr(0, length), "libcuda.so.1").empty());
    std::string wild = cache;
    std::memset(wild.data() + 52, 0xff, 8);  // string offsets far outside
    CHECK(find_in_ld_cache(wild, "libcuda.so.1").empty());
    CHECK(find_in_ld_cache("not a cache", "libcuda.so.1").empty());
}

TEST_CASE("The machine's own cache lists the C library", "[interposer][ld_cache]") {
    std::ifstream file("/etc/ld.so.cache", std::ios::binary);
    if (!file) return;
    const std::string cache{std::istreambuf_iterator<char>(file), {}};
    CHECK_FALSE(find_in_ld_cache(cache, "libc.so.6").empty());
}
