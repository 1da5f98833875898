// SPDX-License-Identifier: Apache-2.0
#include "jade/train/options.h"

#include "support/catch.h"

#include <map>

#include "jade/config/config.h"
#include "jade/core/error.h"

using namespace jade;

TEST_CASE("options: rules between fields name the keys", "[train]") {
  train::RunOptions options = train::printed_options();
  CHECK_NOTHROW(train::validate(options));
  options.densify.until = 400;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("densify.until"));
  options.densify.until = 0;
  CHECK_NOTHROW(train::validate(options));
  options.route.render_consistency = options.route.reblur_consistency = false;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("route.render_consistency"));
  options.objective.target = losses::Target::kMean;
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

TEST_CASE("options: all poses are refused where only the middle is known", "[train]") {
  train::RunOptions options;
  options.objective.restored_poses = losses::RestoredPoses::kNine;
  CHECK_NOTHROW(train::validate(options));
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
  train::RunOptions options = train::printed_options();
  options.exposure.samples = 10;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("exposure.samples"));
  options.exposure.samples = 17;
  CHECK_NOTHROW(train::validate(options));
  options.events.edi_samples = 64;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("events.edi_samples"));
  options.events.edi_samples = 65;
  CHECK_NOTHROW(train::validate(options));
}

TEST_CASE("options: exposures of a DiET-GS release are nine equal moments whatever is asked for",
          "[train]") {
  train::RunOptions options;
  options.exposure.quadrature = geometry::QuadratureRule::kTrapezoid;
  options.exposure.samples = 17;
  options.events.edi_samples = 65;
  data::Dataset dataset;
  dataset.kind = data::DatasetKind::kEvDeblur;
  train::apply_dataset(dataset, options);
  CHECK(options.exposure.samples == 17);
  dataset.kind = data::DatasetKind::kDietGs;
  train::apply_dataset(dataset, options);
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
  // The paper's number of steps gives the paper's schedule.
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

TEST_CASE("options: keys that became constants are read with their value alone", "[train]") {
  // The constants as listed in older configurations.
  const std::string inherited = R"(
events: {bins: 6}
cache: {max_mib: 2048}
init: {opacity: 0.1, scale: 1}
optim: {position_lr_start: 1.6e-4, position_lr_end: 1.6e-06, position_lr_max_steps: 600%, sh_rest_lr: 0.000125, beta1: 0.9, beta2: 0.999, eps: 1e-15}
densify:
  {from: 2%, split_scale: 0.01, prune_opacity: 0.005, prune_scale: 0.1, opacity_reset_every: 12%,
   mcmc: {noise_lr: 5e+05, growth: 0.05, opacity_regularization: 0.01, scale_regularization: 0.01}}
poses: {lr_max_steps: 120%, prior_px: 0, prior_weight: 0.00025}
gains: {lr: 0.001, prior_weight: 0.01}
route: {every: 1}
objective:
  {target_weight_final: -1, edi_weight: 1, simulation_start: 28%, event_pixels: 1024, event_window: exposure, event_window_share: 0.125}
train: {sh_degree_every: 4%, cuda_graph: true}
checkpoint: {keep: 2}
)";
  train::RunOptions options;
  const auto read = [&](const std::string& text) {
    config::read_text(text, "old.yaml", fields_of(options));
  };
  CHECK_NOTHROW(read(inherited));
  CHECK_NOTHROW(read("poses: {lr_final: 3e-06, lr: 3e-4}"));
  CHECK_NOTHROW(read("poses: {lr: 0.001, lr_final: 1e-05}"));
  CHECK_NOTHROW(read("optim: {position_lr_start: 3.2e-4, position_lr_end: 3.2e-6}"));
  for (const char* other : {"events.bins: 8", "densify.from: 500", "densify.from: 3%",
                            "poses.prior_px: 1", "poses.lr_final: 1e-4", "route.every: 4",
                            "objective.event_window: recording", "train.cuda_graph: false"}) {
    const std::string line = other;
    const size_t dot = line.find('.');
    INFO(line);
    CHECK_THROWS_WITH(read(line.substr(0, dot) + ": {" + line.substr(dot + 1) + "}"),
                      Catch::Contains(line.substr(0, line.find(':')) + ": expected ") &&
                          Catch::Contains("CHANGELOG.md"));
  }
  auto fields = fields_of(options);
  for (const Field& field : fields.fields()) {
    CHECK(fields.fixed_value(field.key) == nullptr);
  }
}

