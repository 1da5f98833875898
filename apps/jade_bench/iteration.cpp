// SPDX-License-Identifier: Apache-2.0
#include "iteration.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <torch/csrc/autograd/profiler_kineto.h>
#include <torch/types.h>

#include "jade/core/random.h"
#include "jade/events/voxel.h"
#include "jade/train/draws.h"
#include "jade/train/routing_step.h"
#include "jade/train/step_graph.h"
#include "workload.h"

namespace jade::bench {
namespace {

constexpr int64_t kViews = 4;
/// A step at which every term acts and densification statistics are kept.
constexpr int64_t kFirstStep = 8001;

/// A training state and views made from a splatting workload: frames are renders of its scene, the
/// trained Gaussians are the same ones slightly moved.
struct Bench {
  train::RunOptions options;
  std::vector<train::View> views;
  train::TrainState state;
  train::PoseDraws draws;
  int64_t step = kFirstStep;

  Bench(const Workload& work, const IterationBench& flags, torch::Device device)
      : draws(0, device) {
    options.deterministic = flags.deterministic;
    options.train.cuda_graph = !flags.eager;
    at::Generator generator = make_generator(0, "iteration benchmark");
    for (int64_t i = 0; i < kViews; ++i) views.push_back(make_view(work, generator, device));
    splat::Gaussians moved = work.gaussians;
    moved.means = moved.means + 0.002 * at::randn(moved.means.sizes(), generator).to(device);
    train::Start start;
    start.gaussians = moved;
    start.views = kViews;
    start.height = work.cameras.height;
    start.width = work.cameras.width;
    state = train::make_state(options, start, device);
  }

  static train::View make_view(const Workload& work, at::Generator& generator,
                               torch::Device device) {
    const torch::NoGradGuard no_grad;
    const int64_t height = work.cameras.height, width = work.cameras.width;
    const torch::Tensor renders = splat::render(work.gaussians, work.cameras, {}).color;
    const auto noise = [&](at::IntArrayRef shape, double size) {
      return (size * at::randn(shape, generator)).to(device);
    };
    const torch::Tensor voxel = noise({6, height, width}, 0.2);
    train::View view;
    view.blurry = renders.mean(0).clamp(0, 1);
    view.blurry_moments = imaging::ssim_target(view.blurry);
    view.psi = events::polarity_projection(voxel);
    view.edi_factors = noise({geometry::kExposurePoses, 1, height, width}, 0.1).exp();
    view.reblur_kernel = noise({1, height, width}, 0.1).exp();
    view.restorations.edi =
        (renders[geometry::kMidPose] + noise({3, height, width}, 0.03)).clamp(0, 1);
    view.restorations.efnet =
        (renders[geometry::kMidPose] + noise({3, height, width}, 0.03)).clamp(0, 1);
    view.cameras = work.cameras;
    view.u = train::pose_times(device);
    return view;
  }

