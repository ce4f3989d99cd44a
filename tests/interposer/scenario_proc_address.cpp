// SPDX-License-Identifier: Apache-2.0
//
// Asks cuGetProcAddress for every name in a file, through both of its versions. `proc_address` says
// only what is the same in every process: results, and which answers are one and the same function.
// `proc_owner` says whose function each answer is.
#include <dlfcn.h>

#include <fstream>
#include <map>

#include "tests/interposer/twin.h"

// cuda.h lets this name stand for the second version, and declares only that.
#undef cuGetProcAddress
extern "C" CUresult cuGetProcAddress(const char* symbol, void** function, int version,
                                     cuuint64_t flags);

namespace twin {
namespace {

struct Request {
    std::string name;
    int version;
    cuuint64_t flags;
};

std::string base_name(std::string name) {
    for (const char* suffix : {"_ptsz", "_ptds"})
        if (name.ends_with(suffix)) name.resize(name.size() - 5);
    const std::size_t last = name.rfind("_v");
    if (last != std::string::npos && last + 3 == name.size()) name.resize(last);
    return name;
}

/// Reads lines "name", each asked for at several versions with all flags, or
/// "name ver=VERSION flags=FLAGS" as recorded from cudart, whose first name is empty.
std::vector<Request> read_requests(const std::string& path) {
    std::ifstream file(path);
    if (!file) give_up(path.c_str(), errno);
    std::vector<Request> requests;
    std::map<std::string, bool> seen;
    for (std::string line; std::getline(file, line);) {
        const std::size_t version = line.find("ver="), flags = line.find("flags=");
        if (version != std::string::npos) {
            std::string name = line.substr(0, version);
            while (!name.empty() && name.back() == ' ') name.pop_back();
            requests.push_back(
                {name, std::stoi(line.substr(version + 4)), std::stoull(line.substr(flags + 6))});
        } else if (!line.empty() && line.front() != '#' && !seen[base_name(line)]) {
            seen[base_name(line)] = true;
            for (int at : {2000, 12000, 12040, 13000})
                for (cuuint64_t with : {0, 1, 2}) requests.push_back({base_name(line), at, with});
        }
    }
    return requests;
}

/// Numbers functions in the order in which they are first seen.
class Numbering {
  public:
    int number(void* function) {
        if (!function) return -1;
        return numbers_.emplace(function, static_cast<int>(numbers_.size())).first->second;
    }

  private:
    std::map<void*, int> numbers_;
};

void ask_both(const Request& r, Numbering& numbering) {
    void* const untouched = &numbering;
    void *first = untouched, *second = untouched;
    int status = 99;  // an int: no value of the enumeration, to see whether it is written
    static_assert(sizeof(status) == sizeof(CUdriverProcAddressQueryResult));
    const CUresult result_1 = cuGetProcAddress(r.name.c_str(), &first, r.version, r.flags);
    const CUresult result_2 =
        cuGetProcAddress_v2(r.name.c_str(), &second, r.version, r.flags,
                            reinterpret_cast<CUdriverProcAddressQueryResult*>(&status));
    say("'%s' %d %d: %d #%d | %d #%d status %d", r.name.c_str(), r.version, int(r.flags), result_1,
        numbering.number(first), result_2, numbering.number(second), status);
}

int proc_address(const Arguments& arguments) {
    Numbering numbering;
    for (const std::string& path : arguments)
        for (const Request& request : read_requests(path)) ask_both(request, numbering);

    for (const char* near_miss :
         {"cuLaunchKerne", "cuLaunchKernelx", "cuLaunchKernel_ptsz", "cuLaunchKernelEx_ptsz",
          "culaunchkernel", " cuLaunchKernel", "cuLaunchKernel ", "cuMemcpyDtoH_v2", "ug_status",
          "urgengo_entry_points", "cu", ""})
        ask_both({near_miss, 13000, 0}, numbering);
    for (int version : {0, 1, 2000, 3999, 4000, 6999, 7000, 11059, 11060, 99999, -1})
        for (const char* name : {"cuLaunchKernel", "cuLaunchKernelEx", "cuGetProcAddress",
                                 "cuStreamBeginCapture", "cuMemcpyDtoH"})
            for (cuuint64_t flags : {0, 1, 2, 3, 4}) ask_both({name, version, flags}, numbering);

    void* function = nullptr;
    CUdriverProcAddressQueryResult status{};
    SHOW(cuGetProcAddress(nullptr, &function, 13000, 0));
    SHOW(cuGetProcAddress("cuInit", nullptr, 13000, 0));
    SHOW(cuGetProcAddress("cuLaunchKernel", nullptr, 13000, 0));
    SHOW(cuGetProcAddress_v2(nullptr, &function, 13000, 0, &status));
    SHOW(cuGetProcAddress_v2("cuLaunchKernel", nullptr, 13000, 0, &status));
    SHOW(cuGetProcAddress_v2("cuLaunchKernel", &function, 13000, 0, nullptr));
    return 0;
}

int proc_owner(const Arguments& arguments) {
    for (const std::string& path : arguments)
        for (const Request& r : read_requests(path))
            for (bool second : {false, true}) {
                void* function = nullptr;
                CUdriverProcAddressQueryResult status;
                const CUresult result =
                    second ? cuGetProcAddress_v2(r.name.c_str(), &function, r.version, r.flags,
                                                 &status)
                           : cuGetProcAddress(r.name.c_str(), &function, r.version, r.flags);
                Dl_info info;
                if (result != CUDA_SUCCESS || !dladdr(function, &info)) continue;
                const bool at_its_start = info.dli_saddr == function;
                say("%s:%d:%d:%d %s %s", r.name.c_str(), r.version, int(r.flags), second,
                    at_its_start ? info.dli_sname : "?", info.dli_fname);
            }
    return 0;
}

const Scenario s1("proc_address", proc_address), s2("proc_owner", proc_owner);

}  // namespace
}  // namespace twin
