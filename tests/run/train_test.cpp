// SPDX-License-Identifier: Apache-2.0
// Properties of the alternating steps and of resuming, on a scene of three small exposures.
#include "support/catch.h"

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/random.h"
#include "jade/events/exposure_maps.h"
#include "jade/imaging/reblur.h"
#include "jade/run/checkpoint.h"
#include "jade/run/trainer.h"
#include "jade/train/routing_step.h"
#include "jade/train/step.h"
#include "run/checkpoint_entries.h"
#include "run/tiny_scene.h"
#include "support/stub_restorer.h"

using namespace jade;

namespace {

/// A run of the full objective but for F, whose place the blurry frame takes through an image
/// folder.
train::RunOptions tiny_options(const std::filesystem::path& data) {
  train::RunOptions options;
  options.device = "cpu";
  options.dataset.path = data;
  options.events.threshold_positive = 0.2;
  options.objective.target = "edi";
  options.objective.warmup = 4;
  options.objective.simulation_start = 8;
  options.init.points = 300;
  options.densify.from = 5;
  options.densify.every = 5;
  options.densify.gradient_threshold = 1e-5;
  options.densify.max_gaussians = 500;
  options.train.iterations = options.train.calendar = 20;
  options.train.log_every = 5;
  options.train.evaluate_every = 0;
  options.train.picture_every = 0;
  options.checkpoint.every = 10;
  return options;
}

using Scene = test::TinyScene;

const torch::Tensor kDraws = torch::tensor({1, 2, 3}, torch::kInt64);

/// The same with the routed target, whose restorer is a stub.
train::RunOptions routed_options(const Scene& scene) {
  train::RunOptions options = tiny_options(scene.data);
  options.objective.target = "routed";
  options.efnet.path = test::save_restorer(scene.dir / "restorer.pt",
                                           "  return 0.9 * image + 0.1 * events[:, 2:3]\n");
  options.cache.folder = scene.dir / "cache";
  return options;
}

std::vector<torch::Tensor> copies(const splat::Gaussians& gaussians) {
  std::vector<torch::Tensor> all;
  for (int i = 0; i < gaussians::kParameterCount; ++i)
    all.push_back(gaussians::parameter(gaussians, i).detach().clone());
  return all;
}

std::vector<torch::Tensor> copies(const std::vector<torch::Tensor>& tensors) {
  std::vector<torch::Tensor> all;
  for (const torch::Tensor& tensor : tensors) all.push_back(tensor.detach().clone());
  return all;
}

bool equal(const std::vector<torch::Tensor>& a, const std::vector<torch::Tensor>& b) {
  bool same = a.size() == b.size();
  for (size_t i = 0; same && i < a.size(); ++i) same = a[i].equal(b[i]);
  return same;
}

std::vector<torch::Tensor> adam_state(const train::TrainState& state) {
  auto all = copies(state.gaussian_adam.first_moments());
  for (const auto& tensor : copies(state.gaussian_adam.second_moments())) all.push_back(tensor);
  all.push_back(state.gaussian_adam.step_count().clone());
  return all;
}

/// A view and a state with a router, without a trainer around them.
struct Bench {
  train::RunOptions options;
  data::Dataset dataset;
  std::vector<train::View> views;
  train::TrainState state;

  explicit Bench(const Scene& scene) : options(tiny_options(scene.data)) {
    dataset = data::load_dataset(options.dataset);
    views = train::prepare_views(dataset, options, torch::kCPU);
    for (train::View& view : views) {
      view.restorations.efnet = view.blurry;
      view.fixed_target = torch::Tensor();
    }
    auto generator = make_generator(1, "points");
    gaussians::InitSources sources;
    for (const auto& exposure : dataset.train) {
      sources.views.push_back({exposure.poses[4], exposure.camera, exposure.blurry});
    }
    sources.near = dataset.near;
    sources.far = dataset.far;
    state.gaussians = gaussians::GaussianModel(
        gaussians::initial_gaussians(options.init, sources, generator), 1.0, torch::kCPU);
    state.gaussian_adam = gaussians::GaussianAdam(state.gaussians, options.optim);
    state.densifier =
        gaussians::Densifier(options.densify, state.gaussians, make_generator(1, "densify"));
    state.allocation = router::make_allocation({}, 3, 28, 36, make_generator(1, "router"));
    state.allocation_adam = train::ModuleAdam(state.allocation->parameters(), 5e-4);
    state.response = response::CameraResponse();
  }
};

}  // namespace

