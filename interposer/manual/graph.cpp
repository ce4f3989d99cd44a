// SPDX-License-Identifier: Apache-2.0
//
// Graph launches: one unit that can be held and is followed by a mark. What is in it is not known
// yet, so it counts as one that fills the GPU. Its kernels keep the stream's priority.
#include "interposer/manual/launch.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;

namespace {

CUresult launch_graph(CUgraphExec graph, CUstream stream, StreamFlavor flavor) {
    const auto forward = [&] {
        return flavor == StreamFlavor::kPerThread ? real().cuGraphLaunch_ptsz(graph, stream)
                                                  : real().cuGraphLaunch(graph, stream);
    };
    if (!acts()) return forward();
    urgengo::runtime::Launch launch;
    launch.stream = stream;
    launch.flavor = flavor;
    return scheduled_launch(launch, forward, [&](int) { return forward(); });
}

}  // namespace

extern "C" {

CUresult CUDAAPI cuGraphLaunch(CUgraphExec graph, CUstream stream) {
    return launch_graph(graph, stream, StreamFlavor::kLegacy);
}

CUresult CUDAAPI cuGraphLaunch_ptsz(CUgraphExec graph, CUstream stream) {
    return launch_graph(graph, stream, StreamFlavor::kPerThread);
}

}  // extern "C"
