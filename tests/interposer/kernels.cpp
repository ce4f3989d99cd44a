// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/kernels.h"

#include <cstdlib>

namespace twin {
namespace {

const char* const kCosts = R"({"kernels": [
    {"name": "tiny", "block_ns": 10000},
    {"name": "wide", "block_ns": 300000, "blocks_per_sm": 1},
    {"name": "long", "block_ns": 5000000, "blocks_per_sm": 1},
    {"name": "very_long", "block_ns": 50000000, "blocks_per_sm": 1}],
    "default": {"block_ns": 5000}})";

// A thread reads the GPU's clock until its time is over.
#define SPIN_KERNEL(name, nanoseconds)   \
    ".visible .entry " name              \
    "()\n"                               \
    "{\n"                                \
    "  .reg .pred %p;\n"                 \
    "  .reg .u64 %now, %end;\n"          \
    "  mov.u64 %end, %globaltimer;\n"    \
    "  add.u64 %end, %end, " nanoseconds \
    ";\n"                                \
    "again:\n"                           \
    "  mov.u64 %now, %globaltimer;\n"    \
    "  setp.lt.u64 %p, %now, %end;\n"    \
    "  @%p bra again;\n"                 \
    "  ret;\n"                           \
    "}\n"

const char* const kPtx =
    ".version 6.3\n"
    ".target sm_75\n"
    ".address_size 64\n"
    ".visible .entry urgengo_mark(.param .u64 to, .param .u64 value, .param .u64 tag)\n"
    "{\n"
    "  .reg .u64 %to, %value, %tag, %time;\n"
    "  ld.param.u64 %to, [to];\n"
    "  ld.param.u64 %value, [value];\n"
    "  ld.param.u64 %tag, [tag];\n"
    "  mov.u64 %time, %globaltimer;\n"
    "  shl.b64 %time, %time, 16;\n"
    "  and.b64 %tag, %tag, 65535;\n"
    "  or.b64 %tag, %tag, %time;\n"
    "  st.volatile.u64 [%to], %value;\n"
    "  membar.sys;\n"
    "  st.volatile.u64 [%to+8], %tag;\n"
    "  ret;\n"
    "}\n"
    ".visible .entry simgpu_mix(.param .u64 word, .param .u64 value)\n"
    "{\n"
    "  .reg .u64 %word, %value, %mixed;\n"
    "  ld.param.u64 %word, [word];\n"
    "  ld.param.u64 %value, [value];\n"
    "  ld.volatile.u64 %mixed, [%word];\n"
    "  mad.lo.u64 %mixed, %mixed, 31, %value;\n"
    "  st.volatile.u64 [%word], %mixed;\n"
    "  ret;\n"
    "}\n"
    // clang-format off
    SPIN_KERNEL("tiny", "10000")
    SPIN_KERNEL("wide", "300000")
    SPIN_KERNEL("long", "5000000")
    SPIN_KERNEL("very_long", "50000000");
// clang-format on

}  // namespace

bool simulated() {
    const char* const path = std::getenv("TWIN_SIMGPU");
    return path && *path;
}

const char* const kImage = simulated() ? kCosts : kPtx;

// The simulated GPU runs UrgenGo's mark kernel for real; to a program it is a kernel like others.
const char* const kStoreName = "urgengo_mark";

}  // namespace twin
