// SPDX-License-Identifier: Apache-2.0
// Scenes of monochrome frames: bit-exactly gray in every restoration, parameter, moment and file.
#include "support/catch.h"

#include <torch/script.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/gaussians/ply.h"
#include "jade/imaging/color.h"
#include "jade/imaging/image_io.h"
#include "jade/run/evaluate.h"
#include "jade/run/trainer.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

/// Gray frames and a restorer that tints them, like one trained on colours.
struct GrayScene : test::TinyScene {
  std::filesystem::path restorer = dir.path() / "tints.pt";

  explicit GrayScene(bool gray = true) : TinyScene({36, 28, 3, false, gray}) {
    torch::jit::Module module("tints");
    module.define(
        "def forward(self, image, events, mask):\n"
        "  return torch.cat([image[:, :1], image[:, 1:2] * 0.9, image[:, 2:] * 0.7], 1)\n");
    module.save(restorer.string(), {{"jade_efnet.json",
                                     R"({"format": "jade-restorer", "format_version": 1,
      "kind": "efnet", "name": "tints", "width": 1, "parameters": 0, "input": "scer",
      "normalization": "max_abs", "channel_order": "rgb", "padding_multiple": 4,
      "minimum_size": 8, "uses_mask": false, "dtype": "float32", "source": "test",
      "weights_sha256": "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"})"}});
  }

  /// The whole objective, densification and all SH degrees within thirty steps.
  train::RunOptions options(const std::string& device) const {
    train::RunOptions options = test::full_options(*this);
    options.device = device;
    options.efnet.path = restorer;
    return options;
  }
};

/// Largest difference between the channels of a colour [...,3].
double spread(const torch::Tensor& colors) {
  return (colors.amax(-1) - colors.amin(-1)).max().item<double>();
}

double spread_of_state(const train::TrainState& state) {
  return std::max({spread(state.gaussians.parameters().sh.detach()),
                   spread(state.gaussian_adam.first_moments().sh),
                   spread(state.gaussian_adam.second_moments().sh)});
}

void check_gray_training(const std::string& device) {
  const GrayScene scene;
  train::RunOptions options = scene.options(device);
  run::Trainer gray(options, scene.dir.path() / "gray", "");
  for (int64_t i = 0; i < gray.bank().size(); ++i) {
    const restore::Restorations restored = gray.bank().picture_view(i).restorations;
    CHECK(imaging::is_gray(restored.efnet));
    CHECK(imaging::is_gray(restored.edi));
  }
  CHECK(spread_of_state(gray.state()) == 0);
  for (int i = 0; i < 30; ++i) {
    gray.step();
    gray.densify();
    CHECK(spread_of_state(gray.state()) == 0);
  }
  const auto& trained = gray.state().gaussians.parameters();
  CHECK(trained.size() != 300);  // densification took part
  for (int64_t degree = 1; degree <= 3; ++degree) {
    CHECK(trained.sh.select(1, (degree + 1) * (degree + 1) - 1).abs().max().item<double>() > 0);
  }
  if (device == "cuda") CHECK(gray.replays() > 10);

  options.dataset.color = data::FrameColor::kColor;
  run::Trainer colored(options, scene.dir.path() / "colored", "");
  for (int i = 0; i < 30; ++i) colored.step(), colored.densify();
  CHECK(spread_of_state(colored.state()) > 1e-3);
}

}  // namespace

TEST_CASE("monochrome: thirty steps of all terms keep the channels equal to the bit", "[run]") {
  check_gray_training("cpu");
}

TEST_CASE("monochrome: recorded steps on a GPU keep the channels equal to the bit", "[run][cuda]") {
  check_gray_training("cuda");
}

TEST_CASE("monochrome: files and pictures of a run are gray, resumed or not", "[run]") {
  const GrayScene scene;
  const auto whole = scene.dir.path() / "whole", halves = scene.dir.path() / "halves";
  train::RunOptions options = scene.options("cpu");
  options.train.iterations = 20;
  run::Trainer(options, whole, "").run();
  train::RunOptions half = options;
  half.train.iterations = 10;
  run::Trainer(half, halves, "").run();
  run::Trainer(options, halves, "latest").run();
  CHECK(read_file(whole / "point_cloud.ply") == read_file(halves / "point_cloud.ply"));
  CHECK(spread(gaussians::read_ply(whole / "point_cloud.ply").gaussians.sh) == 0);
  CHECK(imaging::is_gray(imaging::read_image(whole / "images/test_03.png")));
  CHECK_THAT(read_file(whole / "train.log"), Catch::Contains("monochrome"));
  train::RunOptions in_color = options;
  in_color.dataset.color = data::FrameColor::kColor;
  CHECK_THROWS_WITH(run::Trainer(in_color, whole, "latest"),
                    Catch::Contains("dataset.color: auto -> color"));
}

TEST_CASE("monochrome: a coloured start becomes gray by the luma", "[run]") {
  const GrayScene scene;
  train::RunOptions options = scene.options("cpu");
  options.dataset.color = data::FrameColor::kColor;
  run::Trainer colored(options, scene.dir.path() / "colored", "");
  for (int i = 0; i < 10; ++i) colored.step(), colored.densify();
  const auto ply = scene.dir.path() / "colored.ply";
  gaussians::write_ply(ply, {colored.state().gaussians.detached()});
  const torch::Tensor before = gaussians::read_ply(ply).gaussians.sh;
  REQUIRE(spread(before) > 1e-3);
  options.dataset.color = data::FrameColor::kAuto;
  options.init.kind = gaussians::InitKind::kPly;
  options.init.ply = ply;
  const run::Trainer trainer(options, scene.dir.path() / "gray", "");
  const torch::Tensor after = trainer.state().gaussians.parameters().sh.detach();
  CHECK(spread(after) == 0);
  const torch::Tensor luma = before.matmul(torch::tensor({0.299f, 0.587f, 0.114f}));
  CHECK(torch::allclose(after.select(-1, 1), luma, 1e-5, 1e-6));
}

TEST_CASE("monochrome: gray forced on coloured frames trains a gray scene", "[run]") {
  const GrayScene scene(false);
  train::RunOptions options = scene.options("cpu");
  const run::Trainer colored(options, scene.dir.path() / "auto", "");
  CHECK_FALSE(imaging::is_gray(colored.bank().picture_view(0).restorations.efnet));
  options.dataset.color = data::FrameColor::kGray;
  run::Trainer trainer(options, scene.dir.path() / "gray", "");
  const train::View view = trainer.bank().picture_view(0);
  CHECK(imaging::is_gray(view.restorations.efnet));
  CHECK(imaging::is_gray(view.blurry()));
  for (int i = 0; i < 10; ++i) trainer.step(), trainer.densify();
  CHECK(spread_of_state(trainer.state()) == 0);
}

TEST_CASE("monochrome: targets from a folder lose their tint", "[run]") {
  const GrayScene scene;
  train::RunOptions options = scene.options("cpu");
  options.objective.target = losses::Target::kImageFolder;
  options.train.target_images = scene.dir.path() / "targets";
  const torch::Tensor tinted = torch::tensor({0.6f, 0.3f, 0.3f}).view({3, 1, 1});
  for (const char* name : {"00.png", "01.png", "02.png"}) {
    imaging::write_image(options.train.target_images / name, tinted.expand({3, 28, 36}));
  }
  const run::Trainer trainer(options, scene.dir.path() / "run", "");
  const torch::Tensor target = trainer.bank().step_view(1).fixed_target;
  CHECK(imaging::is_gray(target));
  CHECK(target.mean().item<double>() == Approx(0.4).margin(0.003));
}
