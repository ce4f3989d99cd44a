// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/thread_mix_spec.h"

#include <stdexcept>
#include <string>

#include "tests/support/catch.h"
#include "tests/support/folder.h"

using namespace urgengo::bench;
using urgengo::testing::Folder;

namespace {

/// @returns the spec of one chain that has these keys as well
MixSpec spec_with(const std::string& keys) {
    const Folder folder;
    return read_mix_spec(folder.write("spec.json", R"({"chains": [{"name": "a", "period_ms": 10,
        "deadline_ms": 10, "kernels": 1, "kernel_us": 100)" +
                                                       keys + "}]}"));
}

/// @returns what such a spec is refused with; the file's path is left out
std::string error_with(const std::string& keys) {
    try {
        spec_with(keys);
    } catch (const std::runtime_error& error) {
        const std::string text = error.what(), file = "spec.json: ";
        const auto at = text.find(file);
        return at == std::string::npos ? text : text.substr(at + file.size());
    }
    return "";
}

}  // namespace

TEST_CASE("Chain of a mix holds the mutex while it launches, or until it is done", "[bench]") {
    CHECK(spec_with("").chains[0].locks == MixLock::kNever);
    CHECK(spec_with(R"(, "locks": false)").chains[0].locks == MixLock::kNever);
    CHECK(spec_with(R"(, "locks": true)").chains[0].locks == MixLock::kLaunching);
    CHECK(spec_with(R"(, "locks": "wait")").chains[0].locks == MixLock::kFrame);
}

TEST_CASE("Spec of a mix with what is not accepted says what is", "[bench]") {
    CHECK(error_with(R"(, "locks": 1)") ==
          "locks: found 1, accepted: false, true (while it launches), \"wait\" (until its frame is "
          "done as well)");
    CHECK(error_with(R"(, "streams": 17)") == "streams: found 17, accepted: 1 to 16");
    CHECK(error_with(R"(, "waits_for": "a")") == "waits_for: found a, accepted: another chain");
}
