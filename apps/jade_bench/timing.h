// SPDX-License-Identifier: Apache-2.0
// Wall-clock times and peak memory of repeated work on either device.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <torch/types.h>

namespace jade::bench {

struct Times {
  double median_ms = 0, min_ms = 0;
};

struct Repeats {
  int warm_up = 20;
  int timed = 200;

  /// --repeats and --warm-up.
  void add_to(CLI::App& command);
};

/// Runs `work` and waits for the device after each run.
Times time(const std::function<void()>& work, const Repeats& repeats, torch::Device device);

/// {"median": …, "min": …}, rounded to a microsecond.
nlohmann::json to_json(const Times& times);

void synchronize(torch::Device device);
/// MiB currently held by torch's allocator, and the maximum since reset_peak(). On the CPU the
/// second is the process's peak resident size and the first 0.
double allocated_mib(torch::Device device);
double peak_mib(torch::Device device);
void reset_peak(torch::Device device);

}  // namespace jade::bench
