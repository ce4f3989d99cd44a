// SPDX-License-Identifier: Apache-2.0
//
// A config that is read anew while the program runs: what can change is taken from it, all of it or
// nothing. An instance that is under way keeps the deadline that its launches are decided by; it is
// late or not by the new one.
//
// @threads one at a time: the one that obeys words (steering.h)
#pragma once

#include <string>

#include "host/base/result.h"
#include "host/runtime/common.h"

namespace urgengo::runtime {

class Reloading {
  public:
    /// @param common  outlives it
    Reloading(Common& common, const config::ResolvedConfig& started_with);

    struct Done {
        std::string text;  ///< what has changed
        config::Mode mode;
        bool changes_mode = false;  ///< that of all chains, which is for the caller to set
    };
    /// @param path  of a resolved config, of the process' user
    /// @errors why it is refused; then nothing has changed. Tells nothing of what is in the file,
    /// if
    ///         that is no config: who may steer need not be who may read it
    Result<Done> reload(const std::string& path);

  private:
    void apply(std::size_t index, const config::Chain& next);

    Common& common_;
    config::Config now_;
    const bool mode_is_asked_;
};

}  // namespace urgengo::runtime
