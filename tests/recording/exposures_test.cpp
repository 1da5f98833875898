// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/exposures.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;

namespace {

void check_window(const events::TimeWindow& window, int64_t begin_us, int64_t end_us) {
  CHECK(window.begin_us == begin_us);
  CHECK(window.end_us == end_us);
}

}  // namespace

TEST_CASE("exposures: a stamp is the start, the middle or the end", "[recording]") {
  check_window(exposure_at(1000, 301, Stamp::kStart), 1000, 1301);
  check_window(exposure_at(1000, 301, Stamp::kMiddle), 850, 1151);
  check_window(exposure_at(1000, 301, Stamp::kEnd), 699, 1000);
}

TEST_CASE("exposures: trigger pulses of either level, lost edges left out", "[recording]") {
  // High from 10 to 20, from 30 (its end was lost), from 50 to 60; an edge without partner at 5 and
  // at 70.
  const Triggers triggers{{10, 30, 50, 70}, {5, 20, 60}};
  const auto high = exposures_of(triggers, TriggerLevel::kHigh);
  REQUIRE(high.size() == 2);
  check_window(high[0], 10, 20);
  check_window(high[1], 50, 60);
  const auto low = exposures_of(triggers, TriggerLevel::kLow);
  REQUIRE(low.size() == 3);
  check_window(low[0], 5, 10);
  check_window(low[1], 20, 30);
  check_window(low[2], 60, 70);
  CHECK(exposures_of({}, TriggerLevel::kHigh).empty());
}

TEST_CASE("exposures: a list is written, read, and its faults named by line", "[recording]") {
  const test::TempDir dir;
  write_exposures(dir / "a.csv", {{"0001", -5, 20}, {"a,b", 30, 30}});
  const auto read = read_exposures(dir / "a.csv");
  REQUIRE(read.size() == 2);
  CHECK(read[0].name == "0001");
  CHECK(read[0].start_us == -5);
  CHECK(read[0].end_us == 20);
  CHECK(read[1].name == "a,b");
  dir.write("spaces.csv", "# made by hand\r\n\"x.png\" , 1 , 2\r\n\r\n");
  REQUIRE(read_exposures(dir / "spaces.csv").size() == 1);
  CHECK(read_exposures(dir / "spaces.csv")[0].name == "x.png");
  dir.write("marked.csv", "\xEF\xBB\xBFname,start_us,end_us\nx,1,2\n");
  CHECK(read_exposures(dir / "marked.csv").size() == 1);
  dir.write("marked.csv", "\xEF\xBB\xBFx,1,2\n");
  CHECK(read_exposures(dir / "marked.csv")[0].name == "x");
  const auto message = [&](const std::string& text) -> std::string {
    try {
      read_exposures(dir.write("bad.csv", text));
    } catch (const DataError& error) {
      return error.what();
    }
    return "";
  };
  CHECK_THAT(message("name,start_us,end_us\na,1.5,2\n"), test::naming("bad.csv:2"));
  CHECK_THAT(message("a,1,2\nname,start_us,end_us\n"), test::naming("bad.csv:2"));
  CHECK_THAT(message("a,3,2\n"), test::naming("bad.csv:1: a", "2 us", "duration_us"));
  CHECK_THAT(message("a,1,2\na,3,4\n"), test::naming("bad.csv:2: a", "twice"));
}

TEST_CASE("exposures: lists of spreadsheets and tables of floats, and lengths by the header",
          "[recording]") {
  const test::TempDir dir;
  const auto read = [&](const std::string& text) {
    return read_exposures(dir.write("a.csv", text)).at(0);
  };
  for (const char* text : {"name;start_us;end_us\n00;5000;45000\n", "00,5000.0,45000.000\n",
                           "00\t5000\t45000\n", "frame,begin,end\n00,5000,45000\n",
                           "\xEF\xBB\xBFname,start_us,duration_us\n00,5000,40000\n",
                           "00;5000,0;45000,0\n", "name\tstart_us\tend_us\n00\t5000,0\t45000,0\n",
                           "Name; Start_us; Exposure_us\r\n00; 5000; 40000\r\n"}) {
    CAPTURE(text);
    const NamedExposure row = read(text);
    CHECK(row.name == "00");
    CHECK(row.start_us == 5000);
    CHECK(row.end_us == 45000);
  }
  CHECK(read("a;b,1,2\n").name == "a;b");
  CHECK_THROWS_NAMING(DataError, read("00;12,5;22,5\n"), "a.csv:1", "whole microseconds");
  CHECK_THROWS_NAMING(DataError,
                      read(std::string("0\0,\0"
                                       "5\0",
                                       6)),
                      "a.csv", "UTF-16");
  CHECK_THROWS_NAMING(DataError, read("name,start_ms,end_ms\n00,5,45\n"), "a.csv:1", "start_ms");
  CHECK_THROWS_NAMING(DataError, read("name,start_us,size\n00,5,45\n"), "a.csv:1", "size");
  CHECK_THROWS_NAMING(DataError, read("00,0.005,0.045\n"), "a.csv:1", "whole microseconds");
}
