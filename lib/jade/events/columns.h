// SPDX-License-Identifier: Apache-2.0
// Which array, field or column of a file holds what of an event. Not for use outside this folder.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "jade/events/time_unit.h"

namespace jade::events {

constexpr const char* kFieldNames[4] = {"x", "y", "t", "p"};

/// Which of x, y, t, p (0 to 3) an array of this name holds, or -1. Names without their group, in
/// any case; what follows in brackets is no part of them.
int event_field(const std::string& name);

/// The unit that the name of a time says: "t_ns", "timestamp [us]". kAuto where it says none.
TimeUnit unit_in_name(const std::string& name);

/// Places of a time in whole seconds and in the nanoseconds to add, as ROS has them: "secs" and
/// "nsecs", also behind one and the same name ("stamp.sec", "stamp.nanosec"). None in other names.
std::optional<std::pair<size_t, size_t>> time_in_two(const std::vector<std::string>& names);

/// Places of x, y, t and p.
using Columns = std::array<size_t, 4>;
constexpr Columns kTimeFirst{1, 2, 0, 3}, kPlaceFirst{0, 1, 2, 3};

/// Columns of x, y, t and p by name; other names are ignored. None if one of the four is missing or
/// appears twice.
std::optional<Columns> named_columns(const std::vector<std::string>& names);

/// Four numbers a row.
using Row = std::array<double, 4>;

/// Which of two columns that could both be the time is it.
enum class Preference {
  kFirst,   ///< the first column, as lists in text begin with the time
  kLarger,  ///< the one with the larger numbers
};

/// Columns of x, y, t and p in rows without names: p is the column of 0 and 1, or -1 and 1,
/// (the last if that is one), t is the one that never decreases, or, in times out of order, the one
/// that no coordinate reaches or that alone has fractions; x comes before y. Few rows tell nothing:
/// they are t x y p or x y t p.
/// @param rows   some rows of the list, in its order
/// @param where  begins the message
/// @param mend   ends it
/// @throws DataError naming the ranges of the columns where they can be read in several ways.
Columns likely_columns(const std::vector<Row>& rows, Preference preference,
                       const std::string& where, const std::string& mend);

}  // namespace jade::events
