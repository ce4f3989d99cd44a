// SPDX-License-Identifier: Apache-2.0
//
// Runs random programs and says what became of each: a line with the final memory, the results of
// all calls, what was read back, and whether all went as CUDA promises: calls succeed, host
// functions keep their order. What did not is named by its operations' numbers.
//   random FIRST COUNT       programs of these seeds
//   random SEED 1 verbose    every operation with its result, and every word, too
#include <cstdint>
#include <string>

#include "tests/interposer/random_run.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

int random(const Arguments& arguments) {
    if (arguments.size() < 2) give_up("random needs the first seed and how many", 0);
    const std::uint64_t first = std::stoull(arguments[0]), count = std::stoull(arguments[1]);
    const Machine machine;
    bool right = true;
    for (std::uint64_t seed = first; seed < first + count; ++seed)
        right &= Run(machine, make_program(seed, simulated()), arguments.size() > 2).run(seed);
    return right ? 0 : 1;
}

const Scenario s1("random", random);

}  // namespace
}  // namespace twin
