// SPDX-License-Identifier: Apache-2.0
#include "events.h"

#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/device.h"
#include "jade/events/exposure_maps.h"
#include "jade/events/ramps.h"

namespace jade::bench {
namespace {

constexpr events::TimeWindow kExposure{0, 100000};
constexpr int64_t kReach = 5000;  ///< for events.ramp_ms 5

/// Events at random sub-pixel places, from `kReach` before the exposure to `kReach` after it.
events::EventStream make_events(const EventsBench& asked) {
  const auto generator = at::detail::createCPUGenerator(0);
  const auto places = [&](int64_t side) {
    return torch::rand({asked.count}, generator) * static_cast<double>(side - 1);
  };
  const torch::Tensor x = places(asked.width), y = places(asked.height);
  const torch::Tensor t =
      torch::randint(-kReach, kExposure.end_us + kReach, {asked.count}, generator, torch::kInt64);
  const torch::Tensor positive = torch::randint(2, {asked.count}, generator, torch::kInt8);
  return {x, y, std::get<0>(t.sort()), 2 * positive - 1};
}

}  // namespace

CLI::App* EventsBench::add_to(CLI::App& cli) {
  CLI::App* const command = cli.add_subcommand(
      "events",
      "The event sums of one exposure of 100 ms, on the CPU: voxel and the restorer's "
      "windows, and the ramped windows of EDI");
  command->fallthrough();
  command->add_option("--width", width, "Columns of the image")
      ->check(CLI::Range(1, 32767))
      ->capture_default_str();
  command->add_option("--height", height, "Rows of the image")
      ->check(CLI::Range(1, 32767))
      ->capture_default_str();
  command->add_option("--count", count, "Number of events, at random places")
      ->transform(apps::whole_number(1))
      ->capture_default_str();
  repeats.add_to(*command);
  return command;
}

ExitCode EventsBench::run(const apps::Program& program) const {
  // The moments, bins and windows of configs/base.yaml and the restorer that ships.
  constexpr int64_t kWindows = 64, kBins = 6, kRestorerWindows = 16;
  const events::EventStream events = make_events(*this);
  const events::ImageSize size{height, width};
  const torch::Device cpu = torch::kCPU;
  const Times maps =
      time([&] { events::map_exposure(events, kExposure, kBins, size, 1, kRestorerWindows); },
           repeats, cpu);
  const Times ramps = time(
      [&] { events::ramped_windows(events, kExposure, kWindows, kReach, size); }, repeats, cpu);
  if (program.json()) {
    std::cout << nlohmann::json{{"device", device_name(cpu)}, {"width", width},
                                {"height", height},           {"events", count},
                                {"maps_ms", to_json(maps)},   {"ramps_ms", to_json(ramps)}}
                     .dump(2)
              << '\n';
  } else {
    std::printf("%s, %lldx%lld, %lld events: maps %.1f ms, ramps %.1f ms (medians)\n",
                device_name(cpu).c_str(), static_cast<long long>(width),
                static_cast<long long>(height), static_cast<long long>(count), maps.median_ms,
                ramps.median_ms);
  }
  return ExitCode::kOk;
}

}  // namespace jade::bench
