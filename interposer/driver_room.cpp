// SPDX-License-Identifier: Apache-2.0
#include "interposer/driver_room.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>

namespace urgengo::interposer {
namespace {

// The kernel maps a large file where its pages can be huge ones (2 MiB), if there is room for that;
// the rest is for what else may be mapped there between our freeing it and the driver.
constexpr std::size_t kSpare = 8u << 20;

// In place of the room, once the driver has been asked for: it may be before we are initialised.
void* const kNoMore = MAP_FAILED;

std::atomic<void*> g_room{nullptr};
std::size_t g_room_size = 0;  // written before g_room

std::size_t mapped_bytes() {
    char text[32] = "";  // the first number is that of mapped pages
    const int file = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    if (file < 0) return 0;
    const ssize_t length = read(file, text, sizeof text - 1);
    close(file);
    return length <= 0
               ? 0
               : std::strtoull(text, nullptr, 10) * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
}

}  // namespace

bool can_do_without(const MappingLimits& limits, std::size_t size) {
    const auto hardly_missed = [&](rlim_t limit) {
        return limit == RLIM_INFINITY ||
               (limit >= limits.mapped_bytes && (limit - limits.mapped_bytes) / 16 >= size);
    };
    const bool may_not_lock_all = limits.locked < limits.mapped_bytes;
    return hardly_missed(limits.address_space) &&
           (may_not_lock_all || hardly_missed(limits.locked));
}

MappingLimits mapping_limits() {
    rlimit address_space{}, locked{};
    if (getrlimit(RLIMIT_AS, &address_space) != 0 || getrlimit(RLIMIT_MEMLOCK, &locked) != 0)
        return {};
    return {address_space.rlim_cur, locked.rlim_cur, mapped_bytes()};
}

void keep_driver_room(std::size_t mapped_size) {
    const std::size_t size = mapped_size + kSpare;
    if (mapped_size == 0 || g_room.load() || !can_do_without(mapping_limits(), size)) return;
    void* const room =
        mmap(nullptr, size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (room == MAP_FAILED) return;
    g_room_size = size;
    void* none = nullptr;
    if (!g_room.compare_exchange_strong(none, room)) munmap(room, size);
}

void free_driver_room() {
    void* const room = g_room.exchange(kNoMore);
    if (room && room != kNoMore) munmap(room, g_room_size);
}

}  // namespace urgengo::interposer
