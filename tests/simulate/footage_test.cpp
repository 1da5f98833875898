// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/footage.h"

#include "support/catch.h"

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
