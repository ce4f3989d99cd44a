// SPDX-License-Identifier: Apache-2.0
//
// SIMGPU_DRIVER.
#include "tools/simgpu/api/driver_version.h"

#include <algorithm>
#include <array>

#include "tools/simgpu/api/environment.h"

namespace urgengo::simgpu {

int read_driver_version(std::vector<std::string>& problems) {
    constexpr std::array kVersions = {12000, 12040, 13000, 13030};
    const auto own = std::find(kVersions.begin(), kVersions.end(), kDefaultDriver);
    const std::size_t choice =
        read_choice("SIMGPU_DRIVER", {"12.0", "12.4", "13.0", "13.3"},
                    static_cast<std::size_t>(own - kVersions.begin()), problems);
    return kVersions[choice];
}

}  // namespace urgengo::simgpu
