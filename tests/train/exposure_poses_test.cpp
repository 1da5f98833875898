// SPDX-License-Identifier: Apache-2.0
#include "jade/train/exposure_poses.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/data/dataset.h"
#include "support/poses.h"
#include "support/tiny_run.h"

using namespace jade;

TEST_CASE("exposure poses: start on the line between the exposure's ends, both kinds", "[train]") {
  const test::TinyScene scene;
  const data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  const train::ExposurePoses linear(train::PosePath::kLinear, dataset.train),
      cubic(train::PosePath::kCubic, dataset.train);
  const torch::Tensor of_linear = linear.forward(1, torch::kCPU);
  CHECK(test::largest(of_linear[0] - test::pose_of(dataset.train[1], 0)) < 1e-5);
  CHECK(test::largest(of_linear[8] - test::pose_of(dataset.train[1], 8)) < 1e-5);
  CHECK(test::largest(of_linear - cubic.forward(1, torch::kCPU)) < 1e-5);
}
