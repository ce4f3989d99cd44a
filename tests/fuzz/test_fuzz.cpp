// SPDX-License-Identifier: Apache-2.0
//
// Where there is no clang: the corpus, and some changes of it that are the same each time
// (URGENGO_FUZZ_SEED: others). tools/fuzz does more, with libFuzzer.
#include <sys/resource.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "tests/fuzz/fuzz_targets.h"
#include "tests/fuzz/mutations.h"
#include "tests/support/catch.h"

using namespace urgengo::fuzz;

namespace {

constexpr int kChanges = 10000;
constexpr unsigned kLongest_s = 20;  // of one input, on a busy machine; SIGALRM ends the test

std::vector<Bytes> corpus(const std::string& name) {
    std::vector<std::filesystem::path> files;
    for (const auto& file :
         std::filesystem::directory_iterator(std::string(FUZZ_CORPUS) + "/" + name))
        files.push_back(file.path());
    std::sort(files.begin(), files.end());
    std::vector<Bytes> seeds;
    for (const auto& file : files) {
        std::ifstream stream(file, std::ios::binary);
        const std::string text{std::istreambuf_iterator<char>(stream), {}};
        const auto* const begin = reinterpret_cast<const std::byte*>(text.data());
        seeds.emplace_back(begin, begin + text.size());
    }
    return seeds;
}

/// What a reader asks for beyond that is std::bad_alloc. Sanitizers take more for themselves.
void limit_memory() {
#ifndef FUZZ_SANITIZED
    const rlimit limit{rlim_t{2} << 30, rlim_t{2} << 30};
    setrlimit(RLIMIT_AS, &limit);
#endif
}

}  // namespace

TEST_CASE("Readers of what others have written come back from any bytes", "[fuzz]") {
    limit_memory();
    const char* const asked = std::getenv("URGENGO_FUZZ_SEED");
    const auto seed = static_cast<std::uint32_t>(asked ? std::atoi(asked) : 1);
    for (const Target& target : kTargets) {
        const std::vector<Bytes> seeds = corpus(target.name);
        REQUIRE_FALSE(seeds.empty());
        Mutations mutations(seed);
        const auto run = [&](const Bytes& bytes, int number) {
            INFO(target.name << ", seed " << seed << ", input " << number);
            alarm(kLongest_s);
            CHECK_NOTHROW(target.run(bytes));
            alarm(0);
        };
        for (const Bytes& bytes : seeds) run(bytes, -1);
        for (int i = 0; i < kChanges; ++i) run(mutations.next(seeds), i);
    }
}
