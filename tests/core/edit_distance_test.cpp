// SPDX-License-Identifier: Apache-2.0
#include "jade/core/edit_distance.h"

#include "support/catch.h"

namespace jade {

TEST_CASE("edit_distance: letters added, left out, replaced, and two exchanged", "[core]") {
  CHECK(edit_distance("width", "width") == 0);
  CHECK(edit_distance("widht", "width") == 1);
  CHECK(edit_distance("", "fx") == 2);
  CHECK(edit_distance("distorsion", "distortion") == 1);
  CHECK(edit_distance("location", "rotation") == 2);
}

TEST_CASE("edit_distance: a misspelt word has one slip, and one more per ten letters", "[core]") {
  const std::vector<std::string> words = {"width", "rotation", "distortioncoefficients", "k1"};
  CHECK(misspelt("widht", words) == "width");
  CHECK(misspelt("rotatoin", words) == "rotation");
  CHECK(misspelt("distorsioncoeficients", words) == "distortioncoefficients");
  for (const char* other : {"width", "location", "k2", "weights", "camera"})
    CHECK(misspelt(other, words).empty());
}

}  // namespace jade
