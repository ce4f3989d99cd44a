// SPDX-License-Identifier: Apache-2.0
//
// cuGetProcAddress: through UrgenGo it answers what the driver answers, with UrgenGo's function in
// the place of each one that the driver exports. (Functions that a driver does not export:
// test_missing_entries.cpp, with a recorded driver.)
#include <dlfcn.h>

#include <map>
#include <set>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

namespace {

const char* const kAllNames = SOURCE_FOLDER "/tools/codegen/exports/toolkit_13.0.txt";
const char* const kDriverNames = SOURCE_FOLDER "/tools/codegen/exports/driver_580.159.04.txt";
const char* const kCudartRequests =
    SOURCE_FOLDER "/tests/interposer/data/cudart13_driver_requests.txt";

std::set<std::string> overridden_names() {
    std::set<std::string> names;
    for (const std::string& line :
         lines_of(read_text(SOURCE_FOLDER "/tools/codegen/overrides.csv")))
        names.insert(line.substr(0, line.find(',')));
    names.erase("symbol");  // the heading
    return names;
}

struct Owner {
    std::string function;  ///< the exported name at that address
    std::string library;
};

/// The answers of `twin proc_owner`, by request.
std::map<std::string, Owner> owners(const Environment& environment) {
    const Outcome outcome =
        run_twin({"proc_owner", kAllNames, kDriverNames, kCudartRequests}, environment);
    REQUIRE(outcome.exit_status == 0);
    std::map<std::string, Owner> all;
    for (const std::string& line : lines_of(outcome.out)) {
        const std::size_t function = line.find(' '), library = line.find(' ', function + 1);
        all[line.substr(0, function)] = {line.substr(function + 1, library - function - 1),
                                         line.substr(library + 1)};
    }
    return all;
}

bool ends_with(const std::string& text, const std::string& end) {
    return text.size() >= end.size() &&
           text.compare(text.size() - end.size(), end.size(), end) == 0;
}

}  // namespace

TEST_CASE("cuGetProcAddress answers as the driver does when any name, version and flags are given",
          "[interposer][proc_address]") {
    const std::vector<std::string> arguments{"proc_address", kAllNames, kDriverNames,
                                             kCudartRequests};
    const Outcome alone = run_twin(arguments, bare());
    REQUIRE(alone.exit_status == 0);
    REQUIRE(lines_of(alone.out).size() > 4000);
    for (const Environment& environment : {preloaded(), by_library_path()}) {
        const Outcome with_urgengo = run_twin(arguments, environment);
        CHECK(with_urgengo.exit_status == 0);
        CHECK(with_urgengo.err.empty());
        const auto expected = lines_of(alone.out), found = lines_of(with_urgengo.out);
        REQUIRE(found.size() == expected.size());
        std::size_t num_different = 0;
        for (std::size_t i = 0; i < found.size(); ++i)
            if (found[i] != expected[i] && ++num_different <= 10) CHECK(found[i] == expected[i]);
        CHECK(num_different == 0);
    }
}

TEST_CASE("cuGetProcAddress gives the function that the loader finds",
          "[interposer][proc_address]") {
    const std::set<std::string> overridden = overridden_names();
    REQUIRE(overridden.size() > 20);
    const auto alone = owners(bare()), with_urgengo = owners(preloaded());
    REQUIRE(alone.size() > 1000);
    REQUIRE(with_urgengo.size() == alone.size());
    std::set<std::string> given;
    for (const auto& [request, expected] : alone) {
        INFO(request << ": " << expected.function);
        const Owner& found = with_urgengo.at(request);
        CHECK(found.function == expected.function);
        REQUIRE(ends_with(expected.library, "lib/simgpu/libcuda.so.1"));
        CHECK(ends_with(found.library, "lib/urgengo/libcuda.so.1"));
        given.insert(found.function);
    }
    // The simulated driver does not have every function; every other override was asked for.
    void* simulated = dlopen(SIMGPU_FOLDER "/libcuda.so.1", RTLD_LAZY | RTLD_LOCAL);
    REQUIRE(simulated != nullptr);
    std::size_t num_checked = 0;
    for (const std::string& name : overridden) {
        if (!dlsym(simulated, name.c_str()) || name.rfind("cuGraph", 0) == 0) continue;
        INFO(name);
        CHECK(given.count(name) == 1);
        ++num_checked;
    }
    CHECK(num_checked > 50);
}

TEST_CASE("Every known entry that begins a capture is one that UrgenGo implements",
          "[interposer][proc_address]") {
    const std::set<std::string> overridden = overridden_names();
    int num_found = 0;
    for (const char* list : {kAllNames, kDriverNames})
        for (const std::string& name : lines_of(read_text(list))) {
            if (name.rfind("cuStreamBegin", 0) != 0) continue;
            INFO(name);
            CHECK(overridden.count(name) == 1);
            ++num_found;
        }
    CHECK(num_found == 12);
}
