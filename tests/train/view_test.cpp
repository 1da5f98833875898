// SPDX-License-Identifier: Apache-2.0
#include "jade/train/view.h"

#include "support/catch.h"

#include <set>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/events/exposure_maps.h"
#include "jade/events/voxel.h"
#include "jade/imaging/reblur.h"
#include "jade/train/step_feed.h"
#include "jade/train/view_memory.h"
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

TEST_CASE("views: each has the events of its own exposure, though they are summed ahead",
          "[train]") {
  test::TinyDatasetOptions data;
  data.exposures = 7;
  const test::TinyScene scene(data);
  const train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const std::vector<train::View> views = train::prepare_views(dataset, options, torch::kCPU);
  REQUIRE(views.size() == 7);
  for (size_t i = 0; i < views.size(); ++i) {
    const data::Exposure& exposure = dataset.train[i];
    const events::ExposureMaps maps =
        events::map_exposure(exposure.events, {exposure.t_start_us, exposure.t_end_us}, 6,
                             {exposure.camera.height, exposure.camera.width});
    CHECK(views[i].name == exposure.name);
    CHECK(views[i].density.equal(maps.density));
    CHECK(views[i].psi.equal(events::polarity_projection(maps.voxel.values)));
    CHECK_FALSE(views[i].density.equal(views[(i + 1) % 7].density));
  }
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
  const train::View trapezoid = first(QuadratureRule::kTrapezoid, 9);
  CHECK(trapezoid.weights.sum().item<double>() == Approx(1));
  CHECK(trapezoid.cameras.camera_from_world.equal(printed.cameras.camera_from_world));
  const train::View fine = first(QuadratureRule::kTrapezoid, 17);
  CHECK(fine.edi_factors.size(0) == 17);
  CHECK(torch::allclose(fine.cameras.camera_from_world.slice(0, 0, 17, 2),
                        printed.cameras.camera_from_world, 0, 1e-6));
  CHECK_FALSE(torch::allclose(fine.cameras.camera_from_world[1],
                              printed.cameras.camera_from_world[1], 0, 1e-6));
}

TEST_CASE("views: objective.edi_contrast leaves both restorations as they are", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto view = [&] { return train::prepare_views(dataset, options, torch::kCPU)[1]; };
  const train::View plain = view();
  CHECK_FALSE(plain.taught_factors.defined());
  options.objective.edi_contrast = 1.5;
  const train::View taught = view();
  CHECK(taught.restorations.edi.equal(plain.restorations.edi));
  options.objective.edi_contrast = 1;
  options.events.threshold_positive = 1.5 * options.events.threshold_positive;
  options.events.threshold_negative *= 1.5;
  // taught_factors are float16.
  CHECK(torch::allclose(taught.taught_factors.to(torch::kFloat32), view().edi_factors, 1e-3));
}

TEST_CASE(
    "views: at a pose the target reads what is restored there, at the middle what it always did",
    "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  options.route.reblur_contrast = 0;
  options.events.threshold_negative = 0.3;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const train::View view = train::prepare_views(dataset, options, torch::kCPU)[1];
  const data::Exposure& exposure = dataset.train[1];
  const events::TimeWindow span{exposure.t_start_us, exposure.t_end_us};
  const events::ImageSize size{exposure.camera.height, exposure.camera.width};
  const auto voxel = events::map_exposure(exposure.events, span, 6, size).voxel;
  const auto counts = events::count_windows(exposure.events, span, 4, size);
  restore::Restorer network(options.efnet);
  const double rounding = 5e-4;  // of float16 below 1
  for (int64_t k = 0; k < 9; ++k) {
    INFO(k);
    const train::View at = train::at_pose(view, k, options);
    const double u = double(k) / 8;
    CHECK(torch::allclose(
        at.restorations.efnet,
        network.restore(exposure.blurry, counts.positive - counts.negative, {u})[0], 0, rounding));
    CHECK(torch::allclose(at.restorations.edi, exposure.blurry * view.edi_factors[k]));
    CHECK(at.psi.equal(events::polarity_projection(voxel.values, u)));
    CHECK(at.reblur_kernel.equal(imaging::reblur_kernel(voxel, 0.25 * voxel.v_max, u)));
    CHECK_FALSE(at.fixed_target.defined());
    CHECK_FALSE(at.restored_poses.efnet.defined());
  }
  CHECK_FALSE(torch::allclose(view.restorations.efnet,
                              train::at_pose(view, 0, options).restorations.efnet, 0, rounding));
  const train::View middle = train::at_pose(view, 4, options);
  CHECK(middle.restorations.edi.equal(view.restorations.edi));
  CHECK(torch::allclose(middle.restorations.efnet, view.restorations.efnet, 0, rounding));
  CHECK(middle.psi.equal(view.psi));
  CHECK(middle.reblur_kernel.equal(view.reblur_kernel));
  CHECK_THROWS_AS(train::at_pose(view, 9, options), ContractError);
}

