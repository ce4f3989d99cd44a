// SPDX-License-Identifier: Apache-2.0
#include "tools/discover/names.h"

#include <cxxabi.h>
#include <fnmatch.h>

#include <algorithm>
#include <cstdlib>

namespace urgengo::discover {
namespace {

constexpr std::size_t kMaxReadable = 32;

bool is_printable(char c) {
    return c >= ' ' && c <= '~';
}

bool is_word(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

std::string demangled(const std::string& mangled) {
    int status = 0;
    char* text = abi::__cxa_demangle(mangled.c_str(), nullptr, nullptr, &status);
    std::string result = text ? text : mangled;
    std::free(text);
    return result;
}

}  // namespace

std::string short_kernel_name(const std::string& mangled) {
    std::string flat;  // outside all <> and ()
    int depth = 0;
    for (const char c : demangled(mangled)) {
        if (c == '<' || c == '(') ++depth;
        // "(anonymous namespace)::f" goes on behind its parenthesis, "f(int)" does not.
        if (depth == 0) flat += c;
        if (c == '>' || c == ')') --depth;
    }
    // The return type and the namespaces lie before the last word.
    std::size_t end = flat.size();
    while (end > 0 && !is_word(flat[end - 1])) --end;
    std::size_t begin = end;
    while (begin > 0 && is_word(flat[begin - 1])) --begin;
    return begin == end ? mangled : flat.substr(begin, end - begin);
}

std::string readable(const std::string& text) {
    std::string name;
    for (const char c : text) {
        const bool keep = is_word(c) || c == '-';
        if (keep) name += c;
        if (!keep && !name.empty() && name.back() != '_') name += '_';
    }
    name.resize(std::min(name.size(), kMaxReadable));
    while (!name.empty() && name.back() == '_') name.pop_back();
    return name.empty() ? "chain" : name;
}

std::string unique_name(const std::string& name, std::vector<std::string>& taken) {
    std::string candidate = name;
    for (int i = 2; std::find(taken.begin(), taken.end(), candidate) != taken.end(); ++i) {
        candidate = name + "_" + std::to_string(i);
    }
    taken.push_back(candidate);
    return candidate;
}

std::string escape_glob(std::string_view text) {
    std::string glob;
    for (const char c : text) {
        if (c == '*' || c == '?' || c == '[' || c == '\\') glob += '\\';
        glob += is_printable(c) ? c : '?';
    }
    return glob;
}

bool matches_glob(const std::string& glob, std::string_view text) {
    return fnmatch(glob.c_str(), std::string(text).c_str(), 0) == 0;
}

std::string yaml_quoted(std::string_view text) {
    std::string quoted = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') quoted += '\\';
        quoted += is_printable(c) ? c : '?';
    }
    return quoted + "\"";
}

std::string printable(std::string_view text) {
    std::string result(text);
    std::replace_if(
        result.begin(), result.end(), [](char c) { return !is_printable(c); }, '?');
    return result;
}

}  // namespace urgengo::discover