TEST_CASE("views: Eq. (7) takes the paper's c, and with 0 the calibrated one", "[run]") {
  const Scene scene;
  Bench bench(scene);
  const auto kernel = [&](double contrast) {
    bench.options.route.reblur_contrast = contrast;
    return train::prepare_views(bench.dataset, bench.options, torch::kCPU).front().reblur_kernel;
  };
  bench.options.events.threshold_positive = 0.3;
  bench.options.events.threshold_negative = 0.2;
  const data::Exposure& exposure = bench.dataset.train.front();
  const auto voxel = events::map_exposure(exposure.events, {exposure.t_start_us, exposure.t_end_us},
                                          6, {exposure.camera.height, exposure.camera.width})
                         .voxel;
  CHECK(kernel(1).equal(imaging::reblur_kernel(voxel, 1)));
  CHECK(kernel(0).equal(imaging::reblur_kernel(voxel, 0.25 * voxel.v_max)));
  CHECK_FALSE(kernel(0).equal(kernel(1)));
}

TEST_CASE("routing step: changes the router and leaves the scene and its optimiser bit-equal",
          "[run]") {
  const Scene scene;
  Bench bench(scene);
  const auto renders =
      train::render_exposure(bench.state, bench.views[0], 0, kDraws, 1, bench.options);
  CHECK(renders.color.size(0) == 9);
  const auto scene_before = copies(bench.state.gaussians.parameters());
  const auto adam_before = adam_state(bench.state);
  const auto router_before = copies(bench.state.allocation->parameters());
  const auto report =
      train::routing_step(bench.state, bench.views[0], 0, renders, bench.options.route);
  CHECK(equal(scene_before, copies(bench.state.gaussians.parameters())));
  CHECK(equal(adam_before, adam_state(bench.state)));
  CHECK_FALSE(bench.state.gaussians.gradients().means.defined());
  CHECK_FALSE(equal(router_before, copies(bench.state.allocation->parameters())));
  CHECK(report.render.defined());
  CHECK_FALSE(report.render.requires_grad());
}

TEST_CASE("scene step: changes the scene and leaves the router and its optimiser bit-equal",
          "[run]") {
  const Scene scene;
  Bench bench(scene);
  const auto renders =
      train::render_exposure(bench.state, bench.views[0], 0, kDraws, 1, bench.options);
  const auto router_before = copies(bench.state.allocation->parameters());
  const auto router_adam_before = copies(bench.state.allocation_adam.state());
  const auto scene_before = copies(bench.state.gaussians.parameters());
  const auto target = train::scene_target(bench.state, bench.views[0], 0);
  CHECK_FALSE(target.requires_grad());
  const auto terms = train::scene_step(
      bench.state, {bench.views[0], renders, target, torch::tensor({0, 3, 8}), {}}, 1,
      bench.options);
  CHECK(equal(router_before, copies(bench.state.allocation->parameters())));
  CHECK(equal(router_adam_before, copies(bench.state.allocation_adam.state())));
  CHECK_FALSE(equal(scene_before, copies(bench.state.gaussians.parameters())));
  CHECK(terms.size() == 4);  // target, blur, EDI gray and colour: the others rest in the warm-up
}

TEST_CASE("routing step: where both restorations agree no gradient reaches the allocation, Eq. (5)",
          "[run]") {
  const Scene scene;
  Bench bench(scene);
  train::View view = bench.views[0];
  view.restorations.efnet = view.restorations.edi;
  const auto renders = train::render_exposure(bench.state, view, 0, kDraws, 1, bench.options);
  const auto before = copies(bench.state.allocation->parameters());
  train::routing_step(bench.state, view, 0, renders, bench.options.route);
  CHECK(equal(before, copies(bench.state.allocation->parameters())));
}

