// SPDX-License-Identifier: Apache-2.0
//
// A program that opens the driver itself and asks for the names in its arguments, before it calls
// anything: says which are there and which are one function. Then, as the first argument says,
// "call": what each answers (stub_driver.cpp) to six numbers; or "ask": what cuGetProcAddress
// answers.
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
    if (std::strcmp(argv[1], "call") == 0) {
        using Function = int(long, long, long, long, long, long);
        for (int i = 2; i < argc; ++i)
            if (auto* function = reinterpret_cast<Function*>(dlsym(driver, argv[i])))
                std::printf("%s(...) = %d\n", argv[i], function(1, 20, 303, 4004, 50005, 600006));
        return 0;
    }
    using Resolver = int(const char*, void**, int, unsigned long long, int*);
    auto* resolver = reinterpret_cast<Resolver*>(dlsym(driver, "cuGetProcAddress_v2"));
    for (int i = 2; i < argc; ++i) {
        void* function = nullptr;
        int status = 0;
        const int result = resolver(argv[i], &function, 13000, 0, &status);
        const auto found = first_name.find(function);
        std::printf("cuGetProcAddress %s: %d, %d, is %s\n", argv[i], result, status,
                    found == first_name.end() ? "none of these" : found->second);
    }
}
