// SPDX-License-Identifier: Apache-2.0
#include "interposer/manual/launch_config.h"

#include <algorithm>

namespace urgengo::interposer {
namespace {

const CUlaunchAttribute* find_attribute(const CUlaunchConfig& config, CUlaunchAttributeID id) {
    const CUlaunchAttribute* const first = config.attrs;
    const CUlaunchAttribute* const last = first + config.numAttrs;
    const auto* found =
        std::find_if(first, last, [&](const CUlaunchAttribute& a) { return a.id == id; });
    return found == last ? nullptr : found;
}

}  // namespace

runtime::Launch described(const CUlaunchConfig& config, CUfunction f, exec::StreamFlavor flavor) {
    runtime::Launch launch;
    launch.function = f;
    launch.grid_blocks = grid_blocks(config);
    launch.block_threads = block_threads(config);
    launch.stream = config.hStream;
    launch.flavor = flavor;
    launch.shared_bytes = config.sharedMemBytes;
    if (config.numAttrs == 0) return launch;
    const auto* overlap =
        find_attribute(config, CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION);
    launch.depends_on_previous = overlap && overlap->value.programmaticStreamSerializationAllowed;
    if (const auto* own = find_attribute(config, CU_LAUNCH_ATTRIBUTE_PRIORITY)) {
        launch.asks_priority = true;
        launch.priority = own->value.priority;
    }
    return launch;
}

}  // namespace urgengo::interposer
