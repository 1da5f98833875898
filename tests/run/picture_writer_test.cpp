// SPDX-License-Identifier: Apache-2.0
#include "jade/run/picture_writer.h"

#include "support/catch.h"

#include <fstream>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/temp_dir.h"

namespace jade::run {
namespace {

TEST_CASE("picture writer: pictures are what they were when they were added", "[run]") {
  const test::TempDir dir;
  torch::Tensor image = torch::zeros({3, 4, 5});
  for (const int64_t limit : {int64_t(1) << 20, int64_t(1)}) {  // all at once; each for itself
    PictureWriter writer(limit);
    for (int k = 0; k < 4; ++k) {
      image.fill_(k / 255.0);
      writer.add(dir / concat(limit, "_", k, ".png"), image);
    }
    writer.begin();
    image.fill_(1);
    writer.wait();
    for (int k = 0; k < 4; ++k) {
      const auto found = imaging::read_image(dir / concat(limit, "_", k, ".png"));
      CHECK(torch::allclose(found, torch::full({3, 4, 5}, k / 255.0f)));
    }
  }
}

TEST_CASE("picture writer: a failure is reported once", "[run]") {
  const test::TempDir dir;
  std::ofstream(dir / "file") << "in the way";
  PictureWriter writer;
  const torch::Tensor image = torch::zeros({3, 4, 5});
  writer.add(dir / "file/a.png", image);
  writer.add(dir / "b.png", image);
  writer.begin();
  CHECK_THROWS_WITH(writer.wait(), Catch::Contains("a.png"));
  CHECK_NOTHROW(writer.wait());
}

TEST_CASE("picture writer: ends when all are written", "[run]") {
  const test::TempDir dir;
  {
    PictureWriter writer;
    for (int k = 0; k < 3; ++k) {
      writer.add(dir / concat(k, ".png"), torch::rand({3, 300, 400}));
    }
    writer.begin();
  }
  for (int k = 0; k < 3; ++k) CHECK(std::filesystem::exists(dir / concat(k, ".png")));
}

}  // namespace
}  // namespace jade::run
