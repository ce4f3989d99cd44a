// SPDX-License-Identifier: Apache-2.0
//
// Stream capture: from BeginCapture to EndCapture what a stream is given becomes nodes of a graph
// instead of work. All state is behind one lock; while nothing captures, one atomic read is all
// that a call costs.
//
//   none --BeginCapture--> active --EndCapture on the origin--> none, with a graph
//                            |  a stream that waits for an event recorded in a capture joins it
//                            +--a call that cannot be captured--> invalidated --EndCapture--> none
#pragma once

#include <thread>

#include "tools/simgpu/api/driver_state.h"

namespace urgengo::simgpu {

struct KernelCall;

struct Capture {
    std::uint64_t id;
    CUstreamCaptureMode mode;
    std::thread::id thread;
    CUgraph graph;
    bool is_programs;    ///< the program made the graph, and keeps it
    bool is_per_thread;  ///< begun on the thread's own stream: it ends with the thread
    Context* context;
    Stream* origin;  ///< only compared
    bool invalidated = false;
    std::vector<std::weak_ptr<Stream>> streams;  ///< the origin, and those that joined
};

struct CaptureInfo {
    CUstreamCaptureStatus status = CU_STREAM_CAPTURE_STATUS_NONE;
    std::uint64_t id = 0;
    CUgraph graph = nullptr;
    const std::vector<CUgraphNode>* dependencies = nullptr;
};

/// @param[in] into   the graph that gets the nodes; null for a new one
/// @param[in] after  its nodes that the first captured ones depend on
CUresult begin_capture(const std::shared_ptr<Stream>& stream, CUstreamCaptureMode mode,
                       CUgraph into = nullptr, std::vector<CUgraphNode> after = {});
CUresult end_capture(Stream& stream, CUgraph* graph);
CUresult capture_info(Stream& stream, CaptureInfo& info);

/// The stream is destroyed: a capture that it is part of cannot go on.
void abandon_capture(Stream& stream);

/// The context is destroyed, with the captures in it.
void abandon_captures(const Context& context);

/// @returns why the stream cannot take work now, if so: its capture is invalid, or it is the legacy
/// stream while a stream that it waits for captures (which invalidates that capture)
CUresult check_capture(Stream& stream);

/// For calls that would conflict with a capture, in the mode of the calling thread
/// (cuThreadExchangeStreamCaptureMode): allocation, module load, synchronisation, queries.
/// @returns CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED, and the capture is invalid
CUresult require_safe_call();

/// For calls that wait for all of a context, which conflict with captures of every mode.
/// @returns CUDA_ERROR_STREAM_CAPTURE_UNSUPPORTED, and the captures are invalid
CUresult require_no_capture(const Context& context);

/// For a call that no capturing stream can take.
CUresult refuse_if_capturing(Stream& stream);

/// Whether what is submitted to the stream becomes a node.
bool is_capturing(const Stream& stream);
void capture_work(Stream& stream, Work work, std::shared_ptr<KernelCall> kernel = nullptr);
void capture_node(Stream& stream, GraphNode node);

/// Records the event into the stream's capture.
void capture_event_record(Stream& stream, Event& event);

/// Lets the stream wait for the event within a capture.
/// @param[out] handled  false if neither captures: an ordinary wait
CUresult capture_event_wait(const std::shared_ptr<Stream>& stream, Event& event, bool& handled);

/// @returns CUDA_ERROR_CAPTURED_EVENT if the event was last recorded in a capture
CUresult require_not_captured(Event& event);

/// Swaps the calling thread's mode.
void exchange_capture_mode(CUstreamCaptureMode& mode);

}  // namespace urgengo::simgpu
