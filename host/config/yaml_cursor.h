// SPDX-License-Identifier: Apache-2.0
//
// Reads a YAML document of known shape: a cursor is one value, the line where it is written, and
// the path that leads to it, so that every complaint can say "file:line: path: found, accepted".
// The first mismatch is noted and everything read after it is a default value, as in json_cursor.h.
#pragma once

#include <yaml-cpp/yaml.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"
#include "host/config/names.h"

namespace urgengo::config {

/// The first thing found wrong with a document; empty while there is none.
struct YamlFault {
    std::string file;     ///< as errors name it
    std::string message;  ///< one line
};

/// @errors file, line and column of a syntax error; none or several documents in the file
Result<YAML::Node> parse_yaml(const std::string& text, const std::string& file);

class YamlCursor {
  public:
    /// The document's root. `fault` must outlive every cursor made from this one.
    YamlCursor(const YAML::Node& root, YamlFault& fault);

    /// This must be a map that has these keys, each at most once, and no others.
    void accept_keys(const std::vector<std::string>& keys) const;

    /// The value of `key`; a fault if the map does not have it.
    YamlCursor at(const std::string& key) const;
    /// The same, but nothing (and no fault) if the key is absent.
    std::optional<YamlCursor> find(const std::string& key) const;
    bool is_list() const { return node_.IsDefined() && node_.IsSequence(); }
    /// The elements of a list.
    std::vector<YamlCursor> items(const std::string& accepted) const;

    /// A scalar as written; empty, and a fault, for anything else.
    std::string text(const std::string& accepted) const;
    /// @param note  ends the text of what is accepted: " (milliseconds)"
    double positive_number(double max, const std::string& note) const;
    double number(double min, double max) const;
    std::int64_t integer(std::int64_t min, std::int64_t max, const std::string& note) const;

    bool on_off() const;  ///< on, off, or YAML's own true, false

    template <typename E>
    E word() const {
        const std::string accepted = all_words<E>();
        const auto value = from_word<E>(text(accepted));
        if (!value) fail(accepted);
        return value.value_or(E{});
    }

    /// Notes that this value is not what is accepted, unless something was noted before.
    void fail(const std::string& accepted) const;
    /// Notes any other complaint about this value.
    void complain(const std::string& complaint) const;

    int line() const { return line_; }

  private:
    YamlCursor(YAML::Node node, YamlFault* fault, std::string path, int line);

    std::string child_path(const std::string& key) const;

    YAML::Node node_;  ///< undefined below a fault
    YamlFault* fault_;
    std::string path_;  ///< empty for the root
    int line_;          ///< from 1; of the key, for a map's value
};

}  // namespace urgengo::config
