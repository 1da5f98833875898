// SPDX-License-Identifier: Apache-2.0
#include "jade/train/step_graph.h"

#include "support/catch.h"

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <torch/types.h>

#include "jade/train/event_windows.h"
#include "train/bench.h"

using namespace jade;

namespace {

/// The terms of a step by name, on the CPU.
std::map<std::string, double> values_of(const train::StepOutputs& out) {
  std::map<std::string, double> values;
  for (const auto& term : out.terms) values[term.name] = term.value.item<double>();
  return values;
}

/// Target and cameras of a captured step.
struct GraphCase {
  bool routed = true;
  train::PosePath path = train::PosePath::kNone;
  train::PoseStart start = train::PoseStart::kLine;
};

/// All terms of a case, and the inputs of steps after the warm-up.
struct GraphBench : test::Bench {
  GraphBench(const test::TinyScene& scene, const GraphCase& graph_case)
      : Bench(scene, torch::Device(torch::kCUDA, 0)), windows_options(options.objective) {
    options.objective.event_loss_weight = 0.1;
    // The test compares one step's terms, so the states of two benches must not drift apart.
    options.densify.strategy = gaussians::DensifyStrategy::kNone;
    gaussians::OptimOptions& optim = options.optim;
    for (double* lr :
         {&optim.position_lr_start, &optim.sh_dc_lr, &optim.sh_rest_lr, &optim.opacity_lr,
          &optim.scale_lr, &optim.rotation_lr, &options.route.lr, &options.response.lr}) {
      *lr = 1e-20;
    }
    options.poses.optimize = graph_case.path;
    options.poses.start = graph_case.start;
    if (!graph_case.routed) {
      options.objective.target = losses::Target::kEdi;
      for (train::View& view : views) view.fixed_target = view.restorations.edi;
    }
    const torch::Device device(torch::kCUDA, 0);
    state = train::make_state(options, dataset, device);
    if (state.poses) {
      // Each exposure's path has a different correction.
      const torch::NoGradGuard no_grad;
      torch::manual_seed(4);
      torch::Tensor twists = state.poses->twists();
      twists.add_((0.1 * torch::randn(twists.sizes(), torch::kFloat64)).to(device));
    }
    windows = std::make_unique<train::EventWindows>(dataset, windows_options, 1, device);
  }

  train::StepInputs inputs(int64_t step) const {
    train::StepInputs in = Bench::inputs(0, step);
    in.events = windows->at(20, 0);  // the same at every step
    in.events.color_filter = torch::zeros({28, 36, 3}, torch::kBool).to(in.view.measured.device());
    in.events.color_filter.select(2, 1).fill_(true);
    return in;
  }

  losses::ObjectiveOptions windows_options;
  std::unique_ptr<train::EventWindows> windows;
};

/// Other valid values of the same shape.
torch::Tensor changed(const std::string& name, const torch::Tensor& tensor) {
  if (name == "pose_draws") return (tensor + 3) % geometry::kExposurePoses;
  if (name == "view.u") return 1 - tensor;
  if (name == "events.u") return 0.8 - 0.6 * tensor;
  if (name == "view_pick") return (tensor + 1) % 3;
  if (name == "events.pixels") return tensor.flip(0).remainder(7);
  if (tensor.scalar_type() == torch::kBool) return tensor.logical_not();
  if (name.find("camera_from_world") != std::string::npos) {
    torch::Tensor moved = tensor.clone();
    moved.select(-1, 3).narrow(-1, 0, 1).add_(0.05);
    return moved;
  }
  return tensor.is_floating_point() ? tensor * 1.2 + 0.01 : tensor * 2;
}

/// Difference of the terms of two steps: the largest difference relative to the larger value.
double distance(const std::map<std::string, double>& a, const std::map<std::string, double>& b) {
  REQUIRE(a.size() == b.size());
  double largest = 0;
  for (const auto& [name, value] : a) {
    const double other = b.at(name);
    largest = std::max(
        largest, std::abs(value - other) / std::max({std::abs(value), std::abs(other), 1e-6}));
  }
  return largest;
}

}  // namespace

