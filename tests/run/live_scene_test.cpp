// SPDX-License-Identifier: Apache-2.0
#include "jade/run/live_scene.h"

#include "support/catch.h"

#include "jade/data/dataset.h"
#include "support/tiny_run.h"

using namespace jade;

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