TEST_CASE("routing step: on one view leaves the maps of the others and their Adam bit-equal",
          "[run]") {
  const Scene scene;
  Bench bench(scene);
  bench.state.allocation =
      router::make_allocation({"per_view_map", 0.5}, 3, 28, 36, make_generator(1, "router"));
  const auto maps = bench.state.allocation->parameters();
  bench.state.allocation_adam = train::ModuleAdam(maps, 5e-4);
  const auto step_on = [&](int64_t index) {
    const auto& view = bench.views[static_cast<size_t>(index)];
    const auto renders = train::render_exposure(bench.state, view, index, kDraws, 1, bench.options);
    train::routing_step(bench.state, view, index, renders, bench.options.route);
  };
  const auto alpha_of = [&](int64_t index) {
    return train::allocation_map(bench.state, bench.views[static_cast<size_t>(index)], index);
  };
  /// A view's map, its two moments and its step count.
  const auto state_of = [&](size_t view) {
    const auto adam = bench.state.allocation_adam.state();
    REQUIRE(adam.size() == 9);
    return copies(
        std::vector<torch::Tensor>{maps[view], adam[view], adam[3 + view], adam[6 + view]});
  };
  const torch::Tensor untouched = alpha_of(2);
  step_on(0);
  const torch::Tensor of_0 = alpha_of(0), of_1 = alpha_of(1);
  CHECK_FALSE(of_0.equal(untouched));
  step_on(1);
  step_on(1);
  CHECK(alpha_of(0).equal(of_0));
  CHECK(alpha_of(2).equal(untouched));
  CHECK_FALSE(alpha_of(1).equal(of_1));
  const auto of_view_0 = state_of(0), of_view_1 = state_of(1);
  CHECK(of_view_0[3].item<double>() == 1);
  CHECK(of_view_1[3].item<double>() == 2);
  step_on(1);
  CHECK(equal(state_of(0), of_view_0));
  CHECK_FALSE(equal(state_of(1), of_view_1));
  CHECK_FALSE(maps[0].grad().defined());
}

TEST_CASE("steps: the calendar decides which terms are there", "[run]") {
  const Scene scene;
  Bench bench(scene);
  const auto names_at = [&](int64_t step) {
    const auto renders =
        train::render_exposure(bench.state, bench.views[1], 1, kDraws, step, bench.options);
    std::string names;
    const auto target = train::scene_target(bench.state, bench.views[1], 1);
    for (const auto& term : train::scene_step(
             bench.state, {bench.views[1], renders, target, torch::tensor({1, 2, 3}), {}}, step,
             bench.options)) {
      names += term.name + " ";
    }
    return names;
  };
  CHECK(names_at(4) == "target blur edi_gray edi_color ");
  CHECK(names_at(6) == "target blur edi_gray edi_color intensity ");
  CHECK(names_at(9) == "target blur edi_gray edi_color simulation intensity ");
  bench.options.objective.edi_supervision = false;
  CHECK(names_at(3) == "target blur ");
}

TEST_CASE("steps: after target_until the target and the routing step rest", "[run]") {
  const Scene scene;
  Bench bench(scene);
  bench.options.objective.target = "routed";
  bench.options.objective.target_until = 2;
  const auto names_of = [&](int64_t step) {
    std::string names;
    const train::StepInputs inputs{bench.views[1], 1, torch::tensor({1, 2, 3}), {}};
    for (const auto& term : train::alternate(bench.state, inputs, step, bench.options).terms) {
      names += term.name + " ";
    }
    return names;
  };
  CHECK(names_of(2) == "target blur edi_gray edi_color route_render route_reblur ");
  const auto router = copies(bench.state.allocation->parameters());
  const auto scene_before = copies(bench.state.gaussians.parameters());
  CHECK(names_of(3) == "blur edi_gray edi_color ");
  CHECK(equal(copies(bench.state.allocation->parameters()), router));
  CHECK_FALSE(equal(copies(bench.state.gaussians.parameters()), scene_before));
}

TEST_CASE("scene step: the camera response learns from the terms that read it, and rests without",
          "[run]") {
  const Scene scene;
  Bench bench(scene);
  bench.state.response_adam = train::ModuleAdam(bench.state.response->parameters(), 1e-3);
  const auto moves_at = [&](int64_t step) {
    const auto before = copies(bench.state.response->parameters());
    const auto renders =
        train::render_exposure(bench.state, bench.views[1], 1, kDraws, step, bench.options);
    train::scene_step(bench.state, {bench.views[1], renders, {}, torch::tensor({1, 2, 3}), {}},
                      step, bench.options);
    return !equal(before, copies(bench.state.response->parameters()));
  };
  CHECK_FALSE(moves_at(4));
  CHECK(moves_at(6));
  bench.options.objective.edi_supervision = bench.options.objective.intensity = false;
  CHECK_FALSE(moves_at(6));
  CHECK(moves_at(9));
  bench.options.objective.simulation = false;
  CHECK_FALSE(moves_at(9));
}

