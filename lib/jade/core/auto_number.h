// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace jade {

/// A setting that is a number, or the word "auto" in YAML: the program then computes the number
/// from its data.
template <class T>
class Auto {
 public:
  Auto(T value) : value_(value) {}  // NOLINT(google-explicit-constructor)

  /// An auto value; reads as `fallback` until the program has computed the number.
  static Auto automatic(T fallback) {
    Auto number(fallback);
    number.is_auto_ = true;
    return number;
  }

  /// Sets the field as a configuration does: an auto field keeps its `fallback`.
  void set_auto() { is_auto_ = true; }

  bool is_auto() const { return is_auto_; }
  operator T() const { return value_; }  // NOLINT(google-explicit-constructor)

 private:
  T value_;
  bool is_auto_ = false;
};

using AutoNumber = Auto<double>;
using AutoCount = Auto<int64_t>;

}  // namespace jade
