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
  torch::Tensor image, bins;  ///< [3,H,W] and [T,H,W]
};

/// The poses of an exposure.
const std::vector<double> kNineMoments = {0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1};

/// Events at a third of the pixels, as from a moving camera.
Frame make_frame(int64_t width, int64_t height, int64_t windows) {
  const auto generator = at::detail::createCPUGenerator(0);
  const torch::Tensor image = torch::rand({3, height, width}, generator);
  const torch::Tensor bins = torch::randn({windows, height, width}, generator) *
                             (torch::rand({1, height, width}, generator) > 0.67);
  return {concat(width, "x", height), image, bins};
}

double peak_of(torch::Device device) { return std::round(peak_mib(device) * 10) / 10; }

nlohmann::json measure(restore::Restorer& restorer, const Frame& frame, const Repeats& repeats,
                       torch::Device device) {
  const torch::Tensor image = frame.image.to(device), bins = frame.bins.to(device);
  reset_peak(device);
  const Times one = time([&] { restorer.restore(image, bins); }, repeats, device);
  nlohmann::json row{{"name", frame.name},       {"device", restorer.device().str()},
                     {"width", image.size(2)},   {"height", image.size(1)},
                     {"frame_ms", to_json(one)}, {"peak_mib", peak_of(device)}};
  if (!restorer.metadata().any_time) return row;
  reset_peak(device);
  const Times nine = time([&] { restorer.restore(image, bins, kNineMoments); }, repeats, device);
  row["nine_ms"] = to_json(nine);
  row["nine_peak_mib"] = peak_of(device);
  return row;
}

/// Writes the restored images, for comparison with other programs.
void dump_restored(restore::Restorer& restorer, const Frame& frame, torch::Device device,
                   const std::filesystem::path& folder, const std::vector<double>& times) {
  const torch::Tensor image = frame.image.to(device), bins = frame.bins.to(device);
  std::filesystem::create_directories(folder);
  const torch::Tensor restored =
      times.empty() ? restorer.restore(image, bins) : restorer.restore(image, bins, times);
  io::write_npy(folder / (frame.name + ".npy"), restored.cpu());
}

void print_frame(const nlohmann::json& row) {
  std::printf("%-10s %s: %9.3f ms per frame (median; fastest %.3f), %.1f MiB",
              row["name"].get<std::string>().c_str(), row["device"].get<std::string>().c_str(),
              row["frame_ms"]["median"].get<double>(), row["frame_ms"]["min"].get<double>(),
              row["peak_mib"].get<double>());
  if (row.contains("nine_ms")) {
    std::printf("; nine moments together %.3f ms, %.1f MiB", row["nine_ms"]["median"].get<double>(),
                row["nine_peak_mib"].get<double>());
  }
  std::printf("\n");
  std::fflush(stdout);
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
      cli.add_subcommand("restorer", "The learned restorer: one frame, and nine moments of it");
  command->fallthrough();
  command
      ->add_option("--efnet", efnet.path,
                   "TorchScript file of the restorer instead of the one that ships")
      ->type_name("FILE");
  command
      ->add_option("--input", inputs,
                   "Folders with image.npy [3,H,W] and bins.npy [T,H,W], the signed events of "
                   "the restorer's windows, instead of --size")
      ->type_name("DIR");
  command
      ->add_option("--dump", dump,
                   "Write NAME.npy of each restored frame into this folder, [3,H,W]")
      ->type_name("DIR")
      ->group("Output");
  command
      ->add_option("--times", times,
                   "Moments for --dump, such as 0,0.5,1, which makes it [K,3,H,W]; other than 0.5 "
                   "they need a restorer of version 2")
      ->type_name("LIST")
      ->delimiter(',')
      ->check(apps::within(0, 1));
  command->add_option("--size", sizes, "Frame sizes (default: 346x260,600x400)")
      ->type_name("LIST")
      ->delimiter(',');
  repeats.add_to(*command);
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
    frames.push_back(make_frame(width, height, restorer.metadata().windows));
  }
  for (const Frame& frame : frames) {
    if (!dump.empty()) dump_restored(restorer, frame, device, dump, times);
    rows.push_back(measure(restorer, frame, repeats, device));
    if (!program.json()) print_frame(rows.back());
  }
  if (program.json()) std::cout << nlohmann::json{{"workloads", rows}}.dump(2) << '\n';
  return ExitCode::kOk;
}

}  // namespace jade::bench
