// SPDX-License-Identifier: Apache-2.0
//
// Streams as host/progress knows them: a number that tells them apart within one context, and how
// each is ordered with the legacy stream.
#pragma once

#include "host/exec/driver_api.h"
#include "host/exec/stream_key.h"
#include "host/progress/stream_graph.h"

namespace urgengo::identity {

inline bool is_legacy(CUstream stream, exec::StreamFlavor flavor) {
    return stream == CU_STREAM_LEGACY ||
           (stream == nullptr && flavor == exec::StreamFlavor::kLegacy);
}

inline progress::StreamId stream_id(CUstream stream, exec::StreamFlavor flavor) {
    if (!exec::is_default_stream(stream)) return reinterpret_cast<progress::StreamId>(stream);
    static thread_local const char t_thread = 0;
    if (exec::is_per_thread(stream, flavor)) return reinterpret_cast<progress::StreamId>(&t_thread);
    return reinterpret_cast<progress::StreamId>(CU_STREAM_LEGACY);
}

/// Asks the driver, and it of a stream that is not known yet alone: once a stream.
inline progress::StreamKind stream_kind(const exec::DriverApi& driver,
                                        const progress::StreamGraph& graph, CUstream stream,
                                        exec::StreamFlavor flavor) {
    using progress::StreamKind;
    if (is_legacy(stream, flavor)) return StreamKind::kLegacy;
    if (exec::is_default_stream(stream)) return StreamKind::kBlocking;
    if (graph.knows(stream_id(stream, flavor)) || !driver.cuStreamGetFlags)
        return StreamKind::kNonBlocking;
    unsigned flags = CU_STREAM_NON_BLOCKING;
    if (driver.cuStreamGetFlags(stream, &flags) != CUDA_SUCCESS) flags = CU_STREAM_NON_BLOCKING;
    return flags & CU_STREAM_NON_BLOCKING ? StreamKind::kNonBlocking : StreamKind::kBlocking;
}

}  // namespace urgengo::identity
