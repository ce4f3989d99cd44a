// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/nvtxw_backend.h"

#include "tools/trace/nvtxw.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

namespace urgengo::trace {
namespace {

namespace fs = std::filesystem;

Result<NvtxwBackend> use(const std::string& path, void* library) {
    const auto get = reinterpret_cast<nvtxw::GetInterface>(dlsym(library, nvtxw::kEntry));
    if (!get)
        return Error{fmt::format(
            "{}: found {}, accepted: a backend of NVTXW, version {} ({})", path,
            dlsym(library, nvtxw::kEntryOfVersion1) ? "a backend of version 1" : "no backend",
            nvtxw::kVersion, nvtxw::kEntry)};
    const void* table = nullptr;
    const nvtxw::Code code = get(nvtxw::kVersion, &table);
    if (code != nvtxw::kSuccess || !table)
        return Error{fmt::format("{}: refuses version {} of NVTXW: {}", path, nvtxw::kVersion,
                                 code == nvtxw::kSuccess ? "no table" : nvtxw::code_words(code))};
    return NvtxwBackend{path, static_cast<const nvtxw::Interface*>(table)};
}

}  // namespace

std::string nvtxw::code_words(Code code) {
    static constexpr std::array kWords = {"success",       "failed",       "invalid argument",
                                          "no library",    "not loaded",   "no such symbol",
                                          "other version", "not supported"};
    const auto index = static_cast<std::size_t>(code);
    return code >= 0 && index < kWords.size() ? kWords[index] : fmt::format("code {}", code);
}

Result<NvtxwBackend> load_nvtxw_backend() {
    std::vector<std::string> paths;
    for (const char* name : {nvtxw::kLibraryVariable, "NVTXW_BACKEND"}) {
        const char* const path = std::getenv(name);
        if (!path || !*path) continue;
        void* const library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
        if (library) return use(path, library);
        return Error{
            fmt::format("{}: found {}, accepted: a backend of NVTXW: {}", name, path, dlerror())};
    }
    std::error_code unknown;
    const fs::path own = fs::read_symlink("/proc/self/exe", unknown);
    if (!unknown) paths.push_back((own.parent_path() / nvtxw::kLibrary).string());
    paths.emplace_back(nvtxw::kLibrary);
    for (const std::string& path : paths)
        if (void* const library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL))
            return use(path, library);
    return Error{fmt::format(
        "found no backend of NVTXW: {} and NVTXW_BACKEND name none, and there is no {} in {} nor "
        "where the loader looks",
        nvtxw::kLibraryVariable, nvtxw::kLibrary, own.parent_path().string())};
}

}  // namespace urgengo::trace