namespace {

const std::string kConfigs = std::string(JADE_SOURCE) + "/configs/";

/// "key=value" for every value of `found` that differs from `expected`.
std::vector<std::string> differences(train::RunOptions found, train::RunOptions expected) {
  train::settle(found);
  train::settle(expected);
  const auto values = config::values(fields_of(found)),
             others = config::values(fields_of(expected));
  std::vector<std::string> keys;
  for (size_t i = 0; i < values.size(); ++i) {
    if (values[i] != others[i]) keys.push_back(values[i].first + "=" + values[i].second);
  }
  return keys;
}

}  // namespace

TEST_CASE("presets: base.yaml says what the program does by itself", "[train]") {
  const std::vector<std::string> none;
  const config::Sources base{kConfigs + "base.yaml", {}, {}};
  CHECK(differences(config::load<train::RunOptions>(base), {}) == none);
  // Complete: the program adds no value.
  CHECK(differences(config::load(base, train::printed_options()), {}) == none);
  CHECK_NOTHROW(train::validate({}));
}

TEST_CASE("presets: paper.yaml over what we recommend is the method as printed", "[train]") {
  const auto paper = [](const std::vector<std::filesystem::path>& layers) {
    return config::load<train::RunOptions>({kConfigs + "paper.yaml", {}, layers});
  };
  const std::map<std::string, std::string> printed{
      // The paper's table of settings, and Eq. (3), (6), (7), (9) and (10).
      {"train.iterations", "25000"},
      {"route.reblur_contrast", "1"},
      {"route.lr", "5e-04"},
      {"objective.target_weight", "1"},
      {"objective.dssim", "0.3"},
      {"objective.warmup", "6%"},
      {"route.render_consistency", "true"},
      {"route.reblur_consistency", "true"},
      {"route.reblur_weight", "1"},
      {"exposure.samples", "9"},
      {"exposure.quadrature", "equal"},
      {"allocation.kind", "router"},
      {"objective.target", "routed"},
      {"objective.target_until", "0"},
      {"objective.blur", "true"},
      {"objective.edi_supervision", "true"},
      {"objective.simulation", "true"},
      {"objective.intensity", "true"},
      {"objective.event_loss_weight", "0"},
      // Inherited: unscaled events, poses of the data.
      {"objective.edi_weight_final", "-1"},
      {"objective.edi_contrast", "1"},
      {"objective.trust.agreement", "0"},
      {"events.edi_samples", "0"},
      {"events.ramp_ms", "0"},
      {"poses.optimize", "none"},
      {"response.enabled", "true"},
      {"response.lr", "1e-07"},
      // Clone and split of 3DGS over 25,000 steps; it has no limit, and this one is not reached.
      {"densify.strategy", "adc"},
      {"densify.statistics", "first_pose"},
      {"densify.until", "60%"},
      {"densify.every", "0.4%"},
      {"densify.gradient_threshold", "2e-04"},
      {"densify.max_gaussians", "1000000"},
      {"optim.position_lr_start", "0.00016"},
      {"optim.sh_dc_lr", "0.0025"},
      {"optim.opacity_lr", "0.05"},
      {"optim.scale_lr", "0.005"},
      {"optim.rotation_lr", "0.001"}};
  train::RunOptions options = paper({});
  std::map<std::string, std::string> found;
  for (const auto& [key, value] : config::values(fields_of(options))) {
    if (printed.count(key) > 0) found[key] = value;
  }
  CHECK(found == printed);
  // The constants of the method, which have no keys.
  CHECK(events::kVoxelBins == 6);
  CHECK(losses::kEdiWeight == 1);
  CHECK(options.objective.simulation_start.percent() == 28);
  CHECK(options.densify.from.percent() == 2);
  CHECK(gaussians::kSplitScale == 0.01);
  CHECK(gaussians::kPruneOpacity == 0.005);
  CHECK(gaussians::kPruneScale == 0.1);
  CHECK(options.densify.opacity_reset_every.percent() == 12);
  CHECK(gaussians::kPositionLrFall == 100);
  CHECK(options.optim.position_lr_max_steps.percent() == 600);
  CHECK(options.optim.sh_rest_lr == 0.000125);
  CHECK(options.train.sh_degree_every.percent() == 4);
  CHECK(gaussians::kStartOpacity == 0.1);
  CHECK(differences(options, train::printed_options()) ==
        std::vector<std::string>{"densify.statistics=first_pose"});
  CHECK(
      differences(paper({kConfigs + "ablation/full.yaml"}), train::printed_options()) ==
      std::vector<std::string>{"densify.gradient_threshold=5e-04", "densify.max_gaussians=200000"});
}