TEST_CASE("views: constants go to the device kind by kind as far as they fit", "[train][cuda]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  options.objective.target = losses::Target::kEfnet;
  options.objective.edi_contrast = 1.3;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const std::vector<train::View> all = train::prepare_views(dataset, options, torch::kCUDA);
  CHECK((all[1].blurry.is_cuda() && all[1].taught_factors.is_cuda() &&
         all[1].restored_poses.efnet.is_cuda()));
  // Bytes that hold the frames alone, and nothing.
  const auto frames = static_cast<int64_t>(3 * all.size() * all[0].blurry.nbytes());
  for (const int64_t most : {frames, int64_t{0}}) {
    INFO(most);
    std::vector<train::View> some = all;
    for (train::View& view : some) {
      view.blurry_moments = {};
      view.blurry = view.blurry.cpu();
      view.taught_factors = view.taught_factors.cpu();
      view.restored_poses.efnet = view.restored_poses.efnet.cpu();
    }
    train::place_constants(options, torch::kCUDA, most, some);
    CHECK(some[1].blurry.is_cuda() == (most > 0));
    CHECK(some[1].blurry_moments.mean.defined() == (most > 0));
    CHECK_FALSE(some[1].taught_factors.is_cuda());
    CHECK_FALSE(some[1].restored_poses.efnet.is_cuda());
    for (const int64_t k : {0, 3, 8}) {
      const std::array<int64_t, 3> poses{k, 1, 2};
      const auto inputs = [&](const train::View& view) {
        train::StepInputs in;
        in.view = train::at_pose(train::with_frame(view, torch::kCUDA), k, options);
        train::pick_factors(poses.data(), /*stride=*/1, &in);
        return in;
      };
      const train::StepInputs a = inputs(all[1]), b = inputs(some[1]);
      CHECK(a.view.blurry.equal(b.view.blurry));
      CHECK(a.view.blurry_moments.square.equal(b.view.blurry_moments.square));
      CHECK(a.view.fixed_target.equal(b.view.fixed_target));
      CHECK(a.edi_factors.gray.equal(b.edi_factors.gray));
      CHECK(a.edi_factors.simulation.equal(b.edi_factors.simulation));
    }
  }
  options.objective.target = losses::Target::kRouted;
  std::vector<train::View> routed = all;
  routed[1].blurry = routed[1].blurry.cpu();
  train::place_constants(options, torch::kCUDA, 0, routed);
  CHECK(routed[1].blurry.is_cuda());
}

TEST_CASE("views: of three restored poses each is the one that all would give", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const train::View all = train::prepare_views(dataset, options, torch::kCPU)[1];
  train::RunOptions three = options;
  three.objective.restored_poses = losses::RestoredPoses::kThree;
  const train::View some = train::prepare_views(dataset, three, torch::kCPU)[1];
  CHECK(some.restored_poses.efnet.size(0) == 3);
  CHECK(train::restored_times(three) == std::vector<double>{0, 0.5, 1});
  for (const int64_t k : {0, 4, 8}) {
    const train::View a = train::at_pose(all, k, options), b = train::at_pose(some, k, three);
    CHECK(torch::allclose(a.restorations.efnet, b.restorations.efnet, 0, 1e-3));
    CHECK(a.restorations.edi.equal(b.restorations.edi));
    CHECK(a.psi.equal(b.psi));
    CHECK(a.reblur_kernel.equal(b.reblur_kernel));
  }
  three.exposure.samples = 17;
  CHECK(train::restored_every(three) == 8);
  three.objective.restored_poses = losses::RestoredPoses::kNine;
  CHECK(train::restored_times(three).size() == 9);
  three.exposure.samples = 11;
  CHECK_THROWS_WITH(train::validate(three), Catch::Contains("exposure.samples"));
}

TEST_CASE("views: a fixed target at a pose is made of the restorations there", "[train]") {
  using losses::Target;
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto at = [&](Target target) {
    options.objective.target = target;
    return train::at_pose(train::prepare_views(dataset, options, torch::kCPU).front(), 7, options);
  };
  const train::View mean = at(Target::kMean);
  CHECK(
      torch::allclose(mean.fixed_target, 0.5 * (mean.restorations.edi + mean.restorations.efnet)));
  CHECK_FALSE(mean.restored_poses.psi.defined());
  const train::View efnet = at(Target::kEfnet), edi = at(Target::kEdi);
  CHECK(efnet.fixed_target.equal(mean.restorations.efnet));
  CHECK(edi.fixed_target.equal(mean.restorations.edi));
  CHECK_FALSE(edi.restorations.efnet.defined());
}

TEST_CASE("views: a restorer of the middle cannot restore every pose, and says so first",
          "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  options.objective.restored_poses = losses::RestoredPoses::kAll;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  CHECK_THROWS_AS(train::prepare_views(dataset, options, torch::kCPU), DataError);
  CHECK_THROWS_WITH(train::prepare_views(dataset, options, torch::kCPU),
                    Catch::Contains("restorer.pt") && Catch::Contains("version 1"));
  options.objective.target = losses::Target::kEdi;
  CHECK_NOTHROW(train::prepare_views(dataset, options, torch::kCPU));
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
  // Versions without the key rendered this.
  CHECK(train::render_options({}).near_plane == 0.01);
}

TEST_CASE("max_gaussians: auto grows with the side of the frames", "[train]") {
  data::Dataset dataset;
  dataset.train.resize(1);
  dataset.train[0].camera.width = 240;
  dataset.train[0].camera.height = 180;
  CHECK(train::max_gaussians({}, dataset) == 150000);
  dataset.train[0].camera.width = 1280;
  dataset.train[0].camera.height = 720;
  CHECK(train::max_gaussians({}, dataset) == 480000);
  gaussians::DensifyOptions given;
  given.max_gaussians = 7;
  CHECK(train::max_gaussians(given, dataset) == 7);
}
