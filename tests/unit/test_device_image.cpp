// SPDX-License-Identifier: Apache-2.0
//
// The device code that is embedded in the library runs on every GPU that the toolkit knows, and on
// later ones. The layout of a fat binary is that of what nvcc of CUDA 13.0 writes, as a hex dump
// shows it (see tools/simgpu/image/image.cpp); cuobjdump, which could read it, is not in every
// toolkit.
#include "device/device_image.h"

#include <cstdint>
#include <cstring>
#include <set>
#include <sstream>
#include <string>

#include "tests/support/catch.h"

namespace urgengo::device {
namespace {

constexpr std::uint32_t kMagic = 0xba55ed50;
constexpr std::size_t kHeaderBytes = 16;       // its last eight bytes: of the entries
constexpr std::size_t kEntryHeaderBytes = 32;  // at least
enum : std::uint16_t { kPtx = 1, kMachineCode = 2 };

struct Architectures {
    std::set<unsigned> machine_code;
    std::set<unsigned> ptx;
};

template <typename T>
T read(const unsigned char* at) {
    T value;
    std::memcpy(&value, at, sizeof value);
    return value;
}

Architectures embedded() {
    const auto* const image = static_cast<const unsigned char*>(marks_image());
    const std::size_t bytes = marks_image_bytes();
    REQUIRE(bytes > kHeaderBytes);
    REQUIRE(read<std::uint32_t>(image) == kMagic);
    REQUIRE(read<std::uint64_t>(image + 8) == bytes - kHeaderBytes);
    Architectures found;
    for (std::size_t at = kHeaderBytes; at < bytes;) {
        REQUIRE(bytes - at > kEntryHeaderBytes);
        const auto kind = read<std::uint16_t>(image + at);
        const auto header_bytes = read<std::uint32_t>(image + at + 4);
        const auto payload_bytes = read<std::uint64_t>(image + at + 8);
        const auto architecture = read<std::uint32_t>(image + at + 28);
        REQUIRE(header_bytes >= kEntryHeaderBytes);
        REQUIRE(payload_bytes <= bytes - at - header_bytes);
        if (kind == kMachineCode) found.machine_code.insert(architecture);
        if (kind == kPtx) found.ptx.insert(architecture);
        at += header_bytes + payload_bytes;
    }
    return found;
}

TEST_CASE("Device image has code for every architecture of the toolkit and PTX of the oldest",
          "[unit][device]") {
    // As `nvcc --list-gpu-code` said when this was configured: "75 80 86".
    std::set<unsigned> listed;
    std::istringstream list(GPU_ARCHITECTURES);
    for (unsigned architecture; list >> architecture;) listed.insert(architecture);
    REQUIRE_FALSE(listed.empty());
    const Architectures found = embedded();
    CHECK(found.machine_code == listed);
    CHECK(found.ptx == std::set<unsigned>{*listed.begin()});
}

}  // namespace
}  // namespace urgengo::device
