// SPDX-License-Identifier: Apache-2.0
//
// Writes the control word of a process under UrgenGo (include/urgengo/abi/status_page.h), and waits
// until the process has acted on it. It needs nothing of the process' own threads.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "host/base/result.h"
#include "tools/urgengo/page/page_reader.h"
#include "urgengo/abi/status_page.h"

namespace urgengo::cli {

/// @param stem  of the page, without suffix
inline constexpr std::uint32_t kNoChain = ~0u;

/// @param path   of a resolved config, for kReload
/// @param chain  index of the one that it is about; kNoChain: of none
/// @returns the word that is there now, or what is wrong: mostly no right to write the file. A
///          process that holds its lock delays it by a moment
Result<std::uint32_t> send_command(const std::string& stem, abi::ControlCommand command,
                                   std::uint32_t chain = kNoChain, const std::string& path = {});

enum class Answer {
    kDone,
    kStopped,  ///< the process is stopped: it acts when it goes on
    kGone,     ///< the process has ended meanwhile
    kDeaf,     ///< no thread there waits for words any more
    kLate,     ///< it has not answered in time
};

/// Waits until the process has acted on the word, or on a later one.
Answer wait_for_answer(const std::string& stem, std::uint32_t word,
                       std::chrono::milliseconds longest);

/// @returns what a reload has come to; empty if another one was told since
std::string told(const PageReading& page, std::uint32_t word);
/// @returns why the word was refused; empty if it was not, or a program of an older version does
///          not tell
std::string refusal(const PageReading& page, std::uint32_t word);

}  // namespace urgengo::cli
