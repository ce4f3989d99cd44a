// SPDX-License-Identifier: Apache-2.0
//
// A private folder that goes away with its owner, and one that stays for the user's session.
#pragma once

#include <memory>
#include <string>

#include "host/base/result.h"

namespace urgengo::cli {

class TemporaryFolder {
  public:
    /// Makes a folder under $TMPDIR or /tmp that only this user can enter.
    static Result<std::unique_ptr<TemporaryFolder>> make();

    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    ~TemporaryFolder();

    const std::string& path() const { return path_; }

  private:
    explicit TemporaryFolder(std::string path) : path_(std::move(path)) {}

    std::string path_;
};

/// @returns $XDG_RUNTIME_DIR/urgengo or /tmp/urgengo-<uid>, made if need be
/// @errors if it is not a folder of this user that no other user can enter
Result<std::string> session_folder();

}  // namespace urgengo::cli
