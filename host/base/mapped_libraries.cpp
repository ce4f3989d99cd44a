// SPDX-License-Identifier: Apache-2.0
#include "host/base/mapped_libraries.h"

#include <link.h>

namespace urgengo {

std::vector<std::string> mapped_libraries() {
    std::vector<std::string> paths;
    dl_iterate_phdr(
        [](dl_phdr_info* info, std::size_t, void* list) {
            if (info->dlpi_name && *info->dlpi_name)
                static_cast<std::vector<std::string>*>(list)->emplace_back(info->dlpi_name);
            return 0;
        },
        &paths);
    return paths;
}

}  // namespace urgengo
