// SPDX-License-Identifier: Apache-2.0
//
// Reads a JSON document of known shape without exceptions: a cursor is one value and the path that
// leads to it. The first mismatch is noted, everything read after it is a default value, and the
// caller asks once, at the end, whether all went well.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/result.h"
#include "host/config/names.h"

namespace urgengo::config {

/// The first thing found wrong with a document; empty while there is none.
struct JsonFault {
    std::string file;     ///< as errors name it
    std::string message;  ///< "file: $.a.b[3]: found ..., accepted: ..."
};

/// Parses `text`. The decimal point is '.', whatever locale the program has set.
/// @errors file, line and column of a syntax error
Result<nlohmann::json> parse_json(std::string_view text, const std::string& file);

class JsonCursor {
  public:
    /// The document's root. Both must outlive every cursor made from this one.
    JsonCursor(const nlohmann::json& root, JsonFault& fault);

    /// The member `key` of an object; a fault if there is none.
    JsonCursor at(std::string_view key) const;
    /// The same, but nothing (and no fault) if the member is absent.
    std::optional<JsonCursor> find(std::string_view key) const;
    /// The elements of an array.
    std::vector<JsonCursor> items() const;

    std::string text() const;
    std::string name() const;  ///< a text that is not empty
    std::int64_t integer(std::int64_t min, std::int64_t max) const;
    double number(double min, double max) const;
    bool boolean() const;
    std::uint64_t hash()
        const;  ///< written as 16 hexadecimal digits, which JSON numbers cannot hold
    nanoseconds time_ns(std::int64_t min_ns, std::int64_t max_ns) const;

    template <typename E>
    E word() const {
        const auto value = from_word<E>(text());
        if (!value) fail("one of " + all_words<E>());
        return value.value_or(E{});
    }

    /// Notes that this value is not what is accepted, unless something was noted before.
    void fail(const std::string& accepted) const;

  private:
    JsonCursor(const nlohmann::json* value, JsonFault* fault, std::string path);

    const nlohmann::json* value_;  ///< null below a fault
    JsonFault* fault_;
    std::string path_;
};

}  // namespace urgengo::config
