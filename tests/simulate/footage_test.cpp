// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/footage.h"

#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/temp_dir.h"

using namespace jade;

TEST_CASE("footage: stored frames follow one another by the numbers in their names", "[simulate]") {
  const test::TempDir dir;
  std::string frames;
  for (int i = 0; i < 11; ++i) {
    imaging::write_image(dir / concat("film/f", i, ".png"), torch::full({3, 4, 6}, 0.05 * (i + 1)));
    frames +=
        concat(i == 0 ? "" : ",", "{\"file_path\":\"f", i,
               ".png\",\"transform_matrix\":", "[[1,0,0,", i, "],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}");
  }
  dir.write("film/transforms.json", "{\"fl_x\":6,\"w\":6,\"h\":4,\"frames\":[" + frames + "]}");
  const simulate::StoredFootage footage(dir / "film", 10, 0.01);
  CHECK(footage.duration_us() == 1000000);
  world::SharpFrame frame;
  for (int i = 0; i < 11; ++i) {
    footage.frame(100000 * i, 1, frame);
    CHECK(frame.rgb[0] == Approx(0.05 * (i + 1)).margin(4e-3));
    CHECK(geometry::centre(footage.pose(1e5 * i))[0] == Approx(i).margin(1e-6));
  }
}

TEST_CASE("footage: between stored frames logarithms change evenly, and so does the camera",
          "[simulate]") {
  const test::TempDir dir;
  for (int i = 0; i < 2; ++i)
    imaging::write_image(dir / concat("film/f", i, ".png"),
                         torch::full({3, 4, 6}, (51 + 102 * i) / 255.0));
  dir.write("film/transforms.json",
            "{\"fl_x\":6,\"w\":6,\"h\":4,\"frames\":["
            "{\"file_path\":\"f0.png\",\"transform_matrix\":"
            "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]},"
            "{\"file_path\":\"f1.png\",\"transform_matrix\":"
            "[[1,0,0,4],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}");
  simulate::StoredFootage footage(dir / "film", 10, 0.01);
  world::SharpFrame frame;
  for (const double share : {0.25, 0.5, 0.9}) {
    const auto t_us = static_cast<int64_t>(1e5 * share);
    footage.frame(t_us, 1, frame);
    CHECK(frame.rgb[0] == Approx(0.21 * std::pow(0.61 / 0.21, share) - 0.01).epsilon(1e-5));
    CHECK(geometry::centre(footage.pose(static_cast<double>(t_us)))[0] == Approx(4 * share));
    CHECK(footage.next_us(frame, t_us, 1000000) == 100000);
    CHECK(footage.next_us(frame, t_us, t_us + 10) == t_us + 10);
  }
}
