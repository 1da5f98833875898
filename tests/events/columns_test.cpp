// SPDX-License-Identifier: Apache-2.0
#include "jade/events/columns.h"

#include "support/catch.h"

#include <algorithm>
#include <functional>

#include "jade/core/error.h"
#include "support/naming.h"

using namespace jade::events;

namespace {

/// An event whose x, y, t and p cannot be confused.
Row event(int i) {
  return {double(i * 37 % 64), double(i * 23 % 48), 1e6 + 100.0 * i, double(i * i % 3 == 1)};
}

/// Events with column k of the list holding field order[k].
std::vector<Row> rows_in(const std::array<size_t, 4>& order, int count = 200) {
  std::vector<Row> out;
  for (int i = 0; i < count; ++i) {
    const Row e = event(i);
    out.push_back({e[order[0]], e[order[1]], e[order[2]], e[order[3]]});
  }
  return out;
}

std::string refusal(const std::vector<Row>& rows) {
  try {
    likely_columns(rows, Preference::kFirst, "a.csv", "name them");
  } catch (const jade::DataError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("columns: values determine the time and the polarity in any order, x comes before y",
          "[events]") {
  std::array<size_t, 4> order{0, 1, 2, 3};
  do {
    const auto place = [&](size_t field) {
      return size_t(std::find(order.begin(), order.end(), field) - order.begin());
    };
    Columns expected{place(0), place(1), place(2), place(3)};
    if (expected[0] > expected[1]) std::swap(expected[0], expected[1]);
    for (const Preference preference : {Preference::kFirst, Preference::kLarger}) {
      INFO(order[0] << order[1] << order[2] << order[3]);
      CHECK(likely_columns(rows_in(order), preference, "", "") == expected);
    }
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST_CASE("columns: times out of order are those that no coordinate reaches, or have fractions",
          "[events]") {
  auto rows = rows_in({0, 1, 2, 3});
  std::reverse(rows.begin(), rows.end());
  CHECK(likely_columns(rows, Preference::kFirst, "", "") == Columns{0, 1, 2, 3});
  for (Row& row : rows) row[2] = 1e-6 * row[2] + 0.05;
  CHECK(likely_columns(rows, Preference::kFirst, "", "") == Columns{0, 1, 2, 3});
}

TEST_CASE("columns: what can be read in several ways is refused with the ranges", "[events]") {
  auto rows = rows_in({0, 1, 2, 3});
  for (Row& row : rows) row[3] = 7;
  CHECK_THAT(refusal(rows), jade::test::naming("a.csv", "0/1 or -1/+1") &&
                                jade::test::naming("column 3") && jade::test::naming("name them"));
  rows = rows_in({0, 3, 3, 2});
  CHECK_THAT(refusal(rows), jade::test::naming("0/1 or -1/+1"));
  rows = rows_in({0, 1, 3, 2});
  for (Row& row : rows) row[0] = 5e6;
  CHECK_THAT(refusal(rows), jade::test::naming("pixels"));
  rows = rows_in({0, 1, 3, 0});
  CHECK_THAT(refusal(rows), jade::test::naming("times"));
}

TEST_CASE("columns: a few damaged polarities do not hide their column", "[events]") {
  auto rows = rows_in({2, 0, 1, 3});
  rows[100][3] = 5;
  CHECK(likely_columns(rows, Preference::kFirst, "", "") == kTimeFirst);
  rows = rows_in({0, 1, 3, 2});
  rows[100][2] = 5;
  CHECK(likely_columns(rows, Preference::kFirst, "", "") == Columns{0, 1, 3, 2});
}

TEST_CASE("columns: names in any case, with units, beside other names", "[events]") {
  CHECK(named_columns({"X", "y", "Polarity", "Timestamp [us]"}) == Columns{0, 1, 3, 2});
  CHECK(named_columns({"", "x", "y", "p", "t_ns", "label"}) == Columns{1, 2, 4, 3});
  CHECK_FALSE(named_columns({"x", "y", "p"}));
  CHECK_FALSE(named_columns({"x", "x", "y", "t", "p"}));
  CHECK(unit_in_name("t_ns") == TimeUnit::kNs);
  CHECK(unit_in_name("timestamp [us]") == TimeUnit::kUs);
  CHECK(unit_in_name("Time(s)") == TimeUnit::kS);
  CHECK(named_columns({"timestamp_ms", "x", "y", "p"}) == Columns{1, 2, 0, 3});
  CHECK(named_columns({"time", "row", "column", "polarity"}) == Columns{2, 1, 0, 3});
  CHECK(named_columns({"t_us", "py", "px", "pol"}) == Columns{2, 1, 0, 3});
  CHECK(named_columns({"x_coordinate", "yCoord", "time_stamp", "sign"}) == Columns{0, 1, 2, 3});
  CHECK(named_columns({"pixel_x", "pos_y", "us", "is_on"}) == Columns{0, 1, 2, 3});
  CHECK(named_columns({"index", "t", "x", "y", "p", "row"}) == Columns{2, 3, 1, 4});
  CHECK_FALSE(named_columns({"t", "x", "row", "y_pos", "p"}));
  CHECK_FALSE(named_columns({"t", "a", "b", "p"}));
  CHECK(event_field("times_usec") == 2);
  CHECK(event_field("x_ms") == -1);
  CHECK(unit_in_name("timestamp_ms") == TimeUnit::kMs);
  CHECK(unit_in_name("t [ms]") == TimeUnit::kMs);
  CHECK(unit_in_name("Time ( seconds )") == TimeUnit::kS);
  for (const char* name : {"t", "ts", "timestamps", "s", "pos"})
    CHECK(unit_in_name(name) == TimeUnit::kAuto);
}