TEST_CASE("trainer: a view without events trains", "[run]") {
  test::TinyDatasetOptions data;
  data.last_exposure_without_events = true;
  const Scene scene(data);
  train::RunOptions options = tiny_options(scene.data);
  run::Trainer trainer(options, scene.dir.path() / "run", "");
  CHECK(trainer.views().back().density.sum().item<double>() == 0);
  CHECK(trainer.views().back().restorations.edi.allclose(trainer.views().back().blurry));
  for (int i = 0; i < 6; ++i) trainer.step();
  CHECK(trainer.state().gaussians.parameters().means.isfinite().all().item<bool>());
}

TEST_CASE("trainer: twenty steps equal ten, a resume, and ten more, to the bit", "[run]") {
  const Scene scene;
  const auto whole = scene.dir.path() / "whole", halves = scene.dir.path() / "halves";
  train::RunOptions options = tiny_options(scene.data);
  run::Trainer(options, whole, "").run();
  train::RunOptions half = options;
  half.train.iterations = 10;
  run::Trainer(half, halves, "").run();
  run::Trainer(options, halves, "latest").run();
  CHECK(read_file(run::checkpoint_path(whole, 20)).size() > 0);
  const auto a = run::load_checkpoint_gaussians(run::checkpoint_path(whole, 20));
  const auto b = run::load_checkpoint_gaussians(run::checkpoint_path(halves, 20));
  CHECK(equal(copies(a), copies(b)));
  CHECK(a.size() != 300);  // densification took part
  CHECK(read_file(whole / "point_cloud.ply") == read_file(halves / "point_cloud.ply"));
}

TEST_CASE("trainer: no opacity reset falls into the last tenth of a run", "[run]") {
  const Scene scene;
  train::RunOptions options = tiny_options(scene.data);
  options.densify.until = 1000;
  options.densify.opacity_reset_every = 10;
  options.train.evaluate_every = 0;
  run::Trainer trainer(options, scene.dir.path() / "run", "");
  const auto most_opaque = [&] {
    return trainer.state().gaussians.parameters().logit_opacities.sigmoid().max().item<double>();
  };
  for (int i = 0; i < 10; ++i) trainer.step();
  CHECK(most_opaque() < 0.011);
  for (int i = 0; i < 10; ++i) trainer.step();
  CHECK(most_opaque() > 0.012);
}

TEST_CASE("trainer: a resumed run keeps the calendar it began with, whatever its new budget",
          "[run]") {
  const Scene scene;
  const auto whole = scene.dir.path() / "whole", halves = scene.dir.path() / "halves";
  train::RunOptions options = tiny_options(scene.data);
  options.objective.warmup = Steps::share(20);
  options.densify.until = Steps::share(80);
  options.train.calendar = 10;
  run::Trainer(options, whole, "").run();
  options.train.calendar = 0;
  options.train.iterations = 10;
  run::Trainer(options, halves, "").run();
  options.train.iterations = 20;
  {
    const run::Trainer trainer(options, halves, "latest");
    CHECK(trainer.options().train.calendar == 10);
    CHECK(trainer.options().objective.warmup == 2);
  }
  run::Trainer(options, halves, "latest").run();
  CHECK(read_file(whole / "point_cloud.ply") == read_file(halves / "point_cloud.ply"));
  // 2 of 10 steps and 20 % of 10 are one calendar; 3 steps are another.
  options.objective.warmup = 2;
  CHECK_NOTHROW(run::Trainer(options, halves, "latest"));
  options.objective.warmup = 3;
  CHECK_THROWS_WITH(run::Trainer(options, halves, "latest"),
                    Catch::Contains("objective.warmup: 20% -> 3"));
}

TEST_CASE("steps: poses without gradient are not rendered and do not dilute the densification",
          "[run]") {
  const Scene scene;
  Bench bench(scene);
  bench.options.objective.target = "edi";
  bench.options.objective.blur = bench.options.objective.edi_supervision = false;
  bench.options.objective.simulation = bench.options.objective.intensity = false;
  bench.views[1].fixed_target = bench.views[1].restorations.edi;
  const train::StepInputs inputs{bench.views[1], 1, kDraws, {}};
  const auto out = train::alternate(bench.state, inputs, 1, bench.options);
  CHECK(out.renders.color.size(0) == 1);
  const splat::ScreenStatistics& seen = bench.state.densifier.accumulated();
  CHECK(seen.visible_count.max().item<float>() == 1);
  CHECK(seen.gradient_norm.max().item<float>() > 0);
}

