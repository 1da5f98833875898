// SPDX-License-Identifier: Apache-2.0
#include "splat.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/io/npy.h"
#include "workload.h"

namespace jade::bench {

namespace {

/// A workload on its device, with the state of a trainer's step.
class Step {
 public:
  Step(Workload workload, const SplatBench& options) : work_(std::move(workload)) {
    render_.deterministic = options.deterministic;
    through_loss_ = options.through_loss;
    one_by_one_ = options.one_by_one;
    for (auto& t : parameters(work_.gaussians)) t.set_requires_grad(true);
    work_.cameras.camera_from_world.set_requires_grad(true);
  }

  void forward() const {
    const torch::NoGradGuard no_grad;
    for_each_batch([&](const splat::CameraBatch& cameras, const torch::Tensor&) {
      splat::render(work_.gaussians, cameras, render_);
    });
  }

  /// With --through-loss as other programs time it, by (image * cotangent).sum().backward().
  void forward_backward() const {
    forget_gradients();
    for_each_batch([&](const splat::CameraBatch& cameras, const torch::Tensor& cotangent) {
      const torch::Tensor color = splat::render(work_.gaussians, cameras, render_).color;
      if (through_loss_) {
        (color * cotangent).sum().backward();
      } else {
        color.backward(cotangent);
      }
    });
  }

  void forget_gradients() const {
    for (auto& t : leaves()) t.mutable_grad().reset();
  }

  void dump(const std::filesystem::path& folder) const {
    std::filesystem::create_directories(folder);
    forward_backward();
    const auto output = splat::render(work_.gaussians, work_.cameras, render_);
    io::write_npy(folder / "color.npy", output.color.detach());
    io::write_npy(folder / "alpha.npy", output.alpha.detach());
    const auto all = leaves();
    for (size_t i = 0; i < all.size(); ++i) {
      const std::string name = i < 5 ? kParameterNames[i] : "camera_from_world";
      io::write_npy(folder / ("grad_" + name + ".npy"), all[i].grad());
    }
  }

 private:
  std::vector<torch::Tensor> leaves() const {
    auto all = parameters(work_.gaussians);
    all.push_back(work_.cameras.camera_from_world);
    return all;
  }

  template <class Run>
  void for_each_batch(const Run& run) const {
    if (!one_by_one_) return run(work_.cameras, work_.cotangent);
    for (int64_t view = 0; view < work_.cotangent.size(0); ++view) {
      splat::CameraBatch one = work_.cameras;
      one.camera_from_world = one.camera_from_world.narrow(0, view, 1);
      one.intrinsics = one.intrinsics.narrow(0, view, 1);
      run(one, work_.cotangent.narrow(0, view, 1));
    }
  }

  Workload work_;
  splat::RenderOptions render_;
  bool through_loss_ = false, one_by_one_ = false;
};

nlohmann::json measure(const Workload& source, const SplatBench& options, torch::Device device,
                       const std::filesystem::path& dump_to) {
  const Workload workload = to(source, device);
  const Step step(workload, options);
  if (!dump_to.empty()) step.dump(dump_to);
  const Times forward = time([&] { step.forward(); }, options.repeats, device);
  step.forget_gradients();
  const double before = allocated_mib(device);
  reset_peak(device);
  const Times both = time([&] { step.forward_backward(); }, options.repeats, device);
  const double peak = peak_mib(device);
  return {{"name", workload.name},
          {"device", device.str()},
          {"gaussians", workload.gaussians.size()},
          {"views", workload.cotangent.size(0)},
          {"width", workload.cameras.width},
          {"height", workload.cameras.height},
          {"forward_ms", to_json(forward)},
          {"forward_backward_ms", to_json(both)},
          {"peak_mib", std::round(peak * 10) / 10},
          {"op_peak_mib", std::round((peak - before) * 10) / 10}};
}

void print_row(const nlohmann::json& row) {
  std::printf(
      "%-8s %8ld Gaussians %5ldx%-5ld %9.3f ms forward %9.3f ms forward+backward %8.1f MiB\n",
      row["name"].get<std::string>().c_str(), row["gaussians"].get<long>(),
      row["width"].get<long>(), row["height"].get<long>(),
      row["forward_ms"]["median"].get<double>(), row["forward_backward_ms"]["median"].get<double>(),
      row["peak_mib"].get<double>());
  std::fflush(stdout);
}

}  // namespace

CLI::App* SplatBench::add_to(CLI::App& cli) {
  CLI::App* const command = cli.add_subcommand("splat", "The splatting op: nine views in one call");
  command->fallthrough();
  command->add_option("--input", inputs, "Workload folders (default: W1 to W4 are generated)")
      ->type_name("DIR")
      ->group("Input");
  command->add_option("--workload", names, "Only these workloads of W1 … W5")
      ->type_name("LIST")
      ->delimiter(',');
  command->add_flag("--million", million, "Also W5, a million Gaussians at 1600x1060");
  command->add_option("--dump", dump, "Write images and gradients as .npy below this folder")
      ->type_name("DIR")
      ->group("Output");
  command
      ->add_option("--write-input", write,
                   "Write the generated workloads as folders below this one")
      ->type_name("DIR")
      ->group("Output");
  repeats.add_to(*command);
  command->add_flag("--deterministic", deterministic, "Bit-equal gradients on a GPU");
  command->add_flag("--through-loss", through_loss,
                    "Backward through (image * cotangent).sum() instead of the cotangent itself");
  command->add_flag("--one-by-one", one_by_one, "A call for each view instead of one for all");
  return command;
}

ExitCode SplatBench::run(const apps::Program& program) const {
  torch::Device device = program.device();
  if (device.is_cuda() && !device.has_index()) device.set_index(0);
  nlohmann::json rows = nlohmann::json::array();
  const auto handle = [&](const Workload& workload, bool alone) {
    if (!write.empty()) write_workload(workload, write / workload.name);
    const auto target = dump.empty() || alone ? dump : dump / workload.name;
    rows.push_back(measure(workload, *this, device, target));
    if (!program.json()) print_row(rows.back());
  };
  for (const auto& folder : inputs) handle(read_workload(folder), inputs.size() == 1);
  if (inputs.empty()) {
    std::vector<WorkloadSize> chosen;
    for (const auto& size : standard_sizes()) {
      const bool named = std::find(names.begin(), names.end(), size.name) != names.end();
      if (names.empty() ? size.name != "W5" || million : named) chosen.push_back(size);
    }
    if (chosen.empty()) throw ConfigError("--workload: expected names among W1, W2, W3, W4, W5");
    for (const auto& size : chosen) handle(make_workload(size), chosen.size() == 1);
  }
  if (program.json()) std::cout << nlohmann::json{{"workloads", rows}}.dump(2) << '\n';
  return ExitCode::kOk;
}

}  // namespace jade::bench
