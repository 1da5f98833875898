// SPDX-License-Identifier: Apache-2.0
#include "jade/train/view.h"

#include "support/catch.h"

#include <set>
#include <torch/types.h>

#include "jade/core/random.h"
#include "jade/events/exposure_maps.h"
#include "jade/imaging/reblur.h"
#include "train/bench.h"

using namespace jade;

TEST_CASE("views: Eq. (7) takes the paper's c, and with 0 the calibrated one", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto kernel = [&](double contrast) {
    options.route.reblur_contrast = contrast;
    return train::prepare_views(dataset, options, torch::kCPU).front().reblur_kernel;
  };
  options.events.threshold_positive = 0.3;
  options.events.threshold_negative = 0.2;
  const data::Exposure& exposure = dataset.train.front();
  const auto voxel = events::map_exposure(exposure.events, {exposure.t_start_us, exposure.t_end_us},
                                          6, {exposure.camera.height, exposure.camera.width})
                         .voxel;
  CHECK(kernel(1).equal(imaging::reblur_kernel(voxel, 1)));
  CHECK(kernel(0).equal(imaging::reblur_kernel(voxel, 0.25 * voxel.v_max)));
  CHECK_FALSE(kernel(0).equal(kernel(1)));
}

TEST_CASE("views: cameras, moments, weights and EDI are those of the quadrature", "[train]") {
  using geometry::QuadratureRule;
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto first = [&](QuadratureRule rule, int64_t samples) {
    options.exposure = {rule, samples};
    return train::prepare_views(dataset, options, torch::kCPU).front();
  };
  const train::View printed = first(QuadratureRule::kEqual, 9);
  CHECK_FALSE(printed.weights.defined());
  CHECK_FALSE(printed.edi_log_gain.defined());
  const train::View trapezoid = first(QuadratureRule::kTrapezoid, 9);
  CHECK(trapezoid.weights.sum().item<double>() == Approx(1));
  CHECK(trapezoid.cameras.camera_from_world.equal(printed.cameras.camera_from_world));
  const train::View fine = first(QuadratureRule::kTrapezoid, 17);
  CHECK(fine.edi_factors.size(0) == 17);
  CHECK(torch::allclose(fine.cameras.camera_from_world.slice(0, 0, 17, 2),
                        printed.cameras.camera_from_world, 0, 1e-6));
  CHECK_FALSE(torch::allclose(fine.cameras.camera_from_world[1],
                              printed.cameras.camera_from_world[1], 0, 1e-6));
  const train::View drawn = first(QuadratureRule::kJittered, 9);
  CHECK(drawn.edi_log_gain.size(0) == 65);
  CHECK(drawn.u[0].item<double>() == Approx(0.5 / 9));
}

TEST_CASE("near plane: 0.2, or half of what a small scene's nearest is away, unless given",
          "[train]") {
  data::Dataset dataset;
  dataset.near = 1;
  CHECK(train::near_plane({}, dataset) == 0.2);
  dataset.near = 0.1;
  CHECK(train::near_plane({}, dataset) == 0.05);
  train::SplatOptions given;
  given.near_plane = 0.7;
  CHECK(train::near_plane(given, dataset) == 0.7);
  // What versions without the key drew.
  CHECK(train::render_options({}).near_plane == 0.01);
}
