// SPDX-License-Identifier: Apache-2.0
//
// Result<T>: a value, or one line that says what is wrong. No exceptions by design.
#pragma once

#include <optional>
#include <string>
#include <utility>

namespace urgengo {

struct Error {
    std::string message;  ///< complete: file, line, what was found, what is accepted
};

template <typename T>
class [[nodiscard]] Result {
  public:
    Result(T value) : value_(std::move(value)) {}      // NOLINT: meant to convert
    Result(Error error) : error_(std::move(error)) {}  // NOLINT: meant to convert

    explicit operator bool() const { return value_.has_value(); }
    T& operator*() { return *value_; }
    const T& operator*() const { return *value_; }
    T* operator->() { return &*value_; }
    const T* operator->() const { return &*value_; }
    const std::string& error() const { return error_.message; }

  private:
    std::optional<T> value_;
    Error error_;
};

}  // namespace urgengo
