// SPDX-License-Identifier: Apache-2.0
#include "jade/run/pace.h"

#include "support/catch.h"

#include "jade/config/config.h"
#include "jade/core/atomic_file.h"
#include "jade/run/checkpoint.h"
#include "jade/run/trainer.h"
#include "support/tiny_run.h"

using namespace jade;
using losses::RestoredPoses;
using losses::Target;

namespace {

/// 40 frames with events.
constexpr run::RestoredFrames kFrames{40, 0};

/// The recommended preset with the choices for a CPU.
train::RunOptions cpu_options(const run::Choices& choices = {}) {
  train::RunOptions options;
  run::choose_for_cpu(choices, options);
  return options;
}

}  // namespace

TEST_CASE("pace: a CPU gets fewer moments, steps and Gaussians, where the user leaves them",
          "[run]") {
  const train::RunOptions chosen = cpu_options();
  CHECK(chosen.exposure.samples == 9);
  CHECK(chosen.train.iterations == 2000);
  CHECK(chosen.densify.max_gaussians == 50000);
  CHECK(int64_t{chosen.densify.until} == 1200);  // the schedule scales with the steps
  train::RunOptions named;
  named.densify.max_gaussians = 7;
  named.exposure.samples = 33;
  run::choose_for_cpu({{"exposure.samples", "densify.max_gaussians"}}, named);
  CHECK(named.exposure.samples == 33);
  CHECK(named.densify.max_gaussians == 7);
  CHECK(named.densify.strategy == gaussians::DensifyStrategy::kMcmc);
  CHECK(named.train.iterations == 2000);
}

TEST_CASE("pace: a run that names its steps keeps all else", "[run]") {
  train::RunOptions options, before = options;
  CHECK(run::choose_for_cpu({{"train.iterations"}}, options).empty());
  CHECK(config::values(fields_of(options)) == config::values(fields_of(before)));
}

TEST_CASE("pace: restoration takes at most a third of the run", "[run]") {
  // 2,000 steps of 0.1 s with all moments.
  const auto fitted = [](double restore_s, const run::Choices& choices = {}) {
    train::RunOptions options = cpu_options();
    const auto said = run::fit_to_speed({restore_s, 0.1}, kFrames, choices, options);
    CHECK(said.empty() == (options.objective.target == Target::kEfnet &&
                           options.objective.restored_poses == RestoredPoses::kNine));
    return options.objective;
  };
  CHECK(fitted(0.24).restored_poses == RestoredPoses::kNine);  // 86 s of 263
  CHECK(fitted(0.5).restored_poses == RestoredPoses::kThree);
  CHECK(fitted(1).restored_poses == RestoredPoses::kMiddle);
  CHECK(fitted(1).target == Target::kEfnet);
  CHECK(fitted(5).target == Target::kNone);
  CHECK(fitted(5, {{"objective.target"}}).target == Target::kEfnet);
  CHECK(fitted(5, {{"objective.restored_poses"}}).restored_poses == RestoredPoses::kNine);
}

TEST_CASE("pace: a few seconds of restoration are left as they are, however short the run",
          "[run]") {
  train::RunOptions options = cpu_options();
  options.train.iterations = 2;
  CHECK(run::fit_to_speed({0.05, 0.1}, kFrames, {}, options).empty());
  CHECK(options.objective.restored_poses == RestoredPoses::kNine);
}

TEST_CASE("pace: frames without events are restored at one moment", "[run]") {
  const train::RunOptions options = cpu_options();
  CHECK(run::restored_moments({10, 3}, options) == 93);
}

TEST_CASE("pace: minutes become steps and moments", "[run]") {
  const auto fitted = [](double step_s, double restore_s, run::Choices choices = {}) {
    train::RunOptions options;
    options.train.quarter_moments_until = options.train.half_moments_until = 0;
    choices.minutes = 10;
    run::fit_to_speed({restore_s, step_s}, kFrames, choices, options);
    return options;
  };
  // 540 s of steps, with all moments if there is time for 4,000.
  CHECK(fitted(0.1, 0).train.iterations == 5400);
  CHECK(fitted(0.1, 0).exposure.samples == 17);
  const train::RunOptions slow = fitted(0.34, 0);
  CHECK(slow.exposure.samples == 9);
  CHECK(slow.train.iterations == 3000);  // a step of nine moments takes 0.18 s
  CHECK(int64_t{slow.densify.until} == 1800);
  // Restoration takes at most a third of the time, and steps get the rest.
  const train::RunOptions restored = fitted(0.1, 0.25);
  CHECK(restored.objective.restored_poses == RestoredPoses::kNine);
  CHECK(restored.exposure.samples == 17);
  CHECK(restored.train.iterations == 4500);  // nine moments of each frame take 90 s
  const train::RunOptions fewer = fitted(0.12, 0.25);
  CHECK(fewer.objective.restored_poses == RestoredPoses::kNine);
  CHECK(fewer.exposure.samples == 9);  // of 17 there would be 3,750 steps
  CHECK(fewer.train.iterations == 7080);
  CHECK(fitted(0.1, 2).objective.restored_poses == RestoredPoses::kMiddle);
  const train::RunOptions named = fitted(0.34, 0, {{"train.iterations", "exposure.samples"}});
  CHECK((named.train.iterations == 4000 && named.exposure.samples == 17));
}

TEST_CASE("pace: steps with fewer moments early make room for more", "[run]") {
  train::RunOptions options;
  run::Choices choices;
  choices.minutes = 10;
  run::fit_to_speed({0, 0.1}, kFrames, choices, options);
  // 540 s of steps that take 0.1 s with 17 moments: an eighth has 5, then 7.5 % have 9.
  CHECK(options.train.iterations == 6160);
}

TEST_CASE("pace: what a run chose stands in its config.yaml, and a resumed one goes on with it",
          "[run]") {
  const test::TinyScene scene;
  train::RunOptions options = test::tiny_options(scene);
  options.train.iterations = 4000;
  const auto folder = scene.dir / "run";
  // Only steps and moments remain to be chosen; all other options are named.
  run::Choices choices;
  for (const auto& [key, value] : config::values(fields_of(options))) choices.named.insert(key);
  choices.named.erase("train.iterations");
  choices.named.erase("exposure.samples");
  options.exposure.samples = 17;
  {
    const run::Trainer trainer(options, folder, "", choices);
    CHECK(trainer.options().train.iterations == 2000);
    CHECK(trainer.options().exposure.samples == 9);
    CHECK_THAT(read_file(folder / "config.yaml"),
               Catch::Contains("iterations: 2000") && Catch::Contains("samples: 9"));
    const std::string config = read_file(folder / "config.yaml");
    const std::string data = run::data_fingerprint(trainer.dataset());
    run::write_checkpoint(folder, run::checkpoint_of(trainer.state(), {config, data, ""}), 1);
  }
  const run::Trainer again(options, folder, "latest", choices);
  CHECK(again.options().train.iterations == 2000);
  CHECK(again.options().exposure.samples == 9);
}
