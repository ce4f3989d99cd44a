// SPDX-License-Identifier: Apache-2.0
//
// What happens when the loader has mapped us, before the program itself calls (a library that is
// initialised before us may have). The driver is looked at and not loaded: a program that never
// calls it has none.
#include <cerrno>
#include <cstdlib>

#include "host/base/log.h"
#include "host/base/settings.h"
#include "interposer/driver_file.h"
#include "interposer/driver_room.h"
#include "interposer/elf_symbols.h"
#include "interposer/lifecycle.h"
#include "interposer/own_symbols.h"

namespace urgengo::interposer {
namespace {

__attribute__((constructor)) void on_load() {
    const int saved_errno = errno;
    remember_stderr();
    watch_forks();
    try {
        const std::string path =
            find_driver_file(read_settings().real_libcuda, std::getenv("LD_LIBRARY_PATH"));
        std::size_t size = 0;
        if (!path.empty()) {  // else every call answers that there is no driver
            const MappedFile driver(path);
            match_exports_to_driver(driver.bytes());
            size = mapped_size(driver.bytes());
        }
        keep_driver_room(size);
    } catch (...) {
        // Out of memory, before anything was changed.
    }
    errno = saved_errno;
}

}  // namespace
}  // namespace urgengo::interposer
