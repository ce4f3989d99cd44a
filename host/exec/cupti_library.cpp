// SPDX-License-Identifier: Apache-2.0
#include "host/exec/cupti_library.h"

#include <algorithm>
#include <filesystem>

namespace urgengo::exec {
namespace {

namespace fs = std::filesystem;

class Candidates {
  public:
    /// Every name of the library in this folder.
    void add_folder(const fs::path& folder) {
        if (folder.empty()) return;
        for (const std::string& name : cupti_names()) add((folder / name).lexically_normal());
    }

    void add(const std::string& file) {
        if (std::find(files.begin(), files.end(), file) == files.end()) files.push_back(file);
    }

    std::vector<std::string> files;
};

/// Of a Python site-packages folder, where wheels of NVIDIA's put it.
void add_wheels(Candidates& found, const fs::path& nvidia) {
    found.add_folder(nvidia / "cu13" / "lib");
    found.add_folder(nvidia / "cuda_cupti" / "lib");
}

void add_toolkit(Candidates& found, const fs::path& toolkit) {
    found.add_folder(toolkit / "extras" / "CUPTI" / "lib64");
    found.add_folder(toolkit / "lib64");
    found.add_folder(toolkit / "lib");
}

bool is_named(const fs::path& folder, const char* name) {
    return folder.filename() == name;
}

}  // namespace

const std::vector<std::string>& cupti_names() {
    static const auto& names =
        *new std::vector<std::string>{"libcupti.so.13", "libcupti.so.12", "libcupti.so"};
    return names;
}

std::vector<std::string> cupti_candidates(const std::string& asked,
                                          const std::vector<std::string>& mapped,
                                          const std::string& home) {
    Candidates found;
    if (!asked.empty()) found.add(asked);
    for (const fs::path library : mapped) {
        const fs::path folder = library.parent_path();
        const std::string name = library.filename();
        if (!is_named(folder, "lib") && !is_named(folder, "lib64")) continue;
        const fs::path above = folder.parent_path();
        if (is_named(above.parent_path(), "nvidia")) add_wheels(found, above.parent_path());
        if (is_named(above, "torch")) add_wheels(found, above.parent_path() / "nvidia");
        if (name.starts_with("libcudart.") || name.starts_with("libnvrtc."))
            add_toolkit(found, above);
    }
    if (!home.empty()) add_toolkit(found, home);
    add_toolkit(found, "/usr/local/cuda");
    for (const std::string& name : cupti_names()) found.add(name);  // where the loader looks
    return found.files;
}

}  // namespace urgengo::exec
