// SPDX-License-Identifier: Apache-2.0
#include "jade/run/live_scene.h"

#include "support/catch.h"

#include "jade/core/error.h"
#include "jade/data/dataset.h"
#include "jade/eval/metrics.h"
#include "support/tiny_run.h"

using namespace jade;
using serve::Wanted;

TEST_CASE("live scene: the page carries the events of its exposures, and of nothing else",
          "[run]") {
  const test::TinyScene scene;
  data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  dataset.train[1].events = dataset.train[1].events.slice(0, 0);
  const run::GaussianSource none = [] {
    splat::Gaussians empty;
    empty.means = torch::zeros({0, 3});
    return empty;
  };
  run::LiveScene live(dataset, {}, none);
  for (const char* camera : {"train.0", "train.1", "train.2", "test.0"}) live.add(camera, {});
  const auto page = nlohmann::json::parse(live.page_data({{}, "", "id", false}));
  CHECK(page["title"] == dataset.name);
  REQUIRE(page["views"].size() == 3);
  for (const size_t index : {0, 2}) {
    const auto& film = page["views"][index]["events"];
    CHECK(film["events"] == dataset.train[index].events.size());
    CHECK(film["columns"] == dataset.train[index].camera.width);
    CHECK_FALSE(film["packed"].get<std::string>().empty());
  }
  CHECK(page["views"][1]["events"].is_null());
  CHECK_FALSE(page["tests"][0].contains("events"));
}

TEST_CASE("live scene: a picture is judged where a truth of its size is, and when it is asked",
          "[run]") {
  const test::TinyScene scene;
  const data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  const run::GaussianSource none = [] {
    splat::Gaussians empty;
    empty.means = torch::zeros({0, 3});
    empty.rotations = torch::zeros({0, 4});
    empty.log_scales = torch::zeros({0, 3});
    empty.logit_opacities = torch::zeros({0});
    empty.sh = torch::zeros({0, 1, 3});
    return empty;
  };
  run::LiveScene live(dataset, {}, none);
  const torch::Tensor truth = dataset.test[0].image, guess = (truth + 0.1).clamp(0, 1);
  live.add("test.0", {{"guess", [guess] { return guess; }, /*judged=*/true},
                      {"truth", [truth] { return truth; }},
                      {"small", [guess] { return guess.slice(1, 0, 8); }, /*judged=*/true}});
  Wanted wanted;
  wanted.kind = Wanted::Kind::kPicture;
  wanted.view = "test.0";
  wanted.picture = "guess";
  REQUIRE(live.draw(wanted, 0).psnr);
  CHECK(live.draw(wanted, 0).psnr() == Approx(eval::psnr(guess, truth)));
  for (const char* unjudged : {"truth", "small"}) {
    wanted.picture = unjudged;
    CHECK_FALSE(live.draw(wanted, 0).psnr);
  }
  wanted.kind = Wanted::Kind::kColor;
  wanted.pose = dataset.test[0].pose;
  wanted.camera = dataset.test[0].camera;
  CHECK(live.draw(wanted, 0).psnr() == Approx(eval::psnr(torch::zeros_like(truth), truth)));
  for (const char* elsewhere : {"", "test.7"}) {
    wanted.view = elsewhere;
    CHECK_FALSE(live.draw(wanted, 0).psnr);
  }
  wanted.kind = Wanted::Kind::kCamera;
  wanted.view = "train.1";
  const auto poses = nlohmann::json::parse(live.draw(wanted, 0).json)["poses"];
  REQUIRE(poses.size() == 9);
  CHECK(poses[8][3] == dataset.train[1].poses[8].translation[0]);
  wanted.view = "train.3";
  CHECK_THROWS_AS(live.draw(wanted, 0), ConfigError);
}
