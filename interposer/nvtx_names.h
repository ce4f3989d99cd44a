// SPDX-License-Identifier: Apache-2.0
//
// Texts that the program has NVTX keep, by the handles that it got for them: our own, where no
// other tool is behind us, else that tool's.
#pragma once

// Types only: the implementation is for programs.
#ifndef NVTX_NO_IMPL
#define NVTX_NO_IMPL
#endif
#include <nvtx3/nvToolsExt.h>

#include <string_view>

#include "host/observe/nvtx_ranges.h"

namespace urgengo::interposer {

/// Text as we keep it: UTF-8, cut.
class Utf8 {
  public:
    static constexpr std::size_t kMaxBytes = observe::RangeStack::kMaxNameBytes;

    explicit Utf8(const char* text);
    explicit Utf8(const wchar_t* text);
    Utf8(const Utf8&) = delete;
    Utf8& operator=(const Utf8&) = delete;
    std::string_view view() const { return view_; }

  private:
    char buffer_[kMaxBytes];
    std::string_view view_;
};

/// More than any program has that names its strings once. What comes later has no name here, which
/// is said once.
inline constexpr std::size_t kMaxNames = 65536;

/// To be called before there is a handle: a child would wait for ever for a thread that was making
/// what keeps them. @returns whether the names are unlocked in every child from here on
bool prepare_names();

// Ours: the address of a text, which stays for good. Any thread; leaves errno as it is.
nvtxStringHandle_t own_string(std::string_view text);
nvtxDomainHandle_t own_domain(std::string_view name);
/// @returns the text of a handle of ours
std::string_view text_of(nvtxStringHandle_t own);

// Another tool's, which is a number that means nothing to us, and may be another domain's as well.
// Any thread; looking up takes no lock.
void note_string(nvtxDomainHandle_t domain, nvtxStringHandle_t handle, std::string_view text);
/// @returns the text that the tool has given the handle for; empty if it is not known
std::string_view noted_text(nvtxDomainHandle_t domain, nvtxStringHandle_t handle);

}  // namespace urgengo::interposer
