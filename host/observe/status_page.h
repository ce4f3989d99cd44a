// SPDX-License-Identifier: Apache-2.0
//
// The memory that other programs may read of this process (abi/status_page.h), and the word by
// which they steer it. Where the folder cannot be used, or is not asked for, the same memory is
// private to the process, and everything but the readers works.
//
// All of the file's memory is there before anything is written to it: a full folder is found out
// when the page is made, not by a SIGBUS in the program. It is shared with forked children, which
// never write it: pages that the GPU writes to must not be copied.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "host/config/config.h"
#include "host/observe/kernel_list.h"
#include "host/observe/page_folder.h"
#include "host/observe/shared_file.h"
#include "urgengo/abi/status_page.h"

namespace urgengo::observe {

struct ShareOptions {
    std::string folder;  ///< in memory (tmpfs); empty: private
    std::string group;   ///< that may read the page and steer, besides the owner; empty: none
};

abi::StatusMode to_status(config::Mode mode);

class StatusPage {
  public:
    /// @param now  when UrgenGo starts
    /// @param profile  whose kernels it names; null: none
    StatusPage(const ShareOptions& share, const config::Config& config,
               std::chrono::nanoseconds now, const config::Profile* profile = nullptr);
    ~StatusPage();
    StatusPage(const StatusPage&) = delete;
    StatusPage& operator=(const StatusPage&) = delete;

    abi::StatusHeader& header() { return *header_; }
    abi::SharedPage& akb() { return *akb_; }
    abi::ChainStatus& chain(std::size_t index) { return chains_[index]; }
    abi::TaskStatus& task(std::size_t index) { return tasks_[index]; }

    /// What UrgenGo does from now on. @threads any
    void set_mode(config::Mode mode);
    /// It has switched itself off, for good.
    void tripped();

    bool is_shared() const { return !stem_.empty(); }
    /// Why it is private, though it was to be shared; else empty.
    const std::string& note() const { return note_; }
    const std::string& stem() const { return stem_; }

    // --- the control word
    /// @returns what it is now. The file may have been cut short, or removed, by a user who may
    ///          write it: then nothing, and no signal
    std::optional<std::uint32_t> control_word() const;
    struct Request {
        std::uint32_t word = 0, chain = 0;
    };
    /// @returns what that word says besides; nothing if it says nothing, or no more
    std::optional<Request> control_request(std::uint32_t word) const;
    /// Tells what became of it.
    void answer(std::uint32_t word, abi::ControlResult result);
    /// What a kReload is about; nothing if that is no path.
    std::optional<std::string> control_path() const;
    /// And what came of it. What does not fit is cut off.
    void tell(std::uint32_t word, const std::string& text);
    /// A word has told what the chain may be at most.
    void allow(std::size_t chain, config::Mode mode);
    /// Its period, deadline or mode is another one from now on.
    void describe(std::size_t chain, const config::Chain& now);
    /// Sleeps until the word is another than `seen`, or perhaps not.
    /// @returns false if there is no word to wait for
    bool wait_for_control(std::uint32_t seen) const;

    /// The program comes to its end: readers do not find the page any more, but for what is kept of
    /// one that has tripped (page_folder.h). @threads any, once
    void retire();

  private:
    bool share(const ShareOptions& share, const ProcessKey& process);
    bool read_control(std::size_t at, void* to, std::size_t bytes) const;
    bool read_control_file(std::size_t at, void* to, std::size_t bytes) const;
    bool map_control(const std::string& stem, std::optional<unsigned> group);
    void lay_out(const ProcessKey& process, const config::Config& config,
                 std::chrono::nanoseconds now, const KernelList& kernels);

    std::string stem_, note_;
    int process_ = 0;
    std::size_t bytes_ = 0;
    void* memory_ = nullptr;
    abi::StatusHeader* header_ = nullptr;
    abi::SharedPage* akb_ = nullptr;
    abi::ChainStatus* chains_ = nullptr;
    abi::TaskStatus* tasks_ = nullptr;
    abi::ControlPage* control_ = nullptr;  ///< null: none. Only system calls read it
    MappedFile control_file_;
};

}  // namespace urgengo::observe
