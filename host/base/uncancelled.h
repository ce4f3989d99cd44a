// SPDX-License-Identifier: Apache-2.0
//
// While it lives, the calling thread is not cancelled: what UrgenGo opens, reads or waits for in
// one of the program's calls would be a cancellation point that the call has not.
#pragma once

#include <pthread.h>

namespace urgengo {

class Uncancelled {
  public:
    Uncancelled() { pthread_setcancelstate(PTHREAD_CANCEL_DISABLE, &before_); }
    ~Uncancelled() { pthread_setcancelstate(before_, nullptr); }
    Uncancelled(const Uncancelled&) = delete;
    Uncancelled& operator=(const Uncancelled&) = delete;

  private:
    int before_ = PTHREAD_CANCEL_ENABLE;
};

}  // namespace urgengo
