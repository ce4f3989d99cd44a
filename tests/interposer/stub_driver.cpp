// SPDX-License-Identifier: Apache-2.0
//
// A libcuda.so.1 that does nothing but be asked: every exported name is there, and answers a number
// that depends on which function it is and on every argument. Built several times, with names left
// out and names that share one function. cuGetProcAddress answers as a real driver did, if
// STUB_RECORD names a record of it (tools/codegen/record_driver.py); else the exported function of
// that name.
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <string>

namespace {

int answer(int index, long a, long b, long c, long d, long e, long f) {
    return index * 1000 + static_cast<int>((a + 2 * b + 3 * c + 5 * d + 7 * e + 11 * f) % 1000);
}

}  // namespace

#define EXPORT extern "C" __attribute__((visibility("default")))
// STUB(name): a function. SAME(name, other): a second name of `other`.
#define STUB(name)                                                    \
    EXPORT int name(long a, long b, long c, long d, long e, long f) { \
        return answer(__COUNTER__, a, b, c, d, e, f);                 \
    }
#define SAME(name, other) EXPORT int name() __attribute__((alias(#other)));
#include STUB_NAMES
#undef STUB
#undef SAME
#ifdef STUB_BYTES
// As large as a driver, once it is mapped.
extern "C" {
__attribute__((visibility("default"))) char stub_bytes[STUB_BYTES];
}
#endif

EXPORT int cuGetProcAddress(const char*, void**, int, std::uint64_t);
EXPORT int cuGetProcAddress_v2(const char*, void**, int, std::uint64_t, int*);

namespace {

struct Answer {
    int result = 500;
    std::string function = "-";
    int status = 1;
};

struct Answers {
    Answer first, second;  // of the two versions of cuGetProcAddress
};

const std::map<std::string, void*>& exports() {
    static const std::map<std::string, void*> all{
#define STUB(name) {#name, reinterpret_cast<void*>(&name)},
#define SAME(name, other) {#name, reinterpret_cast<void*>(&name)},
#include STUB_NAMES
        {"cuGetProcAddress", reinterpret_cast<void*>(&cuGetProcAddress)},
        {"cuGetProcAddress_v2", reinterpret_cast<void*>(&cuGetProcAddress_v2)},
    };
    return all;
}

std::string key(const std::string& name, int version, std::uint64_t flags) {
    return "'" + name + "' " + std::to_string(version) + " " + std::to_string(flags);
}

// Lines "'name' version flags: result function | result function status".
std::map<std::string, Answers> read_record() {
    std::map<std::string, Answers> all;
    const char* path = std::getenv("STUB_RECORD");
    if (!path) return all;
    std::ifstream file(path);
    for (std::string line; std::getline(file, line);) {
        const std::size_t colon = line.find(": ");
        if (colon == std::string::npos || line.front() != '\'') continue;
        char first[128], second[128];
        Answers a;
        if (std::sscanf(line.c_str() + colon, ": %d %127s | %d %127s %d", &a.first.result, first,
                        &a.second.result, second, &a.second.status) != 5)
            std::abort();
        a.first.function = first;
        a.second.function = second;
        all[line.substr(0, colon)] = a;
    }
    return all;
}

void give(const Answer& answer, void** function) {
    static char unexported[4096];
    if (answer.function == "untouched") return;
    if (answer.function == "-") {
        *function = nullptr;
    } else if (answer.function.front() == '?') {
        *function = unexported + std::stoi(answer.function.substr(1));
    } else {
        *function = exports().at(answer.function);
    }
}

Answers find(const char* name, int version, std::uint64_t flags) {
    static const std::map<std::string, Answers> record = read_record();
    const auto found = record.find(key(name, version, flags));
    if (found != record.end()) return found->second;
    Answers a;
    if (exports().count(name)) {
        a.first = {0, name, 0};
        a.second = {0, name, 0};
    } else {
        a.second.result = 0;
    }
    return a;
}

}  // namespace

int cuGetProcAddress(const char* name, void** function, int version, std::uint64_t flags) {
    if (!name || !function) std::raise(SIGSEGV);  // as the recorded driver does
    const Answer a = find(name, version, flags).first;
    give(a, function);
    return a.result;
}

int cuGetProcAddress_v2(const char* name, void** function, int version, std::uint64_t flags,
                        int* status) {
    if (!name || !function) std::raise(SIGSEGV);  // as the recorded driver does
    const Answer a = find(name, version, flags).second;
    give(a, function);
    if (status && a.status != 99) *status = a.status;
    return a.result;
}
