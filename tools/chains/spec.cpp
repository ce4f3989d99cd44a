// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/spec.h"

#include <algorithm>
#include <cmath>

namespace urgengo::chains {

namespace {

// Kernel counts, GPU times and input sizes: the paper's Tab. 3 (task profiling). Where Tab. 3 and
// Tab. 2 disagree Tab. 2's totals per chain count: icp is C8's 19.7 ms less path's 8.0, calibrate
// is C9's 46.1 ms.
// clang-format off
const TaskSpec kDetect3d{"detect3d", 41, 13.4, 22000, 25000};  // PointPillars, points
const TaskSpec kTrack{"track", 16, 15.0, 2500, 8000};          // particle filter, particles
const TaskSpec kDetect2d{"detect2d", 323, 19.8};               // YOLOX
const TaskSpec kFace{"face", 225, 7.1};                        // face detection
const TaskSpec kSign{"sign", 65, 10.4};                        // traffic sign classification
const TaskSpec kSegment{"segment", 63, 11.5};                  // image segmentation
const TaskSpec kPath{"path", 256, 8.0, 6400, 15360};           // path finding, map cells
const TaskSpec kIcp{"icp", 40, 11.7, 22000, 65000};            // LiDAR registration, points
const TaskSpec kCalibrate{"calibrate", 133, 46.1};             // online calibration
// clang-format on

}  // namespace

const std::vector<ChainSpec>& paper_chains() {
    // Periods, deadlines and CPU times: the paper's Tab. 2 (chain properties).
    // clang-format off
    static const std::vector<ChainSpec> chains = {
        //     period  deadline  cpu (ms)
        {"C0", 150,    120,      17.4, {kDetect3d, kTrack}},
        {"C1", 150,    120,      16.2, {kDetect3d, kTrack}},
        {"C2", 500,    120,      21.0, {kDetect2d, kFace}},
        {"C3", 200,    120,      20.2, {kDetect2d, kSign}},
        {"C4", 150,    120,      21.8, {kSegment, kPath}},
        {"C5", 200,    120,      20.2, {kDetect2d, kSign}},
        {"C6", 200,    120,      21.8, {kSegment, kPath}},
        {"C7", 500,    120,      21.0, {kDetect2d, kFace}},
        {"C8", 200,    120,      21.3, {kIcp, kPath}},
        {"C9", 500,    120,      11.2, {kCalibrate}},
    };
    // clang-format on
    return chains;
}

std::vector<std::string> tight_chains(double fraction) {
    std::vector<std::string> order = {"C0", "C3", "C6", "C8", "C1", "C2", "C4", "C5", "C7", "C9"};
    const double count = std::round(std::clamp(fraction, 0.0, 1.0) * double(order.size()));
    order.resize(static_cast<std::size_t>(count));
    return order;
}

}  // namespace urgengo::chains
