// SPDX-License-Identifier: Apache-2.0
//
// What a random program's operations are called.
#include <array>
#include <sstream>

#include "tests/interposer/random_program.h"

namespace twin {

const char* name_of(Kind kind) {
    static constexpr std::array kKinds = {
        "mix",          "store",      "tiny",      "wide",        "copy",       "memset",
        "write value",  "host mix",   "pool",      "graph",       "read back",  "record",
        "wait event",   "write flag", "wait flag", "stream sync", "event sync", "poll",
        "context sync", "alloc free", "register",  "load unload", "query",      "refused"};
    return kKinds[std::size_t(kind)];
}

std::string to_text(const Operation& operation) {
    std::ostringstream text;
    text << "thread " << operation.thread << " stream " << operation.stream << ' '
         << name_of(operation.kind);
    if (operation.word >= 0) text << " word " << operation.word;
    if (operation.from >= 0) text << " from " << operation.from;
    text << " value " << operation.value << " variant " << operation.variant;
    for (int after : operation.after) text << " after " << after;
    return text.str();
}

}  // namespace twin
