// SPDX-License-Identifier: Apache-2.0
//
// A program that maps as much as its argument says, in GiB, before its first call of the driver,
// and says how far the driver then lies from the C library, in MiB; and how much of the address
// space was its own before that call, in MiB.
//   driver_place <gibibytes> <path that is the driver's>
#include <dlfcn.h>
#include <sys/mman.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

// Where the first line of /proc/self/maps with that text begins; 0 if there is none.
std::uint64_t mapped_at(const char* text) {
    std::FILE* maps = std::fopen("/proc/self/maps", "r");
    char line[4096];
    std::uint64_t at = 0;
    while (maps && at == 0 && std::fgets(line, sizeof line, maps))
        if (std::strstr(line, text)) at = std::strtoull(line, nullptr, 16);
    if (maps) std::fclose(maps);
    return at;
}

unsigned long mapped_mib() {
    std::FILE* statm = std::fopen("/proc/self/statm", "r");
    unsigned long pages = 0;
    const bool read = statm && std::fscanf(statm, "%lu", &pages) == 1;
    if (statm) std::fclose(statm);
    return read ? pages / 256 : 0;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3) return 98;
    const unsigned long mapped = mapped_mib();
    void* library = dlopen("libcuda.so.1", RTLD_NOW);
    if (!library) return 98;
    if (mmap(nullptr, std::strtoull(argv[1], nullptr, 10) << 30, PROT_NONE,
             MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0) == MAP_FAILED)
        return 97;
    auto* init = reinterpret_cast<int (*)(unsigned)>(dlsym(library, "cuInit"));
    if (!init) return 95;
    init(0);
    const std::uint64_t driver = mapped_at(argv[2]), c_library = mapped_at("/libc.so.6");
    if (driver == 0 || c_library == 0) return 96;
    const std::uint64_t distance = driver < c_library ? c_library - driver : driver - c_library;
    std::printf("%llu %lu\n", static_cast<unsigned long long>(distance >> 20), mapped);
}