TEST_CASE("trainer: whatever a checkpoint holds, a run that goes on from it does so to the bit",
          "[run]") {
  struct Case {
    std::string name;
    std::function<void(train::RunOptions&)> change;
    /// What this case is there for: entries that must move between the two checkpoints.
    std::vector<std::string> moved;
  };
  const auto allocate = [](const std::string& kind) {
    return [kind](train::RunOptions& o) { o.allocation.kind = kind; };
  };
  const std::vector<Case> cases{
      {"router",
       allocate("router"),
       {"allocation.router.", "allocation.adam.", "gaussians.", "adam.", "crf.layer", "crf.adam."}},
      {"per_view_map",
       allocate("per_view_map"),
       {"allocation.logits_0", "allocation.logits_1", "allocation.logits_2", "allocation.adam."}},
      {"poses",
       [](train::RunOptions& o) {
         o.poses.optimize = "cubic";
         o.poses.accumulate = 3;
         o.poses.test_fit_steps = 0;
       },
       {"poses.twists", "poses.adam.", "poses.gradient."}},
      {"mcmc", [](train::RunOptions& o) { o.densify.strategy = "mcmc"; }, {"densify.generator"}},
      {"L_ev",
       [](train::RunOptions& o) {
         o.objective.event_loss_weight = 0.1;
         o.objective.event_window = "recording";
       },
       {"gaussians."}}};
  const Scene scene;
  for (const Case& each : cases) {
    INFO(each.name);
    train::RunOptions options = routed_options(scene);
    each.change(options);
    const auto whole = scene.dir / (each.name + "-whole"), resumed = scene.dir / each.name;
    run::Trainer(options, whole, "").run();
    const auto middle = run::checkpoint_path(whole, 10), end = run::checkpoint_path(whole, 20);
    run::Trainer(options, resumed, middle.string()).run();
    CHECK(test::differing_entries(run::checkpoint_path(resumed, 20), end) ==
          std::set<std::string>());
    const auto moved = test::differing_entries(middle, end);
    for (const std::string& prefix : each.moved) {
      INFO(prefix);
      CHECK(test::any_begins_with(moved, prefix));
    }
  }
}

TEST_CASE("checkpoint: maps of another number of views are refused", "[run]") {
  const Scene scene;
  Bench bench(scene);
  const auto maps = [](int64_t views) {
    return router::make_allocation({"per_view_map", 0.5}, views, 28, 36, make_generator(1, "maps"));
  };
  bench.state.allocation = maps(3);
  bench.state.allocation_adam = train::ModuleAdam(bench.state.allocation->parameters(), 5e-4);
  run::save_checkpoint(scene.dir / "run", bench.state, {"config", "data", ""}, 1);
  const auto load = [&](int64_t views) {
    run::load_checkpoint_allocation(run::checkpoint_path(scene.dir / "run", 0), *maps(views));
  };
  CHECK_NOTHROW(load(3));
  CHECK_THROWS_AS(load(4), CheckpointError);
  CHECK_THROWS_WITH(load(2), Catch::Contains("expected 2 parameters of 'allocation', found 3"));
}

TEST_CASE("trainer: a corrupt newest checkpoint falls back to the one before", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  train::RunOptions options = tiny_options(scene.data);
  run::Trainer(options, run, "").run();
  const auto newest = run::checkpoint_path(run, 20);
  std::string bytes = read_file(newest);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  std::ofstream(newest, std::ios::binary) << bytes;
  CHECK_THROWS_AS(run::load_checkpoint_gaussians(newest), CheckpointError);
  {
    run::Trainer trainer(options, run, "latest");
    CHECK(trainer.state().step == 10);
  }
  for (const size_t size : {size_t{0}, size_t{100}, bytes.size() - 30}) {
    std::ofstream(newest, std::ios::binary) << bytes.substr(0, size);
    CHECK_THROWS_AS(run::load_checkpoint_gaussians(newest), CheckpointError);
  }
}

