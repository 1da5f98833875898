// SPDX-License-Identifier: Apache-2.0
// Maps arrays, fields or columns of a file to x, y, t and p. Private to this folder.
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

/// Index (0 to 3) of the field x, y, t or p that an array of this name contains, or -1. Names are
/// given without their group, in any case; text in brackets is ignored.
int event_field(const std::string& name);

/// The unit in the name of a time: "t_ns", "timestamp [us]". kAuto if the name contains none.
TimeUnit unit_in_name(const std::string& name);

/// Positions of a time's whole seconds and of its nanoseconds, as in ROS: "secs" and "nsecs", also
/// after a common prefix ("stamp.sec", "stamp.nanosec"). No value for other names.
std::optional<std::pair<size_t, size_t>> time_in_two(const std::vector<std::string>& names);

/// Positions of x, y, t and p.
using Columns = std::array<size_t, 4>;
constexpr Columns kTimeFirst{1, 2, 0, 3}, kPlaceFirst{0, 1, 2, 3};

/// Columns of x, y, t and p by name; other names are ignored. If one of the four is missing, names
/// in words count too: "row", "x_coordinate", "px". No value if one is still missing, or appears
/// twice.
std::optional<Columns> named_columns(const std::vector<std::string>& names);

/// Four numbers per row.
using Row = std::array<double, 4>;

/// Which of two columns to prefer if both could be the time.
enum class Preference {
  kFirst,   ///< the first column, because text lists begin with the time
  kLarger,  ///< the one with the larger numbers
};

/// Finds the columns of x, y, t and p in rows without names. p is the column of 0 and 1, or -1 and
/// 1 (the last column if that qualifies). t is the column that never decreases or, if times are
/// unordered, the one beyond the range of coordinates or the only one with fractions. x precedes y.
/// Too few rows are inconclusive: they are read as t x y p or x y t p.
/// @param rows   some rows of the list, in its order
/// @param where  begins the message
/// @param mend   ends it
/// @throws DataError naming the ranges of the columns if several assignments are possible.
Columns likely_columns(const std::vector<Row>& rows, Preference preference,
                       const std::string& where, const std::string& mend);

}  // namespace jade::events
