// SPDX-License-Identifier: Apache-2.0
//
// Has CUPTI say when every kernel was on the GPU, for `urgengo profile`: into a trace, as
// kKernelTime and kClockPair records. Never part of `urgengo run`.
//
//  1 It is started before the program's first context, and never finalised: CUPTI is the process's,
//    and so is this object. Its library is found at run time (cupti_library.h): nothing links to
//    it.
//  2 CUPTI calls back in the launching thread, inside the launch: the id of the call goes into the
//    launch's record (kTraceCorrelated). The kernel's record, which comes later and from any
//    thread, has the same id; the reader of the trace puts them together. A call of the runtime's
//    API has an id of its own, and the kernel one of the two.
//  3 Kernels are recorded as CONCURRENT_KERNEL: they run as they would, and no mark is needed.
//  4 CUPTI's clock is another one. It is read beside ours at the begin, at every flush and at the
//    end; the reader interpolates. (A timestamp callback of ours would be called from inside
//    CUPTI, at any time.)
//
// Any thread may call; a flush takes a lock, and is made where the program waits anyway.
#pragma once

#include <cstdint>
#include <string>

#include "host/base/clock.h"
#include "host/base/result.h"
#include "host/observe/trace_writer.h"

namespace urgengo::exec {

class CuptiTracer {
  public:
    /// Starts CUPTI, the first time that it is called; later the same answer.
    /// @param library  a libcupti; empty: it is looked for
    /// @errors one line: why it cannot be: none is found, or another tool has it, and which
    static const Result<CuptiTracer*>& start(const std::string& library);

    /// What comes from here on is written. Once.
    void attach(observe::TraceWriter& writer);

    /// In the launching thread, before and after the call.
    static void launch_begins();
    static void describe_launch(abi::TraceRecord& record);

    /// Takes what is there, if that was not done for a while. Between the program's calls: CUPTI
    /// may call the driver.
    void flush_now_and_then(nanoseconds now);
    /// Takes all there is. At the program's end.
    void finish();

  private:
    CuptiTracer() = default;
    static Result<CuptiTracer*> try_to_start(const std::string& library);
    struct Calls;
    struct Callbacks;
};

}  // namespace urgengo::exec
