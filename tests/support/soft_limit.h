// SPDX-License-Identifier: Apache-2.0
//
// A limit of this process, and of what it starts, for as long as the object lives.
#pragma once

#include <sys/resource.h>

#include "tests/support/catch.h"

namespace urgengo::testing {

class SoftLimit {
  public:
    /// @param limit  at most the hard limit, which stays
    SoftLimit(__rlimit_resource what, rlim_t limit) : what_(what) {
        REQUIRE(getrlimit(what, &before_) == 0);
        const rlimit lower{limit, before_.rlim_max};
        REQUIRE(setrlimit(what, &lower) == 0);
    }
    ~SoftLimit() { setrlimit(what_, &before_); }
    SoftLimit(const SoftLimit&) = delete;
    SoftLimit& operator=(const SoftLimit&) = delete;

  private:
    __rlimit_resource what_;
    rlimit before_{};
};

}  // namespace urgengo::testing
