// SPDX-License-Identifier: Apache-2.0
#include "jade/run/report.h"

#include "support/catch.h"

#include <nlohmann/json.hpp>

#include "jade/core/atomic_file.h"
#include "jade/eval/metrics.h"
#include "jade/run/trainer.h"
#include "jade/train/routing_step.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

/// A routed run with the α given, whose data set ends with a test view of `truth` at the middle of
/// exposure 1.
nlohmann::json allocation_of(double alpha, const torch::Tensor& truth) {
  const test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  options.allocation.kind = router::AllocationKind::kConstant;
  options.allocation.constant = alpha;
  options.train.iterations = options.train.calendar = 1;
  const auto folder = scene.dir.path() / "run";
  run::Trainer trainer(options, folder, "");
  trainer.run();
  data::Dataset dataset = data::load_dataset(options.dataset);
  if (truth.defined()) {
    const data::Exposure& exposure = dataset.train[1];
    dataset.test.push_back(
        {"mid", truth, exposure.poses[geometry::kMidPose], exposure.camera, exposure.t_mid_us()});
  }
  train::TrainState state = train::make_state(options, dataset, torch::kCPU);
  const auto views = train::prepare_views(dataset, options, torch::kCPU);
  run::write_report(folder, dataset, views, state, options);
  return nlohmann::json::parse(read_file(folder / "allocation.json"));
}

torch::Tensor edi_of_exposure_1() {
  const test::TinyScene scene;
  const train::RunOptions options = test::routed_options(scene);
  return train::prepare_views(data::load_dataset(options.dataset), options, torch::kCPU)[1]
      .restorations.edi.clamp(0, 1);
}

}  // namespace

TEST_CASE("report: says whether the allocation chose the better restoration, where truths tell",
          "[run]") {
  const torch::Tensor truth = edi_of_exposure_1();
  const auto edi = allocation_of(0.9, truth), efnet = allocation_of(0, truth);
  for (const auto* found : {&edi, &efnet}) {
    CHECK((*found)["views"].size() == 3);
    for (const size_t unknown : {0, 2})
      CHECK_FALSE((*found)["views"][unknown].contains("choice_right"));
    for (const char* key : {"choice_right", "choice_gain_db"})
      CHECK((*found)["mean"][key] == (*found)["views"][1][key]);
  }
  CHECK(edi["mean"]["choice_right"] == 1.0);
  CHECK(edi["mean"]["choice_gain_db"].get<double>() < 0);
  CHECK(efnet["mean"]["choice_right"] == 0.0);
  CHECK(efnet["mean"]["choice_gain_db"].get<double>() < edi["mean"]["choice_gain_db"]);
}

TEST_CASE("report: without a truth or a second restoration the choice is not judged", "[run]") {
  for (const auto& found : {allocation_of(0.5, {}), allocation_of(1, edi_of_exposure_1())}) {
    CHECK(found["mean"]["choice_right"].is_null());
    CHECK(found["mean"]["choice_gain_db"].is_null());
  }
}