TEST_CASE("trainer: refuses to resume with other settings or data, and says which", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  train::RunOptions options = tiny_options(scene.data);
  options.train.iterations = 3;
  run::Trainer(options, run, "").run();
  CHECK_THROWS_WITH(run::Trainer(options, run, ""), Catch::Contains("holds a run already"));
  options.train.iterations = 5;
  CHECK_NOTHROW(run::Trainer(options, run, "latest"));
  options.objective.dssim = 0.2;
  CHECK_THROWS_WITH(run::Trainer(options, run, "latest"),
                    Catch::Contains("objective.dssim: 0.3 -> 0.2"));
  options.objective.dssim = 0.3;
  test::TinyDatasetOptions other;
  other.last_exposure_without_events = true;
  std::filesystem::remove_all(scene.data);
  test::write_tiny_dataset(scene.data, other);
  CHECK_THROWS_WITH(run::Trainer(options, run, "latest"), Catch::Contains("other data"));
}

TEST_CASE("trainer: refuses to resume with another restorer, wherever its file lies", "[run]") {
  const Scene scene;
  const auto run = scene.dir / "run";
  train::RunOptions options = routed_options(scene);
  options.train.iterations = 3;
  run::Trainer(options, run, "").run();
  const std::string expected = file_sha256(options.efnet.path);
  CHECK_THAT(read_file(run / "env.json"), Catch::Contains(expected));
  options.efnet.path = scene.dir / "moved.pt";
  std::filesystem::rename(scene.dir / "restorer.pt", options.efnet.path);
  CHECK_NOTHROW(run::Trainer(options, run, "latest"));
  const auto other = test::save_restorer(options.efnet.path, "  return 0.8 * image\n");
  const auto resume = [&] { run::Trainer(options, run, "latest"); };
  CHECK_THROWS_AS(resume(), CheckpointError);
  CHECK_THROWS_WITH(resume(), Catch::Contains(expected) && Catch::Contains(file_sha256(other)) &&
                                  Catch::Contains("efnet.path"));
  // What needs no restorer does not look at one.
  train::RunOptions plain = tiny_options(scene.data);
  plain.train.iterations = 3;
  run::Trainer(plain, scene.dir / "plain", "").run();
  CHECK_THAT(read_file(scene.dir / "plain" / "env.json"), !Catch::Contains("restorer_sha256"));
  plain.efnet.path = scene.dir / "nowhere.pt";
  CHECK_NOTHROW(run::Trainer(plain, scene.dir / "plain", "latest"));
}

TEST_CASE(
    "trainer: a checkpoint without the restorer's hash loads with a warning, but is no way "
    "around a newer one that has it",
    "[run]") {
  const Scene scene;
  const auto run = scene.dir / "run";
  train::RunOptions options = routed_options(scene);
  run::Trainer(options, run, "").run();
  const auto older = run::checkpoint_path(run, 10);
  // As a program wrote it that did not keep the hash.
  {
    const run::Trainer trainer(options, scene.dir / "same", older.string());
    const auto entries = test::checkpoint_entries(older);
    const auto text = [&](const std::string& name) {
      const torch::Tensor& bytes = entries.at(name);
      return std::string(static_cast<const char*>(bytes.data_ptr()),
                         static_cast<size_t>(bytes.numel()));
    };
    run::save_checkpoint(run, trainer.state(), {text("config"), text("data_fingerprint"), ""}, 2);
  }
  CHECK(test::checkpoint_entries(older).count("restorer_sha256") == 0);
  const auto said = scene.dir / "said.txt";
  const auto step_of = [&](const std::string& resume) {
    set_log_file(said);
    return run::Trainer(options, run, resume).state().step;
  };
  CHECK(step_of(older.string()) == 10);
  CHECK_THAT(read_file(said), Catch::Contains("no hash of the restorer"));
  test::save_restorer(options.efnet.path, "  return 0.8 * image\n");
  CHECK_THROWS_AS(step_of("latest"), CheckpointError);
  set_log_file({});
}

TEST_CASE("trainer: two runs in one folder are refused while the first is alive", "[run]") {
  const test::TempDir dir;
  auto first = std::make_unique<run::RunDirectory>(dir.path() / "run");
  CHECK_THROWS_WITH(run::RunDirectory(dir.path() / "run"), Catch::Contains("another process"));
  first.reset();
  CHECK_NOTHROW(run::RunDirectory(dir.path() / "run"));
}

