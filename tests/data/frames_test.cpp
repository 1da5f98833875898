// SPDX-License-Identifier: Apache-2.0
#include "jade/data/frames.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "support/naming.h"

namespace jade::data {
namespace {

using Names = std::vector<std::string>;

TEST_CASE("frames: names are those of the files, and longer where these are alike", "[data]") {
  CHECK(frame_names({"/d/images/00.png", "/d/images/01.png"}) == Names{"00", "01"});
  CHECK(frame_names({"/d/a/00.png", "/d/b/00.png", "/d/b/01.png"}) == Names{"a_00", "b_00", "01"});
  CHECK(frame_names({"/d/a/00.png", "/d/a/00.jpg"}) == Names{"a_00_png", "a_00_jpg"});
  CHECK(frame_names({"/d/a/03_1.png", "/d/a/03_9.png"}) == Names{"03_1", "03_9"});
}

TEST_CASE("frames: names that would be taken for each other are refused, with both", "[data]") {
  CHECK_THROWS_WITH(frame_names({"/c/a/00.png", "/d/a/00.png"}),
                    Catch::Contains("/d/a/00.png") && test::naming("/c/a/00.png"));
  CHECK_THROWS_NAMING(DataError, frame_names({"/d/a/03.png", "/d/a/03_1.png"}), "/d/a/03_1.png",
                      "'03'");
  CHECK_NOTHROW(frame_names({"/d/a/03.png", "/d/a/03_9.png"}));
  CHECK_THROWS_NAMING(DataError, frame_names({"/d/a/05\xff.png"}), "UTF-8");
  CHECK(frame_names({"/d/a/\xc3\xbc.png"}) == Names{"\xc3\xbc"});
}

}  // namespace
}  // namespace jade::data