TEST_CASE("step graph: plans that alternate are replayed, each from its own recording",
          "[train][cuda]") {
  const train::StreamScope stream(torch::Device(torch::kCUDA, 0));
  const test::TinyScene scene;
  GraphBench recorded(scene, GraphCase{true}), eager(scene, GraphCase{true});
  // The routing step is taken at every other step.
  const auto plan = [](const GraphBench& bench, int64_t step) {
    train::StepPlan found = bench.plan(step);
    found.route = found.route && step % 2 == 1;
    return found;
  };
  train::StepGraph graph;
  for (int64_t step = 21; step < 33; ++step) {
    INFO(step);
    const train::StepInputs in = recorded.inputs(step);
    const auto replayed =
        values_of(graph.run(recorded.state, in, plan(recorded, step), recorded.options));
    const auto expected =
        values_of(train::alternate(eager.state, in, plan(eager, step), eager.options));
    CHECK(replayed.count("route_render") == static_cast<size_t>(step % 2));
    CHECK(distance(replayed, expected) < 1e-3);
  }
  CHECK(graph.replays() == 10);  // all but the first step of each plan
}

TEST_CASE("step graph: another scene, or a release, is recorded without an eager step",
          "[train][cuda]") {
  const train::StreamScope stream(torch::Device(torch::kCUDA, 0));
  const test::TinyScene scene;
  GraphBench recorded(scene, GraphCase{true}), eager(scene, GraphCase{true});
  train::StepGraph graph;
  for (int64_t step = 21; step < 31; ++step) {
    INFO(step);
    if (step == 26) {
      for (GraphBench* bench : {&recorded, &eager}) {
        bench->state.gaussians.replace(
            gaussians::map_parameters(bench->state.gaussians.detached(),
                                      [](const torch::Tensor& each) { return 1.1 * each; }));
      }
    }
    if (step == 28) graph.release(recorded.state, torch::Device(torch::kCUDA, 0));
    const train::StepInputs in = recorded.inputs(step);
    const auto replayed =
        values_of(graph.run(recorded.state, in, recorded.plan(step), recorded.options));
    const auto expected =
        values_of(train::alternate(eager.state, in, eager.plan(step), eager.options));
    CHECK(distance(replayed, expected) < 1e-3);
  }
  CHECK(graph.replays() == 9);  // all but the very first
}

TEST_CASE("step graph: without a device every step runs eagerly", "[train]") {
  const test::TinyScene scene;
  test::Bench bench(scene);
  train::StepGraph graph;
  for (int64_t step = 1; step <= 3; ++step) {
    graph.run(bench.state, bench.inputs(0, step), bench.plan(step), bench.options);
  }
  CHECK(graph.replays() == 0);
  CHECK(bench.state.gaussian_adam.step_count().item<int64_t>() == 3);
}