TEST_CASE("trainer: an interrupt saves the finished step", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  set_interrupt_requested(true);
  const auto interrupted = [&] {
    train::RunOptions options = tiny_options(scene.data);
    options.train.iterations = 1000;
    // The interrupt is seen after the first step; view preparation would honour it as well.
    set_interrupt_requested(false);
    run::Trainer trainer(options, run, "");
    set_interrupt_requested(true);
    trainer.run();
  };
  CHECK_THROWS_AS(interrupted(), Interrupted);
  set_interrupt_requested(false);
  CHECK(run::list_checkpoints(run) == std::vector{run::checkpoint_path(run, 1)});
}

TEST_CASE("trainer: a run leaves the documented files", "[run]") {
  const Scene scene;
  const auto run = scene.dir.path() / "run";
  run::Trainer(tiny_options(scene.data), run, "").run();
  for (const char* name : {"config.yaml", "env.json", "train.log", "metrics.jsonl",
                           "point_cloud.ply", "eval.json", "report.html", "images/test_03.png"}) {
    INFO(name);
    CHECK(std::filesystem::exists(run / name));
  }
  std::ifstream metrics(run / "metrics.jsonl");
  int lines = 0;
  for (std::string line; std::getline(metrics, line); ++lines) {
    const auto object = nlohmann::json::parse(line);
    for (const char* key : {"step", "loss", "blur", "psnr_train", "gaussians", "memory_bytes"}) {
      INFO(key);
      CHECK(object.contains(key));
    }
  }
  CHECK(lines == 4);
  // Both test views are taken after the last exposure.
  const auto scores = nlohmann::json::parse(read_file(run / "eval.json"));
  for (const auto& view : scores["views"]) CHECK(view["seen"] == false);
  CHECK(scores["mean_unseen"] == scores["mean"]);
  CHECK(scores["mean_seen"].is_null());
  CHECK_THAT(read_file(run / "report.html"), Catch::Contains("test view 04, not seen in training"));
}

TEST_CASE("term monitor: names the step and the term that first stopped being finite", "[run]") {
  run::TermMonitor monitor;
  const auto watch = [&](int64_t step, double blur, double target) {
    monitor.watch({{"blur", torch::tensor(blur)}, {"target", torch::tensor(target)}}, step);
  };
  watch(5, 1, 2);
  watch(6, 1, 2);
  CHECK_NOTHROW(monitor.check());
  watch(7, 1, std::numeric_limits<double>::quiet_NaN());
  watch(8, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN());
  CHECK_THROWS_WITH(monitor.check(), Catch::Contains("step 7") && Catch::Contains("target") &&
                                         !Catch::Contains("blur"));
}

TEST_CASE("view order: every epoch shows every view once, whatever the step it is asked from",
          "[run]") {
  train::ViewOrder order(3, 7), late(3, 7);
  std::vector<int64_t> seen;
  for (int64_t step = 8; step <= 14; ++step) seen.push_back(order.at(step));
  CHECK(late.at(14) == seen.back());
  std::sort(seen.begin(), seen.end());
  CHECK(seen == std::vector<int64_t>{0, 1, 2, 3, 4, 5, 6});
  train::PoseDraws draws(3, torch::kCPU), same(3, torch::kCPU);
  const auto at_2000 = draws.at(2000);
  same.at(1);
  CHECK(same.at(2000).equal(at_2000));
}

TEST_CASE("options: rules between fields name the keys", "[run]") {
  train::RunOptions options;
  CHECK_NOTHROW(train::validate(options));
  options.events.bins = 5;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("events.bins"));
  options.events.bins = 6;
  options.route.render_consistency = options.route.reblur_consistency = false;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("route.render_consistency"));
  options.allocation.kind = "constant";
  CHECK_NOTHROW(train::validate(options));
  options.objective.blur = options.objective.edi_supervision = options.objective.intensity = false;
  options.objective.simulation = false;
  CHECK_NOTHROW(train::validate(options));
  options.objective.target_until = 100;
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("step 101"));
  options.train.iterations = 100;
  CHECK_NOTHROW(train::validate(options));
  options.objective.target = "none";
  CHECK_THROWS_WITH(train::validate(options), Catch::Contains("step 1,"));
}

TEST_CASE("options: the calendar follows the number of steps", "[run]") {
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