  train::StepInputs next() {
    const int64_t view = step % kViews;
    train::StepInputs inputs;
    inputs.step = step;
    inputs.view = views[static_cast<size_t>(view)];
    inputs.view_index = view;
    inputs.pose_draws = draws.at(step);
    return inputs;
  }
  train::StepPlan plan() const { return train::plan_step(options, step); }
};

/// Milliseconds of each part of a step, run eagerly and waited for.
nlohmann::json measure_stages(Bench& bench, int64_t repeats, torch::Device device) {
  using Clock = std::chrono::steady_clock;
  const char* const names[] = {"render", "routing_step", "target", "scene_step"};
  std::vector<std::vector<double>> ms(4);
  for (int64_t i = 0; i < repeats; ++i, ++bench.step) {
    const train::StepInputs in = bench.next();
    const train::StepPlan plan = bench.plan();
    train::Renders renders;
    torch::Tensor target;
    const std::function<void()> parts[] = {
        [&] { renders = train::render_exposure(bench.state, in, plan, bench.options); },
        [&] { train::routing_step(bench.state, in, renders, plan, bench.options.route); },
        [&] { target = train::scene_target(bench.state, in.view, in.view_index); },
        [&] { train::scene_step(bench.state, in, renders, target, plan, bench.options); }};
    for (size_t part = 0; part < 4; ++part) {
      synchronize(device);
      const auto start = Clock::now();
      parts[part]();
      synchronize(device);
      ms[part].push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
    }
  }
  nlohmann::json stages;
  for (size_t part = 0; part < 4; ++part) {
    std::sort(ms[part].begin(), ms[part].end());
    stages[names[part]] = to_json(Times{ms[part][ms[part].size() / 2], ms[part].front()});
  }
  return stages;
}

/// A Chrome trace of `work`, with the device's kernels where torch was built to see them.
void write_trace(const std::filesystem::path& path, const std::function<void()>& work,
                 torch::Device device) {
  using namespace torch::autograd::profiler;
  const ProfilerConfig config(ProfilerState::KINETO);
  std::set<ActivityType> activities{ActivityType::CPU};
  if (device.is_cuda()) activities.insert(ActivityType::CUDA);
  prepareProfiler(config, activities);
  enableProfiler(config, activities);
  work();
  synchronize(device);
  disableProfiler()->save(path.string());
}

nlohmann::json measure(const Workload& source, const IterationBench& flags, torch::Device device) {
  Bench bench(to(source, device), flags, device);
  train::StepGraph graph;
  const auto run = [&] {
    graph.run(bench.state, bench.next(), bench.plan(), bench.options);
    ++bench.step;
  };
  const nlohmann::json stages = measure_stages(bench, std::min(20, flags.repeats.timed), device);
  for (int i = 0; i < flags.repeats.warm_up; ++i) run();
  synchronize(device);
  reset_peak(device);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < flags.repeats.timed; ++i) run();
  synchronize(device);
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const double peak = peak_mib(device);
  if (!flags.trace.empty()) {
    write_trace(
        flags.trace,
        [&] {
          for (int i = 0; i < 3; ++i) run();
        },
        device);
  }
  return {{"name", source.name},
          {"device", device.str()},
          {"gaussians", source.gaussians.size()},
          {"views", geometry::kExposurePoses},
          {"width", source.cameras.width},
          {"height", source.cameras.height},
          {"cuda_graph", graph.replays() > 0},
          {"iterations_per_second",
           std::round(10 * flags.repeats.timed / std::max(1e-9, seconds)) / 10},
          {"stages", stages},
          {"peak_mib", std::round(peak * 10) / 10}};
}

void print_row(const nlohmann::json& row) {
  std::printf("%-8s %8ld Gaussians %5ldx%-5ld %8.1f it/s %8.1f MiB%s\n",
              row["name"].get<std::string>().c_str(), row["gaussians"].get<long>(),
              row["width"].get<long>(), row["height"].get<long>(),
              row["iterations_per_second"].get<double>(), row["peak_mib"].get<double>(),
              row["cuda_graph"].get<bool>() ? "  (CUDA graph)" : "");
  for (const auto& [name, times] : row["stages"].items()) {
    std::printf("         %-14s %9.3f ms, alone and waited for\n", name.c_str(),
                times["median"].get<double>());
  }
  std::fflush(stdout);
}

}  // namespace

CLI::App* IterationBench::add_to(CLI::App& cli) {
  CLI::App* const command = cli.add_subcommand(
      "iteration", "A training step of the full objective, between densifications");
  command->fallthrough();
  command->add_option("--workload", names, "Which of W1 … W5")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--repeats", repeats.timed, "Timed steps")->capture_default_str();
  command->add_option("--warm-up", repeats.warm_up, "Steps before them")->capture_default_str();
  command->add_flag("--eager", eager, "Without CUDA graph");
  command->add_flag("--deterministic", deterministic, "Bit-equal steps on a GPU");
  command->add_option("--trace", trace, "Write a Chrome trace of three steps to this file");
  return command;
}

ExitCode IterationBench::run(const apps::Program& program) const {
  torch::Device device = program.device();
  if (device.is_cuda() && !device.has_index()) device.set_index(0);
  const train::StreamScope stream(device);
  nlohmann::json rows = nlohmann::json::array();
  for (const WorkloadSize& size : standard_sizes()) {
    if (std::find(names.begin(), names.end(), size.name) == names.end()) continue;
    rows.push_back(measure(make_workload(size), *this, device));
    if (!program.json()) print_row(rows.back());
  }
  if (rows.empty()) throw ConfigError("--workload: expected names among W1, W2, W3, W4, W5");
  if (program.json()) std::cout << nlohmann::json{{"workloads", rows}}.dump(2) << '\n';
  return ExitCode::kOk;
}

}  // namespace jade::bench
