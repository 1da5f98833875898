// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace jade {

/// A setting that is a number, or the word "auto" in YAML: found when a program has read its data.
class AutoNumber {
 public:
  AutoNumber(double value) : value_(value) {}  // NOLINT(google-explicit-constructor)

  /// To be found; `fallback` until then.
  static AutoNumber automatic(double fallback) {
    AutoNumber number(fallback);
    number.is_auto_ = true;
    return number;
  }

  /// Sets the field as a configuration does: an auto field keeps its `fallback`.
  void set_auto() { is_auto_ = true; }

  bool is_auto() const { return is_auto_; }
  operator double() const { return value_; }  // NOLINT(google-explicit-constructor)

 private:
  double value_;
  bool is_auto_ = false;
};

}  // namespace jade
