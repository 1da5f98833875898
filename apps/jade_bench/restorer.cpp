// SPDX-License-Identifier: Apache-2.0
#include "restorer.h"

#include <cmath>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/io/npy.h"

namespace jade::bench {
namespace {

struct Frame {
  std::string name;
  torch::Tensor image, bins;  ///< [3,H,W] and [6,H,W]
};

/// Events at a third of the pixels, as of a moving camera.
Frame make_frame(int64_t width, int64_t height) {
  const auto generator = at::detail::createCPUGenerator(0);
  const torch::Tensor image = torch::rand({3, height, width}, generator);
  const torch::Tensor bins = torch::randn({6, height, width}, generator) *
                             (torch::rand({1, height, width}, generator) > 0.67);
  return {concat(width, "x", height), image, bins};
}

nlohmann::json measure(restore::Restorer& restorer, const Frame& frame, const Repeats& repeats,
                       torch::Device device, const std::filesystem::path& dump) {
  const torch::Tensor image = frame.image.to(device), bins = frame.bins.to(device);
  if (!dump.empty()) {
    std::filesystem::create_directories(dump);
    io::write_npy(dump / (frame.name + ".npy"), restorer.restore(image, bins).cpu());
  }
  reset_peak(device);
  const Times times = time([&] { restorer.restore(image, bins); }, repeats, device);
  return {{"name", frame.name},         {"device", restorer.device().str()},
          {"width", image.size(2)},     {"height", image.size(1)},
          {"frame_ms", to_json(times)}, {"peak_mib", std::round(peak_mib(device) * 10) / 10}};
}

std::pair<int64_t, int64_t> parse_size(const std::string& text) {
  long width = 0, height = 0;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%ldx%ld%c", &width, &height, &rest) != 2 || width < 1 ||
      height < 1 || width > 100000 || height > 100000) {
    throw ConfigError(concat("--size: expected sizes as 346x260, found '", text, "'"));
  }
  return {width, height};
}

}  // namespace

CLI::App* RestorerBench::add_to(CLI::App& cli) {
  CLI::App* const command =
      cli.add_subcommand("restorer", "The learned restorer: one frame and its six event bins");
  command->fallthrough();
  command->add_option("--efnet", efnet.path, "TorchScript file (the one that ships)");
  command->add_option("--input", inputs, "Folders with image.npy and bins.npy instead of --size");
  command->add_option("--dump", dump, "Write NAME.npy of each restored frame into this folder");
  command->add_option("--size", sizes, "Frame sizes (346x260,600x400)")->delimiter(',');
  command->add_option("--repeats", repeats.timed, "Timed runs")->capture_default_str();
  command->add_option("--warm-up", repeats.warm_up, "Runs before them")->capture_default_str();
  return command;
}

ExitCode RestorerBench::run(const apps::Program& program) const {
  torch::Device device = program.device();
  if (device.is_cuda() && !device.has_index()) device.set_index(0);
  restore::Restorer restorer(efnet, device);
  nlohmann::json rows = nlohmann::json::array();
  std::vector<Frame> frames;
  for (const auto& folder : inputs) {
    frames.push_back({folder.filename().string(), io::read_npy(folder / "image.npy"),
                      io::read_npy(folder / "bins.npy")});
  }
  for (const std::string& size : inputs.empty() ? sizes : std::vector<std::string>()) {
    const auto [width, height] = parse_size(size);
    frames.push_back(make_frame(width, height));
  }
  for (const Frame& frame : frames) {
    rows.push_back(measure(restorer, frame, repeats, device, dump));
    const auto& row = rows.back();
    if (program.json()) continue;
    std::printf("%-10s %s: %9.3f ms per frame (median; fastest %.3f), %.1f MiB\n",
                frame.name.c_str(), row["device"].get<std::string>().c_str(),
                row["frame_ms"]["median"].get<double>(), row["frame_ms"]["min"].get<double>(),
                row["peak_mib"].get<double>());
    std::fflush(stdout);
  }
  if (program.json()) std::cout << nlohmann::json{{"workloads", rows}}.dump(2) << '\n';
  return ExitCode::kOk;
}

}  // namespace jade::bench