TEST_CASE("step graph: what changes in any tensor of the inputs changes a replay as an eager step",
          "[train][cuda]") {
  using train::PosePath;
  using train::PoseStart;
  const GraphCase graph_case = GENERATE(GraphCase{true}, GraphCase{false},
                                        GraphCase{true, PosePath::kCubic, PoseStart::kData},
                                        GraphCase{false, PosePath::kLinear, PoseStart::kData},
                                        GraphCase{true, PosePath::kCubic, PoseStart::kLine});
  const bool routed = graph_case.routed, learned = graph_case.path != PosePath::kNone;
  const train::StreamScope stream(torch::Device(torch::kCUDA, 0));
  const test::TinyScene scene;
  GraphBench recorded(scene, graph_case), eager(scene, graph_case);
  train::StepGraph graph;
  int64_t step = 20;  // past the warm-up, between two SH degrees and renewals
  /// The terms of the next step, replayed and eager, with one input changed.
  const auto both = [&](const std::string& name) {
    ++step;
    train::StepInputs in = recorded.inputs(step);
    in.visit([&](const std::string& each, torch::Tensor& tensor) {
      if (each == name) tensor = changed(name, tensor);
    });
    const train::StepPlan plan = recorded.plan(step);
    const auto replayed = values_of(graph.run(recorded.state, in, plan, recorded.options));
    return std::pair(replayed,
                     values_of(train::alternate(eager.state, in, eager.plan(step), eager.options)));
  };
  for (int i = 0; i < 3; ++i) both("");
  REQUIRE(graph.replays() == 2);
  std::vector<std::string> names;
  recorded.inputs(1).visit([&](const std::string& name, const torch::Tensor& tensor) {
    if (tensor.defined()) names.push_back(name);
  });
  std::set<std::string> felt;
  for (const std::string& name : names) {
    INFO(name);
    const auto [before_replay, before] = both("");
    const auto [after_replay, after] = both(name);
    const double change = distance(before, after);
    CHECK(distance(before_replay, before) < 1e-3);
    CHECK(distance(after_replay, after) < 1e-3 + 0.02 * change);
    // Well above the allowed difference between replayed and eager steps.
    if (change > 0.003) felt.insert(name);
  }
  CHECK(graph.replays() == 2 + 2 * static_cast<int64_t>(names.size()));
  // The change must affect a step, or the comparison would be meaningless.
  for (const char* name : {"view.measured", "view.window_mean", "edi_factors.gray",
                           "view.restorations.edi", "view.cameras.intrinsics", "pose_draws",
                           "events.counts", "events.pixels", "events.color_filter"}) {
    INFO(name);
    const bool target_of_its_own = !routed && name == std::string("view.restorations.edi");
    CHECK(felt.count(name) == (target_of_its_own ? 0 : 1));
  }
  const bool reads_data = !learned || graph_case.start == PoseStart::kData;
  CHECK(felt.count("view.cameras.camera_from_world") == (reads_data ? 1 : 0));
  for (const char* name : {"view.u", "events.u", "view_pick"}) {
    INFO(name);
    CHECK(felt.count(name) == (learned ? 1 : 0));
  }
  CHECK(felt.count("view.reblur_kernel") == (routed ? 1 : 0));
  CHECK(felt.count("view.restorations.efnet") == (routed ? 1 : 0));
  CHECK(felt.count("view.fixed_target") == (routed ? 0 : 1));
}

TEST_CASE("step graph: learned poses take the gradients of replays as of eager steps, and learn",
          "[train][cuda]") {
  const auto start = GENERATE(train::PoseStart::kData, train::PoseStart::kLine);
  const train::StreamScope stream(torch::Device(torch::kCUDA, 0));
  const test::TinyScene scene;
  const GraphCase graph_case{true, train::PosePath::kCubic, start};
  GraphBench recorded(scene, graph_case), eager(scene, graph_case);
  train::StepGraph graph;
  const auto same = [&](const char* what, const torch::Tensor& a, const torch::Tensor& b) {
    INFO(what);
    const double size = std::max(1e-12, b.abs().max().item<double>());
    CHECK((a - b).abs().max().item<double>() < 1e-2 * size);
  };
  for (int64_t step = 21; step <= 34; ++step) {
    train::StepInputs in = recorded.inputs(step), other = eager.inputs(step);
    const int64_t view = step % 3;
    for (train::StepInputs* each : {&in, &other}) each->view_pick.fill_(view);
    in.view = recorded.views[static_cast<size_t>(view)];
    other.view = eager.views[static_cast<size_t>(view)];
    graph.run(recorded.state, in, recorded.plan(step), recorded.options);
    train::alternate(eager.state, other, eager.plan(step), eager.options);
    const train::RowAdamState& a = recorded.state.poses.adam.state();
    const train::RowAdamState& b = eager.state.poses.adam.state();
    INFO(step);
    CHECK(a.seen.equal(b.seen));
    CHECK(b.seen.sum().item<int64_t>() == (step - 21) % 3 + 1);
    same("gradient", a.gradient, b.gradient);
    if ((step - 20) % 3 != 0) continue;
    // Adam turns any gradient into a whole step, so both must start from the same one.
    const torch::NoGradGuard no_grad;
    for (const auto& [name, tensor] : test::tensors_of(eager.state.poses.adam)) {
      test::tensors_of(recorded.state.poses.adam).at(name).copy_(tensor);
    }
    const torch::Tensor before = eager.state.poses->twists().detach().clone();
    train::update_exposures(recorded.state, recorded.options, 3);
    train::update_exposures(eager.state, eager.options, 3);
    CHECK(recorded.state.poses->twists().equal(eager.state.poses->twists()));
    CHECK_FALSE(eager.state.poses->twists().equal(before));
  }
  CHECK(graph.replays() > 10);
}
