// SPDX-License-Identifier: Apache-2.0
#include "timing.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sys/resource.h>
#include <torch/cuda.h>
#include <torch/types.h>
#include <vector>

#include "common/cli.h"
#include "jade/core/interrupt.h"
#ifdef JADE_WITH_CUDA
#include <c10/cuda/CUDACachingAllocator.h>
#endif

namespace jade::bench {

namespace {
constexpr double kMib = 1024.0 * 1024.0;
#ifdef JADE_WITH_CUDA
using c10::CachingAllocator::StatType;

c10::CachingAllocator::Stat allocator_bytes(torch::Device device) {
  return c10::cuda::CUDACachingAllocator::getDeviceStats(device.index())
      .allocated_bytes[static_cast<size_t>(StatType::AGGREGATE)];
}
#endif
}  // namespace

void synchronize(torch::Device device) {
  if (device.is_cuda()) torch::cuda::synchronize(device.index());
}

void Repeats::add_to(CLI::App& command) {
  command.add_option("--repeats", timed, "Number of timed runs")
      ->transform(apps::whole_number(1))
      ->capture_default_str();
  command.add_option("--warm-up", warm_up, "Number of runs before the timed ones")
      ->transform(apps::whole_number(0))
      ->capture_default_str();
}

Times time(const std::function<void()>& work, const Repeats& repeats, torch::Device device) {
  using Clock = std::chrono::steady_clock;
  for (int i = 0; i < repeats.warm_up; ++i) work();
  synchronize(device);
  std::vector<double> ms;
  for (int i = 0; i < std::max(1, repeats.timed); ++i) {
    throw_if_interrupted();
    const auto start = Clock::now();
    work();
    synchronize(device);
    ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
  }
  std::sort(ms.begin(), ms.end());
  return {ms[ms.size() / 2], ms[0]};
}

nlohmann::json to_json(const Times& times) {
  const auto rounded = [](double ms) { return std::round(ms * 1e3) / 1e3; };
  return {{"median", rounded(times.median_ms)}, {"min", rounded(times.min_ms)}};
}

double allocated_mib([[maybe_unused]] torch::Device device) {
#ifdef JADE_WITH_CUDA
  if (device.is_cuda()) return static_cast<double>(allocator_bytes(device).current) / kMib;
#endif
  return 0;
}

double peak_mib([[maybe_unused]] torch::Device device) {
#ifdef JADE_WITH_CUDA
  if (device.is_cuda()) return static_cast<double>(allocator_bytes(device).peak) / kMib;
#endif
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

void reset_peak([[maybe_unused]] torch::Device device) {
#ifdef JADE_WITH_CUDA
  if (device.is_cuda()) c10::cuda::CUDACachingAllocator::resetPeakStats(device.index());
#endif
}

}  // namespace jade::bench
