// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/options.h"

#include "support/catch.h"

#include <functional>
#include <string>

#include "jade/config/config.h"
#include "jade/core/error.h"

using namespace jade;
using namespace jade::simulate;

TEST_CASE("presets: are what docs/simulator.md says", "[simulate]") {
  const auto cdavis = preset_options(Preset::kCdavis), blender = preset_options(Preset::kBlender);
  CHECK((cdavis.width == 346 && cdavis.height == 260 && cdavis.exposure_ms == 100));
  CHECK((cdavis.events.threshold_positive == 0.25 && cdavis.events.threshold_negative == 0.25));
  CHECK((cdavis.events.shot_hz > 0 && cdavis.image.full_well > 0));
  CHECK((blender.width == 600 && blender.height == 400 && blender.exposure_ms == 40));
  CHECK((blender.events.threshold_positive == 0.2 && blender.sampling.min_fps == 1000));
  CHECK((blender.events.shot_hz == 0 && blender.events.threshold_spread == 0 &&
         blender.image.full_well == 0));
}

TEST_CASE("simulation options: mistakes are refused", "[simulate]") {
  CHECK_NOTHROW(validate(SimulateRun{}));
  const auto refused = [](const std::function<void(SimulateOptions&)>& change) {
    SimulateRun run;
    change(run.simulate);
    CHECK_THROWS_AS(validate(run), ConfigError);
  };
  SECTION("an unknown scene") {
    refused([](auto& o) { o.world = "moon"; });
  }
  SECTION("a source without a path") {
    refused([](auto& o) { o.source = Source::kPly; });
  }
  SECTION("more seen test views than exposures") {
    refused([](auto& o) { o.exposures = 2, o.test_views = 5, o.seen_test_views = 3; });
  }
  SECTION("no gap for test views") {
    refused([](auto& o) { o.gap_ms = 0; });
  }
  SECTION("no column that lives") {
    refused([](auto& o) { o.image.dead_columns = o.width; });
    refused([](auto& o) { o.events.dead_columns = o.width; });
  }
  SECTION("a vector of two") {
    refused([](auto& o) { o.camera.eye = {1, 2}; });
  }
}

namespace {

struct CdavisDefaults : SimulateRun {
  CdavisDefaults() { simulate = preset_options(Preset::kCdavis); }
};

SimulateRun shipped(const std::string& name) {
  const std::string file = std::string(JADE_SOURCE) + "/configs/simulate/" + name + ".yaml";
  return config::load<CdavisDefaults>({file, {}, {}});
}

std::string yaml_of(SimulateRun run) { return config::to_yaml(fields_of(run), "test"); }

}  // namespace

TEST_CASE("configs: variants of a scene differ in what their name says alone", "[simulate]") {
  for (const char* scene : {"desk", "workshop", "bookshelf", "corridor"}) {
    INFO(scene);
    const SimulateRun exact = shipped(scene);
    SimulateRun sfm = shipped(std::string(scene) + "_sfm");
    CHECK((sfm.simulate.poses.at == PoseTimes::kThirds && sfm.simulate.poses.rotation_deg > 0));
    CHECK(yaml_of(sfm) != yaml_of(exact));
    sfm.simulate.poses = exact.simulate.poses;
    CHECK(yaml_of(sfm) == yaml_of(exact));
  }
  for (const char* scene : {"desk", "corridor"}) {
    INFO(scene);
    const SimulateRun gray = shipped(scene);
    SimulateRun bayer = shipped(std::string(scene) + "_bayer");
    CHECK(bayer.simulate.events.bayer == Bayer::kRggb);
    bayer.simulate.events.bayer = gray.simulate.events.bayer;
    CHECK(yaml_of(bayer) == yaml_of(gray));
  }
}

TEST_CASE("simulation options: printed and read back they are the same", "[simulate]") {
  SimulateRun run;
  run.seed = 12, run.simulate = preset_options(Preset::kBlender);
  run.simulate.camera.eye = {1, 2, 3.5};
  const std::string yaml = config::to_yaml(fields_of(run), "test");
  SimulateRun again;
  config::read_text(yaml, "test", fields_of(again));
  CHECK(config::to_yaml(fields_of(again), "test") == yaml);
  CHECK_THROWS_AS(config::read_text("simulate: {width: -3}", "bad", fields_of(again)), ConfigError);
  CHECK_THROWS_AS(config::read_text("simulate: {widht: 3}", "bad", fields_of(again)), ConfigError);
}
