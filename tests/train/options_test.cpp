// SPDX-License-Identifier: Apache-2.0
#include "jade/train/options.h"

#include "support/catch.h"

#include "jade/config/config.h"
#include "jade/core/error.h"

using namespace jade;

TEST_CASE("options: rules between fields name the keys", "[train]") {
  train::RunOptions options;
  CHECK_NOTHROW(train::validate(options));
  options.events.bins = 5;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("events.bins"));
  options.events.bins = 6;
  options.route.render_consistency = options.route.reblur_consistency = false;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("route.render_consistency"));
  options.allocation.kind = router::AllocationKind::kConstant;
  CHECK_NOTHROW(train::validate(options));
  options.objective.blur = options.objective.edi_supervision = options.objective.intensity = false;
  options.objective.simulation = false;
  CHECK_NOTHROW(train::validate(options));
  options.objective.target_until = 100;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("step 101"));
  options.train.iterations = 100;
  CHECK_NOTHROW(train::validate(options));
  options.objective.target = losses::Target::kNone;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("step 1,"));
}

TEST_CASE("options: all poses are refused where only the middle is known, or moments change",
          "[train]") {
  train::RunOptions options;
  options.objective.restored_poses = losses::RestoredPoses::kAll;
  CHECK_NOTHROW(train::validate(options));
  options.exposure.quadrature = geometry::QuadratureRule::kJittered;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("exposure.quadrature jittered"));
  options.exposure.quadrature = geometry::QuadratureRule::kTrapezoid;
  for (const auto target : {losses::Target::kBlurry, losses::Target::kImageFolder}) {
    options.objective.target = target;
    options.train.target_images = "somewhere";
    CHECK_THROWS_WITH(train::validate(options),
                      Catch::Contains("restored_poses") && Catch::Contains(word_of(target)));
  }
  options.objective.restored_poses = losses::RestoredPoses::kMiddle;
  CHECK_NOTHROW(train::validate(options));
}

TEST_CASE("options: the middle of an exposure is a sample, and DiET-GS's nine images stay nine",
          "[train]") {
  train::RunOptions options;
  options.exposure.samples = 10;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("exposure.samples"));
  options.exposure.samples = 17;
  CHECK_NOTHROW(train::validate(options));
  options.events.edi_samples = 64;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("events.edi_samples"));
  options.events.edi_samples = 65;
  CHECK_NOTHROW(train::validate(options));
  options.events.edi_index = events::EdiIndex::kDiet;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("events.edi_index"));
}

TEST_CASE("options: exposures of a DiET-GS release are nine equal moments whatever is asked for",
          "[train]") {
  train::RunOptions options;
  options.exposure.quadrature = geometry::QuadratureRule::kTrapezoid;
  options.exposure.samples = 17;
  options.events.edi_samples = 65;
  data::Dataset dataset;
  dataset.kind = data::DatasetKind::kEvDeblur;
  train::follow_dataset(dataset, options);
  CHECK(options.exposure.samples == 17);
  dataset.kind = data::DatasetKind::kDietGs;
  train::follow_dataset(dataset, options);
  CHECK(options.exposure.quadrature == geometry::QuadratureRule::kEqual);
  CHECK(options.exposure.samples == 9);
  CHECK(options.events.edi_samples == 0);
}

TEST_CASE("options: the calendar follows the number of steps", "[train]") {
  train::RunOptions options;
  const auto settled = [&](int64_t iterations) {
    options.train.iterations = iterations;
    train::settle(options);
    return options;
  };
  // The paper's budget has the paper's calendar.
  const train::RunOptions paper = settled(25000);
  CHECK(paper.objective.warmup == 1500);
  CHECK(paper.objective.simulation_start == 7000);
  CHECK(paper.densify.from == 500);
  CHECK(paper.densify.until == 15000);
  CHECK(paper.densify.every == 100);
  CHECK(paper.densify.opacity_reset_every == 3000);
  CHECK(paper.train.sh_degree_every == 1000);
  CHECK(paper.optim.position_lr_max_steps == 150000);
  CHECK(paper.poses.lr_max_steps == 30000);
  for (const int64_t iterations : {1, 2, 7, 20})
    CHECK_NOTHROW(train::validate(settled(iterations)));
  for (const int64_t iterations : {500, 3000, 12000, 40000}) {
    const train::RunOptions scaled = settled(iterations);
    CHECK_NOTHROW(train::validate(scaled));
    CHECK(scaled.densify.until == iterations * 3 / 5);
    CHECK(scaled.objective.simulation_start == iterations * 7 / 25);
    CHECK(scaled.densify.last_opacity_reset == iterations * 9 / 10);
  }
}

TEST_CASE("options: a learned sensor asks for a term that moves it, and for exact EDI", "[train]") {
  train::RunOptions options;
  options.sensor.learn_thresholds = true;
  CHECK_NOTHROW(train::validate(options));
  options.objective.edi_supervision = false;
  CHECK_NOTHROW(train::validate(options));
  options.objective.simulation = false;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("objective.edi_supervision"));
  options.objective.simulation = true;
  options.events.edi_index = events::EdiIndex::kDiet;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("sensor.learn_thresholds"));
}

TEST_CASE("validate: learned poses end with their exposure, and so must the windows of L_ev",
          "[train]") {
  train::RunOptions options;
  options.poses.optimize = train::PosePath::kLinear;
  options.objective.event_loss_weight = 0.1;
  CHECK_NOTHROW(train::validate(options));
  options.objective.event_window = losses::EventSpan::kRecording;
  CHECK_THROWS_WITH(train::validate(options),
                    Catch::Contains("objective.event_window") && Catch::Contains("poses.optimize"));
  options.objective.event_loss_weight = 0;
  CHECK_NOTHROW(train::validate(options));
}

TEST_CASE("presets: paper.yaml undoes all that base.yaml recommends", "[train]") {
  const std::string configs = std::string(JADE_SOURCE) + "/configs/";
  /// The values that differ from the program's own, of base.yaml with `layers` over it.
  const auto changed = [&](const std::vector<std::filesystem::path>& layers) {
    auto options = config::load<train::RunOptions>({configs + "base.yaml", {}, layers});
    train::RunOptions printed;
    train::settle(printed);
    const auto found = config::values(fields_of(options)),
               expected = config::values(fields_of(printed));
    std::string keys;
    for (size_t i = 0; i < found.size(); ++i) {
      if (found[i] != expected[i]) keys += found[i].first + " ";
    }
    return keys;
  };
  CHECK_THAT(changed({}), Catch::Contains("exposure.samples") && Catch::Contains("poses.start"));
  // The inherited density control counts the first pose alone; the program all of them.
  CHECK(changed({configs + "paper.yaml"}) == "densify.statistics ");
  CHECK(changed({configs + "ablation/full.yaml"}) ==
        "densify.gradient_threshold densify.max_gaussians ");
}
