// SPDX-License-Identifier: Apache-2.0
// Whole runs on a GPU: captured steps against eager ones, and bit-exact resuming.
#include "support/catch.h"

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/run/checkpoint.h"
#include "jade/run/trainer.h"
#include "run/checkpoint_entries.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

/// Every term is active; with another target there is no routing step.
train::RunOptions gpu_options(const test::TinyScene& scene,
                              losses::Target target = losses::Target::kRouted) {
  train::RunOptions options = test::full_options(scene);
  options.device = "cuda";
  options.objective.target = target;
  options.train.sh_degree_every = 8;
  options.train.log_every = 1;
  return options;
}

double mean_difference(const torch::Tensor& a, const torch::Tensor& b) {
  return ((a - b).abs().mean() / b.abs().mean()).item<double>();
}

/// θ as one vector on the CPU; empty without a router.
torch::Tensor theta(const run::Trainer& trainer) {
  std::vector<torch::Tensor> all{torch::empty({0})};
  if (const auto& allocation = trainer.state().allocation) {
    for (const torch::Tensor& p : allocation->parameters()) all.push_back(p.detach().flatten());
  }
  for (torch::Tensor& values : all) values = values.cpu();
  return torch::cat(all);
}

/// The routing step's terms by step and name, from a run's log.
std::map<std::string, double> route_terms(const std::filesystem::path& run) {
  std::map<std::string, double> terms;
  std::ifstream metrics(run / "metrics.jsonl");
  for (std::string line; std::getline(metrics, line);) {
    const auto object = nlohmann::json::parse(line);
    for (const char* name : {"route_render", "route_reblur"}) {
      if (object.contains(name)) terms[object["step"].dump() + name] = object[name];
    }
  }
  return terms;
}

}  // namespace

TEST_CASE("trainer: recorded steps agree with eager ones across warm-up and densification",
          "[run][cuda]") {
  const test::TinyScene scene;
  const losses::Target target = GENERATE(losses::Target::kEdi, losses::Target::kRouted);
  INFO(word_of(target));
  train::RunOptions options = gpu_options(scene, target);
  run::Trainer recorded(options, scene.dir.path() / "recorded", "");
  options.train.cuda_graph = false;
  run::Trainer eager(options, scene.dir.path() / "eager", "");
  const torch::Tensor start = theta(eager);
  CHECK(theta(recorded).equal(start));
  for (int i = 0; i < 9; ++i) {
    recorded.step();
    recorded.densify();
    eager.step();
    eager.densify();
  }
  CHECK(eager.replays() == 0);
  CHECK(recorded.replays() > 4);
  const auto& a = recorded.state().gaussians.parameters();
  const auto& b = eager.state().gaussians.parameters();
  REQUIRE(a.size() == b.size());
  CHECK(mean_difference(a.means, b.means) < 1e-4);
  CHECK(mean_difference(a.sh, b.sh) < 1e-2);
  if (target == losses::Target::kRouted) {
    // Its losses' gradients depend on signs only, so θ hardly depends on the last bits of a render:
    // on the CPU, noise of 1e-4 on all parameters of the Gaussians, at every step, changes the
    // direction of its path by 1e-3.
    const torch::Tensor way = theta(eager) - start;
    CHECK(way.abs().max().item<double>() > 1e-3);
    CHECK((theta(recorded) - theta(eager)).norm().item<double>() <
          0.02 * way.norm().item<double>());
    const auto of_recorded = route_terms(scene.dir / "recorded");
    CHECK(of_recorded.size() == 18);
    for (const auto& [name, value] : route_terms(scene.dir / "eager")) {
      INFO(name);
      CHECK(of_recorded.at(name) == Approx(value).epsilon(1e-3));
    }
  }
  for (int i = 0; i < 20; ++i) recorded.step(), recorded.densify();
  CHECK(recorded.replays() > 15);
  CHECK(recorded.state().gaussians.size() != 300);
  CHECK(recorded.state().gaussians.parameters().sh.isfinite().all().item<bool>());
}

TEST_CASE("trainer: a deterministic run on a GPU resumes to the bit", "[run][cuda]") {
  const test::TinyScene scene;
  train::RunOptions options = gpu_options(scene);
  options.deterministic = true;
  const auto whole = scene.dir.path() / "whole", resumed = scene.dir.path() / "resumed";
  run::Trainer(options, whole, "").run();
  const auto middle = run::checkpoint_path(whole, 20), end = run::checkpoint_path(whole, 30);
  run::Trainer(options, resumed, middle.string()).run();
  CHECK(test::differing_entries(run::checkpoint_path(resumed, 30), end) == std::set<std::string>());
  CHECK(read_file(whole / "point_cloud.ply") == read_file(resumed / "point_cloud.ply"));
  const auto moved = test::differing_entries(middle, end);
  for (const char* prefix : {"state.gaussians.", "state.allocation.module.",
                             "state.allocation.adam.", "state.response.adam."}) {
    INFO(prefix);
    CHECK(test::any_begins_with(moved, prefix));
  }
}
