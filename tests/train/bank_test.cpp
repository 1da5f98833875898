// SPDX-License-Identifier: Apache-2.0
#include "jade/train/bank.h"

#include "support/catch.h"

#include <future>
#include <memory>
#include <set>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/events/exposure_maps.h"
#include "jade/events/voxel.h"
#include "jade/imaging/reblur.h"
#include "jade/train/step_feed.h"
#include "support/naming.h"
#include "train/bench.h"

using namespace jade;

namespace {

torch::Tensor psi_of(const train::View& view) { return view.measured.narrow(0, 3, 2); }

}  // namespace

TEST_CASE("bank: Eq. (7) takes the paper's c, and with 0 the calibrated one", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto kernel = [&](double contrast) {
    options.route.reblur_contrast = contrast;
    return train::ViewBank(dataset, options, torch::kCPU).step_view(0).reblur_kernel;
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

TEST_CASE("bank: each has the events of its own exposure, though they are summed ahead",
          "[train]") {
  test::TinyDatasetOptions data;
  data.exposures = 7;
  const test::TinyScene scene(data);
  const train::RunOptions options = test::routed_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  auto begun = std::make_unique<train::Restoring>(dataset, options, torch::kCPU,
                                                  std::future<restore::Restorer>(), 0);
  const train::ViewBank bank(dataset, options, torch::kCPU, std::move(begun));
  REQUIRE(bank.size() == 7);
  for (int64_t i = 0; i < bank.size(); ++i) {
    const data::Exposure& exposure = dataset.train[static_cast<size_t>(i)];
    const events::ExposureMaps maps =
        events::map_exposure(exposure.events, {exposure.t_start_us, exposure.t_end_us}, 6,
                             {exposure.camera.height, exposure.camera.width});
    CHECK(bank.picture_view(i).blurry().equal(exposure.blurry));
    CHECK(bank.density(i).equal(maps.density));
    CHECK(psi_of(bank.picture_view(i)).equal(events::polarity_projection(maps.voxel.values)));
    CHECK_FALSE(bank.density(i).equal(bank.density((i + 1) % 7)));
  }
}

TEST_CASE("bank: takes the restoration that has begun", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto edi = [&](std::unique_ptr<train::Restoring> begun) {
    const train::ViewBank bank(dataset, options, torch::kCPU, std::move(begun));
    return bank.picture_view(0).restorations.edi;
  };
  const torch::Tensor usual = edi(nullptr);
  train::RunOptions other = options;
  other.events.threshold_positive = 2 * options.events.threshold_positive;
  auto begun = std::make_unique<train::Restoring>(dataset, other, torch::kCPU,
                                                  std::future<restore::Restorer>(), 0);
  CHECK_FALSE(edi(std::move(begun)).equal(usual));
}

TEST_CASE("bank: cameras, moments, weights and EDI are those of the quadrature", "[train]") {
  using geometry::QuadratureRule;
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto first = [&](QuadratureRule rule, int64_t samples) {
    options.exposure = {rule, samples};
    return train::ViewBank(dataset, options, torch::kCPU);
  };
  const train::View printed = first(QuadratureRule::kEqual, 9).step_view(0);
  CHECK_FALSE(printed.weights.defined());
  const train::View trapezoid = first(QuadratureRule::kTrapezoid, 9).step_view(0);
  CHECK(trapezoid.weights.sum().item<double>() == Approx(1));
  CHECK(trapezoid.cameras.camera_from_world.equal(printed.cameras.camera_from_world));
  const train::ViewBank fine_bank = first(QuadratureRule::kTrapezoid, 17);
  CHECK(fine_bank.edi_factors(0).size(0) == 17);
  const train::View fine = fine_bank.step_view(0);
  CHECK(torch::allclose(fine.cameras.camera_from_world.slice(0, 0, 17, 2),
                        printed.cameras.camera_from_world, 0, 1e-6));
  CHECK_FALSE(torch::allclose(fine.cameras.camera_from_world[1],
                              printed.cameras.camera_from_world[1], 0, 1e-6));
}

TEST_CASE("bank: target images have a digest, without which no run has them", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  CHECK_FALSE(dataset.undistorted);
  CHECK(train::target_images_sha256(dataset, options).empty());
  options.objective.target = losses::Target::kImageFolder;
  options.train.target_images = scene.data / "images_1";
  CHECK(train::target_images_sha256(dataset, options).size() == 64);
}

TEST_CASE("bank: objective.edi_contrast leaves both restorations as they are", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto bank = [&] { return train::ViewBank(dataset, options, torch::kCPU); };
  const train::ViewBank plain = bank();
  CHECK(plain.edi_factors(1).scalar_type() == torch::kFloat32);
  options.objective.edi_contrast = 1.5;
  const train::ViewBank taught = bank();
  CHECK(taught.picture_view(1).restorations.edi.equal(plain.picture_view(1).restorations.edi));
  options.objective.edi_contrast = 1;
  options.events.threshold_positive = 1.5 * options.events.threshold_positive;
  options.events.threshold_negative *= 1.5;
  // Factors of another contrast are float16.
  CHECK(torch::allclose(taught.edi_factors(1).to(torch::kFloat32), bank().edi_factors(1), 1e-3));
}

TEST_CASE(
    "bank: at a pose the target reads what is restored there, at the middle what it always did",
    "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  options.route.reblur_contrast = 0;
  options.events.threshold_negative = 0.3;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const train::ViewBank bank(dataset, options, torch::kCPU);
  const train::View view = bank.picture_view(1);
  const data::Exposure& exposure = dataset.train[1];
  const events::TimeWindow span{exposure.t_start_us, exposure.t_end_us};
  const events::ImageSize size{exposure.camera.height, exposure.camera.width};
  const auto voxel = events::map_exposure(exposure.events, span, 6, size).voxel;
  const auto counts = events::map_exposure(exposure.events, span, 1, size, 4).windows;
  restore::Restorer network(options.efnet);
  const double rounding = 5e-4;  // of float16 below 1
  for (int64_t k = 0; k < 9; ++k) {
    INFO(k);
    const train::View at = bank.step_view(1, k);
    const double u = double(k) / 8;
    CHECK(torch::allclose(
        at.restorations.efnet,
        network.restore(exposure.blurry, counts.positive - counts.negative, {u})[0], 0, rounding));
    CHECK(torch::allclose(at.restorations.edi, exposure.blurry * bank.edi_factors(1)[k]));
    CHECK(psi_of(at).equal(events::polarity_projection(voxel.values, u)));
    CHECK(at.blurry().equal(exposure.blurry));
    CHECK(at.reblur_kernel.equal(imaging::reblur_kernel(voxel, 0.25 * voxel.v_max, u)));
    CHECK_FALSE(at.fixed_target.defined());
  }
  CHECK_FALSE(torch::allclose(view.restorations.efnet, bank.step_view(1, 0).restorations.efnet, 0,
                              rounding));
  const train::View middle = bank.step_view(1, 4);
  CHECK(middle.restorations.edi.equal(view.restorations.edi));
  CHECK(torch::allclose(middle.restorations.efnet, view.restorations.efnet, 0, rounding));
  CHECK(middle.measured.equal(view.measured));
  CHECK(middle.reblur_kernel.equal(view.reblur_kernel));
  CHECK_THROWS_AS(bank.step_view(1, 9), ContractError);
}

TEST_CASE("bank: constants go to the device kind by kind as far as they fit", "[train][cuda]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  options.objective.target = losses::Target::kEfnet;
  options.objective.edi_contrast = 1.3;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const train::ViewBank all(dataset, options, torch::kCUDA);
  const train::ConstantBytes whole = all.bytes_on_device();
  CHECK(whole.frames == 3 * all.size() * int64_t(all.picture_view(0).measured.nbytes()));
  CHECK((whole.edi > 0 && whole.restorations > 0));
  // Enough bytes for the frames only, and none.
  for (const int64_t most : {whole.frames, int64_t{0}}) {
    INFO(most);
    const train::ViewBank some(dataset, options, torch::kCUDA, {}, most);
    CHECK(some.bytes_on_device().frames == most);
    CHECK(some.bytes_on_device().edi == 0);
    CHECK(some.bytes_on_device().restorations == 0);
    for (const int64_t k : {0, 3, 8}) {
      const train::View a = all.step_view(1, k), b = some.step_view(1, k);
      CHECK(a.measured.is_cuda());
      CHECK(a.measured.equal(b.measured));
      CHECK(a.window_square.equal(b.window_square));
      CHECK(a.fixed_target.equal(b.fixed_target));
      const losses::EdiFactors c = all.edi_factors(1, {k, 1, 2}),
                               d = some.edi_factors(1, {k, 1, 2});
      CHECK(c.gray.equal(d.gray));
      CHECK(c.simulation.equal(d.simulation));
    }
  }
  options.objective.target = losses::Target::kRouted;
  const train::ViewBank routed(dataset, options, torch::kCUDA, {}, 0);
  CHECK(routed.picture_view(1).measured.is_cuda());
}

TEST_CASE("bank: an exposure without length has one map for all moments", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  options.objective.target = losses::Target::kEfnet;
  data::Dataset dataset = data::load_dataset(options.dataset);
  const train::ConstantBytes all = train::ViewBank(dataset, options, torch::kCPU).bytes_on_device();
  dataset.train[1].t_end_us = dataset.train[1].t_start_us;
  dataset.train[1].events = {};
  const train::ViewBank bank(dataset, options, torch::kCPU);
  CHECK(bank.bytes_on_device().edi == all.edi * (2 * 9 + 1) / (3 * 9));
  CHECK(bank.bytes_on_device().restorations < all.restorations);
  CHECK(bank.edi_factors(1).size(0) == 9);
  const train::View start = bank.step_view(1, 0);
  for (const int64_t k : {1, 8}) {
    CHECK(bank.step_view(1, k).fixed_target.equal(start.fixed_target));
    CHECK(bank.edi_factors(1, {0, k, k}).color.equal(bank.edi_factors(1, {0, k, k}).gray));
  }
}

TEST_CASE("bank: of three restored poses each is the one that nine would give", "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const train::ViewBank nine(dataset, options, torch::kCPU);
  train::RunOptions three = options;
  three.objective.restored_poses = losses::RestoredPoses::kThree;
  const train::ViewBank some(dataset, three, torch::kCPU);
  CHECK(some.bytes_on_device().restorations < nine.bytes_on_device().restorations);
  CHECK(train::restored_times(three) == std::vector<double>{0, 0.5, 1});
  for (const int64_t k : {0, 4, 8}) {
    const train::View a = nine.step_view(1, k), b = some.step_view(1, k);
    CHECK(torch::allclose(a.restorations.efnet, b.restorations.efnet, 0, 1e-3));
    CHECK(a.restorations.edi.equal(b.restorations.edi));
    CHECK(a.measured.equal(b.measured));
    CHECK(a.reblur_kernel.equal(b.reblur_kernel));
  }
  three.exposure.samples = 17;
  CHECK(train::restored_every(three) == 8);
  three.objective.restored_poses = losses::RestoredPoses::kNine;
  CHECK(train::restored_times(three).size() == 9);
  three.exposure.samples = 11;
  CHECK(train::restored_times(three).size() == 11);
  CHECK_NOTHROW(train::validate(three));
}

TEST_CASE("bank: a fixed target at a pose is made of the restorations there", "[train]") {
  using losses::Target;
  const test::TinyScene scene;
  train::RunOptions options = test::all_poses_options(scene);
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto at = [&](Target target) {
    options.objective.target = target;
    return train::ViewBank(dataset, options, torch::kCPU).step_view(0, 7);
  };
  // The network's restoration and EDI as inputs of a router.
  const train::View routed = at(Target::kRouted);
  const restore::Restorations& restored = routed.restorations;
  const train::View mean = at(Target::kMean);
  CHECK(torch::allclose(mean.fixed_target, 0.5 * (restored.edi + restored.efnet)));
  CHECK(mean.measured.size(0) == 3);
  CHECK(at(Target::kEfnet).fixed_target.equal(restored.efnet));
  CHECK(at(Target::kEdi).fixed_target.equal(restored.edi));
}

TEST_CASE("bank: a restorer of the middle cannot restore every pose, and says so first",
          "[train]") {
  const test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  options.objective.restored_poses = losses::RestoredPoses::kNine;
  const data::Dataset dataset = data::load_dataset(options.dataset);
  const auto prepare = [&] { train::ViewBank(dataset, options, torch::kCPU); };
  CHECK_THROWS_AS(prepare(), DataError);
  CHECK_THROWS_WITH(prepare(), Catch::Contains("restorer.pt") && Catch::Contains("version 1"));
  options.objective.target = losses::Target::kEdi;
  CHECK_NOTHROW(prepare());
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
