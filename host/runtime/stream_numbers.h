// SPDX-License-Identifier: Apache-2.0
//
// Numbers for streams, as records name them (abi/run_record.h): by their handles, in the order in
// which they are first asked for.
//
// @threads any; takes no lock
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "host/identity/stream_id.h"
#include "urgengo/abi/run_record.h"

namespace urgengo::runtime {

class StreamNumbers {
  public:
    static constexpr std::size_t kMost = 256;

    /// @returns 1 and more; 0 of no stream, or of one more than are kept apart
    std::uint16_t number_of(progress::StreamId stream) {
        if (stream == 0) return 0;
        for (std::size_t i = 0; i < kMost; ++i) {
            progress::StreamId its = streams_[i].load(std::memory_order_relaxed);
            if (its == 0 &&
                streams_[i].compare_exchange_strong(its, stream, std::memory_order_relaxed))
                its = stream;
            if (its == stream) return static_cast<std::uint16_t>(i + 1);
        }
        return 0;
    }

  private:
    // The first one: abi::kRunLegacyStream.
    std::array<std::atomic<progress::StreamId>, kMost> streams_{
        reinterpret_cast<progress::StreamId>(CU_STREAM_LEGACY)};
};

}  // namespace urgengo::runtime
