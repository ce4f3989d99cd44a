// SPDX-License-Identifier: Apache-2.0
//
// A program that opens the driver itself and asks for the names in its arguments, before it calls
// anything: says which are there and which are one function, and if the first argument is "call",
// what each answers (stub_driver.cpp) to six numbers.
#include <dlfcn.h>

#include <cstdio>
#include <cstring>
#include <map>

int main(int argc, char** argv) {
    if (argc < 2) return 98;
    void* driver = dlopen("libcuda.so.1", RTLD_NOW);
    if (!driver) return 98;
    std::map<void*, const char*> first_name;
    for (int i = 2; i < argc; ++i) {
        dlerror();
        void* function = dlsym(driver, argv[i]);
        const bool error = dlerror() != nullptr;
        void* versioned = dlvsym(driver, argv[i], "NO_SUCH_VERSION");
        if (!function) {
            std::printf("%s: not found, error %d, %d\n", argv[i], error, versioned != nullptr);
            continue;
        }
        const char* name = first_name.emplace(function, argv[i]).first->second;
        std::printf("%s: is %s, %d\n", argv[i], name, versioned != nullptr);
    }
    if (std::strcmp(argv[1], "call") != 0) return 0;
    using Function = int(long, long, long, long, long, long);
    for (int i = 2; i < argc; ++i)
        if (auto* function = reinterpret_cast<Function*>(dlsym(driver, argv[i])))
            std::printf("%s(...) = %d\n", argv[i], function(1, 20, 300, 4000, 50000, 600000));
}
