// SPDX-License-Identifier: Apache-2.0
#include "jade/train/exposure_poses.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/data/dataset.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

double largest(const torch::Tensor& t) { return t.abs().max().item<double>(); }

torch::Tensor pose_of(const data::Exposure& exposure, size_t k) {
  return geometry::to_tensor(exposure.poses[k]).to(torch::kFloat32);
}

}  // namespace

TEST_CASE("exposure poses: start on the line between the exposure's ends, both kinds", "[train]") {
  const test::TinyScene scene;
  const data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  const train::ExposurePoses linear(train::PosePath::kLinear, dataset.train),
      cubic(train::PosePath::kCubic, dataset.train);
  const torch::Tensor of_linear = linear.forward(1, torch::kCPU);
  CHECK(largest(of_linear[0] - pose_of(dataset.train[1], 0)) < 1e-5);
  CHECK(largest(of_linear[8] - pose_of(dataset.train[1], 8)) < 1e-5);
  CHECK(largest(of_linear - cubic.forward(1, torch::kCPU)) < 1e-5);
}
