// SPDX-License-Identifier: Apache-2.0
#include "jade/run/report.h"

#include "support/catch.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "jade/core/atomic_file.h"
#include "jade/eval/metrics.h"
#include "jade/run/trainer.h"
#include "jade/train/routing_step.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

/// A routed run with the given α, whose data set ends with a test view of `truth` at the middle of
/// exposure 1.
nlohmann::json allocation_of(double alpha, const torch::Tensor& truth) {
  const test::TinyScene scene;
  train::RunOptions options = test::routed_options(scene);
  options.allocation.kind = router::AllocationKind::kGlobalScalar;
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
  const torch::NoGradGuard no_grad;
  state.allocation->parameters()[0].fill_(std::log(alpha / (1 - alpha)));
  const train::ViewBank bank(dataset, options, torch::kCPU);
  run::Report(dataset, bank, state).write(folder, dataset, bank, state, options);
  return nlohmann::json::parse(read_file(folder / "allocation.json"));
}

torch::Tensor edi_of_exposure_1() {
  const test::TinyScene scene;
  const train::RunOptions options = test::routed_options(scene);
  const train::ViewBank bank(data::load_dataset(options.dataset), options, torch::kCPU);
  return bank.picture_view(1).restorations.edi.clamp(0, 1);
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

TEST_CASE("report: says what came before, where the cameras stand, and holds the scene", "[run]") {
  const test::TinyScene scene;
  const train::RunOptions options = test::tiny_options(scene);
  const auto folder = scene.dir.path() / "run";
  run::Trainer trainer(options, folder, "");
  data::Dataset dataset = data::load_dataset(options.dataset);
  const data::Exposure& exposure = dataset.train[1];
  dataset.test.push_back({"mid", exposure.blurry.clamp(0.1, 0.9),
                          exposure.poses[geometry::kMidPose], exposure.camera, exposure.t_mid_us(),
                          true});
  train::TrainState state = train::make_state(options, dataset, torch::kCPU);
  run::Report(dataset, trainer.bank(), state)
      .write(folder, dataset, trainer.bank(), state, trainer.options());
  const std::string page = read_file(folder / "report.html");
  const std::string mark = "id=\"data\">";
  const size_t from = page.find(mark) + mark.size();
  const auto data = nlohmann::json::parse(page.substr(from, page.find("</script>", from) - from));

  const torch::Tensor truth = dataset.test.back().image;
  CHECK(data["headline"]["views"] == 1);
  CHECK(data["headline"]["blurry"] == Approx(eval::psnr(exposure.blurry, truth)));
  CHECK(data["headline"]["render"].get<double>() > 0);
  CHECK(data["views"][1]["camera"] == "train.1");
  CHECK(data["tests"].back()["camera"] ==
        nlohmann::json("test." + std::to_string(dataset.test.size() - 1)));
  CHECK(data["tests"].back()["seen"] == true);
  CHECK(data["tests"][0]["seen"].is_null() != dataset.test[0].seen.has_value());
  const auto& camera = data["scene"]["cameras"]["train"][1];
  CHECK(camera["fx"] == exposure.camera.fx);
  REQUIRE(camera["poses"].size() == geometry::kExposurePoses);
  CHECK(camera["poses"][8][7] == exposure.poses[8].translation[1]);
  CHECK(camera["poses"][8][4] == exposure.poses[8].rotation[3]);
  CHECK(data["scene"]["near_plane"].get<double>() > 0);
  // The first bytes of a gzip file.
  CHECK(page.find("id=\"spz\">H4sI") != std::string::npos);

  // The page omits a Gaussian that no picture shows or that is far from all others.
  const auto embeds_scene = [&] {
    run::Report(dataset, trainer.bank(), state)
        .write(folder, dataset, trainer.bank(), state, trainer.options());
    return read_file(folder / "report.html").find("id=\"spz\">H4sI") != std::string::npos;
  };
  torch::Tensor means = state.gaussians.detached().means;
  for (const float position : {INFINITY, 1e9F}) {
    means[0][0].fill_(position);
    CHECK(embeds_scene());
  }
  // A scene of which .spz can hold nothing.
  means.fill_(1e9F);
  CHECK_FALSE(embeds_scene());
}

TEST_CASE("report: without a truth the choice is not judged", "[run]") {
  const auto found = allocation_of(0.5, {});
  CHECK(found["mean"]["choice_right"].is_null());
  CHECK(found["mean"]["choice_gain_db"].is_null());
}
