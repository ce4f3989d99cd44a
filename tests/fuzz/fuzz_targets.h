// SPDX-License-Identifier: Apache-2.0
//
// What is fuzzed: readers of what others have written. Each takes any bytes, and must come back:
// with what it has read, or with an error.
#pragma once

#include <cstddef>
#include <span>

namespace urgengo::fuzz {

using Input = std::span<const std::byte>;

void page(Input input);      ///< status page, and what `urgengo top` and `export` make of it
void control(Input input);   ///< control file, which the program reads
void run(Input input);       ///< records of a run, and what `urgengo trace` makes of them
void trace(Input input);     ///< trace of a program, of `urgengo discover` and `profile`
void config(Input input);    ///< chains.yaml
void profile(Input input);   ///< chains.profile.json
void resolved(Input input);  ///< what the interposer reads, in the user's program

struct Target {
    const char* name;  ///< of its folder in corpus/
    void (*run)(Input);
};
inline constexpr Target kTargets[] = {
    {"page", page},     {"control", control}, {"run", run},          {"trace", trace},
    {"config", config}, {"profile", profile}, {"resolved", resolved}};

}  // namespace urgengo::fuzz
