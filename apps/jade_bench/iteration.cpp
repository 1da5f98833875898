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

#include "jade/core/check.h"
#include "jade/core/device.h"
#include "jade/core/random.h"
#include "jade/train/routing_step.h"
#include "jade/train/step_feed.h"
#include "jade/train/step_graph.h"
#include "workload.h"

namespace jade::bench {
namespace {

constexpr int64_t kViews = 4;
/// Every term is active from this share of the steps, and densification collects statistics: 32 %
/// of the schedule.
constexpr double kFirstShare = 0.32;
/// Events per pixel and exposure, typical of 100 ms of a shaking hand.
constexpr int64_t kEventsPerPixel = 4;
constexpr int64_t kExposureUs = 100000;

/// `count` random events in the window.
events::EventStream random_events(const splat::CameraBatch& cameras, int64_t count,
                                  const events::TimeWindow& window, at::Generator& generator) {
  const auto uniform = [&](int64_t end, torch::ScalarType type) {
    return at::randint(end, {count}, generator, torch::kInt64).to(type);
  };
  const torch::Tensor t = uniform(window.duration_us(), torch::kInt64) + window.begin_us;
  return {uniform(cameras.width, torch::kFloat32), uniform(cameras.height, torch::kFloat32),
          std::get<0>(t.sort()), (2 * uniform(2, torch::kInt64) - 1).to(torch::kInt8)};
}

/// Exposures of a workload's scene, whose frames are means of its renders; the events are random.
data::Dataset make_dataset(const Workload& work, at::Generator& generator) {
  const torch::NoGradGuard no_grad;
  const torch::Tensor intrinsics = work.cameras.intrinsics[0].cpu();
  data::Dataset dataset;
  dataset.name = work.name;
  dataset.near = 3;
  dataset.far = 7;
  dataset.events = random_events(
      work.cameras, kViews * kEventsPerPixel * work.cameras.width * work.cameras.height,
      {0, kViews * kExposureUs}, generator);
  data::Exposure exposure;
  exposure.blurry = splat::render(work.gaussians, work.cameras, {}).color.mean(0).clamp(0, 1).cpu();
  const auto at = [&](int64_t i) { return intrinsics[i].item<double>(); };
  exposure.camera = {at(0), at(1), at(2), at(3), work.cameras.width, work.cameras.height};
  for (size_t k = 0; k < exposure.poses.size(); ++k) {
    exposure.poses[k] =
        geometry::pose_from_tensor(work.cameras.camera_from_world[static_cast<int64_t>(k)]);
  }
  for (int64_t i = 0; i < kViews; ++i) {
    exposure.name = concat("view_", i);
    exposure.t_start_us = i * kExposureUs;
    exposure.t_end_us = exposure.t_start_us + kExposureUs;
    exposure.events = dataset.events.slice(exposure.t_start_us, exposure.t_end_us);
    dataset.train.push_back(exposure);
  }
  return dataset;
}

/// A training state and its step inputs, made from a splatting workload: the Gaussians are those of
/// its scene, slightly perturbed.
struct Bench {
  train::RunOptions options;
  train::StepFeed feed;
  train::TrainState state;
  int64_t step = 1;

  Bench(const Workload& work, const train::RunOptions& asked, torch::Device device)
      : options(asked) {
    options.densify.every = 1000000000;  // between densifications
    step = static_cast<int64_t>(kFirstShare * static_cast<double>(calendar_steps(options))) + 1;
    at::Generator generator = make_generator(0, "iteration benchmark");
    const data::Dataset dataset = make_dataset(work, generator);
    feed = train::StepFeed(dataset, options, device);
    train::Start start;
    start.gaussians = work.gaussians;
    start.gaussians.means = work.gaussians.means +
                            0.002 * at::randn(work.gaussians.means.sizes(), generator).to(device);
    start.views = kViews;
    start.height = work.cameras.height;
    start.width = work.cameras.width;
    state = train::make_state(options, start, device);
    train::learn_poses(state, options.poses, dataset, device);
  }

  train::StepInputs next() { return feed.at(step); }
  train::StepPlan plan() const { return train::plan_step(options, step); }
};

/// Milliseconds of each part of a step, run eagerly and synchronised.
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
        [&] {
          const torch::Tensor alpha = train::routing_alpha(bench.state, in, plan);
          train::routing_step(bench.state, in, alpha, renders, plan, bench.options.route);
        },
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

/// Writes a Chrome trace of `work`, with the device's kernels if torch was built with support for
/// them.
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

nlohmann::json measure(const Workload& source, const IterationBench& flags,
                       const train::RunOptions& options, torch::Device device) {
  Bench bench(to(source, device), options, device);
  train::StepGraph graph;
  const auto run = [&] {
    train::TrainState& state = bench.state;
    graph.run(state, bench.next(), bench.plan(), bench.options);
    train::update_exposures(state, bench.options, bench.step);
    if (state.densifier.due(bench.step)) {
      state.densifier.update(bench.step, state.gaussians, state.gaussian_adam,
                             train::gradient_factor(bench.options, /*moment_stride=*/1));
    }
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
          {"views", options.exposure.samples},
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

CLI::App* IterationBench::add_to(apps::Program& program) {
  CLI::App* const command = program.cli().add_subcommand(
      "iteration", "A training step of a configuration, between densifications");
  command->fallthrough();
  command->add_option("--workload", names, "Workloads among W1 … W5")
      ->type_name("LIST")
      ->delimiter(',')
      ->capture_default_str();
  repeats.add_to(*command);
  command->add_flag("--eager", eager, "Without CUDA graph");
  program.add_config_flags(*command);
  command->add_option("--trace", trace, "Write a Chrome trace of three steps to this file")
      ->type_name("FILE")
      ->group("Output");
  return command;
}

ExitCode IterationBench::run(const apps::Program& program) const {
  train::RunOptions defaults = train::printed_options();
  defaults.dataset.path = "workload";  // exists only in memory
  std::optional<train::RunOptions> options = program.load_options(defaults);
  if (!options) return ExitCode::kOk;
  if (eager) options->train.cuda_graph = false;
  torch::Device device = select_device(options->device);
  if (device.is_cuda() && !device.has_index()) device.set_index(0);
  const train::StreamScope stream(device);
  nlohmann::json rows = nlohmann::json::array();
  for (const WorkloadSize& size : standard_sizes()) {
    if (std::find(names.begin(), names.end(), size.name) == names.end()) continue;
    rows.push_back(measure(make_workload(size), *this, *options, device));
    if (!program.json()) print_row(rows.back());
  }
  if (rows.empty()) throw ConfigError("--workload: expected names among W1, W2, W3, W4, W5");
  if (program.json()) std::cout << nlohmann::json{{"workloads", rows}}.dump(2) << '\n';
  return ExitCode::kOk;
}

}  // namespace jade::bench
