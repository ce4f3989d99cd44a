// SPDX-License-Identifier: Apache-2.0
//
// NVTX ranges: the stack of a thread, and what NVTX itself delivers to it. This program has NVTX
// (the header) and, in place of a library to load, our tool linked in.
#include <cstdint>
extern "C" int (*InitializeInjectionNvtx2_fnptr)(const void* (*tables)(std::uint32_t));
#define NVTX_STATIC_INJECTION_IMPL
#include <nvtx3/nvToolsExt.h>

#include <cerrno>
#include <string>
#include <thread>

#include "host/base/hash.h"
#include "host/observe/nvtx_ranges.h"
#include "interposer/nvtx_tool.h"
#include "tests/support/catch.h"

extern "C" {
int attach(NvtxGetExportTableFunc_t tables) {
    return urgengo::interposer::attach_to_nvtx(tables) ? 1 : 0;
}
NvtxInitializeInjectionNvtxFunc_t InitializeInjectionNvtx2_fnptr = attach;
}

using urgengo::observe::RangeStack;
using urgengo::observe::this_thread_ranges;

namespace {

/// The names of a stack, the innermost first, each followed by a space.
std::string names(const RangeStack& stack) {
    std::string all;
    stack.innermost([&](std::string_view name, std::uint64_t hash) {
        CHECK(hash == urgengo::fnv1a64(name));
        all.append(name).append(" ");
        return false;
    });
    return all;
}

std::string names() {
    return this_thread_ranges() ? names(*this_thread_ranges()) : "no stack";
}

nvtxEventAttributes_t event(nvtxMessageType_t type) {
    nvtxEventAttributes_t attributes{};
    attributes.version = NVTX_VERSION;
    attributes.size = NVTX_EVENT_ATTRIB_STRUCT_SIZE;
    attributes.messageType = type;
    return attributes;
}

}  // namespace

TEST_CASE("Range stack finds the innermost match when ranges are nested", "[unit][nvtx]") {
    RangeStack stack;
    const std::uint32_t at_start = stack.epoch();
    CHECK(at_start != 0);
    stack.push("frame 7");
    stack.push("detect");
    stack.push("conv");
    const auto starts_with = [&](char letter) {
        return stack.innermost([=](std::string_view name, auto) { return name[0] == letter; });
    };
    CHECK(names(stack) == "conv detect frame 7 ");
    CHECK(starts_with('f') == "frame 7");
    CHECK(starts_with('x').empty());
    const std::uint32_t deep = stack.epoch();
    stack.pop();
    CHECK(stack.epoch() != deep);
    CHECK(names(stack) == "detect frame 7 ");
    stack.pop();
    stack.pop();
    const std::uint32_t at_end = stack.epoch();
    stack.pop();  // one too many
    CHECK(stack.epoch() == at_end);
    CHECK(names(stack).empty());
}

TEST_CASE("Range stack stays balanced when ranges are deeper than it keeps", "[unit][nvtx]") {
    RangeStack stack;
    for (int i = 0; i < RangeStack::kMaxDepth + 3; ++i) stack.push(std::to_string(i));
    CHECK(names(stack).substr(0, 6) == "15 14 ");
    for (int i = 0; i < 4; ++i) stack.pop();
    CHECK(names(stack).substr(0, 6) == "14 13 ");
}

TEST_CASE("Range stack cuts a name when it is too long", "[unit][nvtx]") {
    RangeStack stack;
    stack.push(std::string(1000, 'a'));
    CHECK(names(stack).size() == RangeStack::kMaxNameBytes + 1);
}

