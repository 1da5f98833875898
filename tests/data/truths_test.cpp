// SPDX-License-Identifier: Apache-2.0
#include "jade/data/truths.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::data {
namespace {

/// One exposure of 8 ms named "00", and a test view at its middle and one long after it.
Dataset one_exposure(const test::TempDir& dir) {
  Dataset dataset;
  dataset.root = dir.path();
  Exposure exposure;
  exposure.name = "00";
  exposure.blurry = torch::rand({3, 4, 6});
  exposure.t_start_us = 1000;
  exposure.t_end_us = 9000;
  dataset.train.push_back(exposure);
  for (const int64_t t_us : {5000, 90000}) {
    SharpView view;
    view.name = std::to_string(t_us);
    view.image = torch::rand({3, 4, 6});
    view.t_us = t_us;
    dataset.test.push_back(view);
  }
  return dataset;
}

TEST_CASE("truth_of: the frame in sharp/, else the test view of mid-exposure", "[data]") {
  const test::TempDir dir;
  Dataset dataset = one_exposure(dir);
  const Exposure& exposure = dataset.train[0];
  REQUIRE(truth_of(dataset, exposure));
  CHECK(truth_of(dataset, exposure)->name == "5000");
  const torch::Tensor sharp = torch::rand({3, 4, 6});
  imaging::write_image(dir / "sharp/00.npy", sharp);
  REQUIRE(truth_of(dataset, exposure));
  CHECK(truth_of(dataset, exposure)->name == "sharp/00");
  CHECK(torch::equal(truth_of(dataset, exposure)->image, sharp));
  dataset.monochrome = true;
  const torch::Tensor gray = truth_of(dataset, exposure)->image;
  CHECK(torch::equal(gray[0], gray[2]));
  Exposure other = exposure;
  other.name = "01";
  other.t_start_us = 20000;
  other.t_end_us = 28000;
  CHECK_FALSE(truth_of(dataset, other));
}

TEST_CASE("truth_of: a frame of another size is refused", "[data]") {
  const test::TempDir dir;
  const Dataset dataset = one_exposure(dir);
  imaging::write_image(dir / "sharp/00.npy", torch::rand({3, 5, 6}));
  CHECK_THROWS_WITH(truth_of(dataset, dataset.train[0]),
                    Catch::Contains("sharp/00.npy") && test::naming("blurry frame"));
}

}  // namespace
}  // namespace jade::data