TEST_CASE("NVTX delivers names when strings are of any kind", "[unit][nvtx]") {
    errno = 77;
    CHECK(nvtxRangePushA("ascii") == NVTX_NO_PUSH_POP_TRACKING);
    CHECK(nvtxRangePushW(L"wide \u00e4\u20ac\U0001f600") == NVTX_NO_PUSH_POP_TRACKING);
    CHECK(errno == 77);
    CHECK(names() == "wide \u00e4\u20ac\U0001f600 ascii ");
    CHECK(nvtxRangePop() == NVTX_NO_PUSH_POP_TRACKING);
    nvtxRangePop();
    CHECK(names().empty());

    auto with = event(NVTX_MESSAGE_TYPE_ASCII);
    with.message.ascii = "ex";
    nvtxRangePushEx(&with);
    with = event(NVTX_MESSAGE_TYPE_UNICODE);
    with.message.unicode = L"ex wide";
    nvtxRangePushEx(&with);
    with = event(NVTX_MESSAGE_UNKNOWN);
    nvtxRangePushEx(&with);
    nvtxRangePushEx(nullptr);
    CHECK(names() == "  ex wide ex ");
    for (int i = 0; i < 4; ++i) nvtxRangePop();
    CHECK(names().empty());
}

TEST_CASE("NVTX delivers names when strings are registered", "[unit][nvtx]") {
    nvtxDomainHandle_t domain = nvtxDomainCreateA("a domain");
    REQUIRE(domain != nullptr);
    CHECK(nvtxDomainCreateW(L"a domain") == domain);
    const nvtxStringHandle_t a = nvtxDomainRegisterStringA(domain, "registered");
    const nvtxStringHandle_t w = nvtxDomainRegisterStringW(domain, L"also");
    REQUIRE((a != nullptr && w != nullptr && a != w));
    auto with = event(NVTX_MESSAGE_TYPE_REGISTERED);
    for (nvtxStringHandle_t handle : {a, w, nvtxStringHandle_t(nullptr)}) {
        with.message.registered = handle;
        CHECK(nvtxDomainRangePushEx(domain, &with) == NVTX_NO_PUSH_POP_TRACKING);
    }
    CHECK(names() == " also registered ");
    for (int i = 0; i < 3; ++i) CHECK(nvtxDomainRangePop(domain) == NVTX_NO_PUSH_POP_TRACKING);
    CHECK(names().empty());
    nvtxDomainDestroy(domain);
}

TEST_CASE("NVTX ends the range of the right domain when domains are mixed", "[unit][nvtx]") {
    nvtxDomainHandle_t one = nvtxDomainCreateA("one"), two = nvtxDomainCreateA("two");
    REQUIRE(one != two);
    auto with = event(NVTX_MESSAGE_TYPE_ASCII);
    with.message.ascii = "in one";
    nvtxDomainRangePushEx(one, &with);
    nvtxRangePushA("in none");
    with.message.ascii = "in two";
    nvtxDomainRangePushEx(two, &with);
    nvtxDomainRangePop(one);
    CHECK(names() == "in two in none ");
    nvtxRangePop();
    CHECK(names() == "in two ");
    nvtxDomainRangePop(one);
    CHECK(names() == "in two ");
    nvtxDomainRangePop(two);
}

TEST_CASE("NVTX ranges are of their thread when several threads push", "[unit][nvtx]") {
    nvtxRangePushA("mine");
    std::string before, inside;
    std::thread([&] {
        nvtxRangePop();  // ends nobody's range
        before = names();
        nvtxRangePushA("other");
        inside = names();
    }).join();
    CHECK(before == "no stack");
    CHECK(inside == "other ");
    CHECK(names() == "mine ");
    nvtxRangePop();
}

TEST_CASE("NVTX says that there is nothing when ranges start and end anywhere", "[unit][nvtx]") {
    const std::string before = names();
    CHECK(nvtxRangeStartA("process range") == 0);
    nvtxRangeEnd(0);
    nvtxMarkA("mark");
    CHECK(names() == before);
}

TEST_CASE("Tool does not attach when NVTX has no table for it", "[unit][nvtx]") {
    CHECK_FALSE(urgengo::interposer::attach_to_nvtx(nullptr));
    CHECK_FALSE(
        urgengo::interposer::attach_to_nvtx([](std::uint32_t) -> const void* { return nullptr; }));
}
