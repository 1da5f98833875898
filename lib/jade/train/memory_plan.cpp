// SPDX-License-Identifier: Apache-2.0
#include "jade/train/memory_plan.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <torch/types.h>

#include "jade/core/device.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/train/plan.h"

namespace jade::train {
namespace {

/// The CUDA context and loaded kernels.
constexpr int64_t kContextBytes = int64_t{600} << 20;
/// Share of the rest that tensors fill; the allocator's gaps and the graphs of steps take the other
/// part. 0.58 to 0.85 in the peaks of memory_parts.csv; of 2 GiB, 0.8 was too much.
constexpr double kTensorShare = 0.7;
/// A smaller scene is not worth training.
constexpr int64_t kFewestGaussians = 10000;

int64_t mib(int64_t bytes) { return (bytes + (1 << 20) - 1) >> 20; }

int64_t pixels_of(const data::Dataset& dataset) {
  const auto& camera = dataset.train.front().camera;
  return int64_t{camera.width} * camera.height;
}

/// Parameters, gradients, both moments of Adam, and what a step computes, per Gaussian. Fitted, as
/// those of a pixel, to peaks of runs with 75,000 to 1,000,000 Gaussians, 346x260 to 960x540 pixels
/// and 9 to 33 moments, most within 5 %.
int64_t gaussian_bytes(const RunOptions& options) { return 1400 + 80 * options.exposure.samples; }

/// Bytes that a step computes per pixel, for all its moments; a router takes the last term.
int64_t pixel_bytes(const RunOptions& options) {
  return 250 + 60 * options.exposure.samples + (plan_step(options, 1).route ? 2000 : 0);
}

}  // namespace

int64_t memory_budget(const RunOptions& options, torch::Device device) {
  if (!device.is_cuda()) return std::numeric_limits<int64_t>::max();
  int64_t bytes = free_memory_bytes(device);
  if (!options.memory_gib.is_auto()) {
    bytes = std::min(bytes, int64_t(double{options.memory_gib} * (1 << 30)) - kContextBytes);
    limit_memory(device, bytes);
  }
  return int64_t(kTensorShare * double(bytes));
}

int64_t max_gaussians(const RunOptions& options, const data::Dataset& dataset, int64_t budget) {
  const int64_t pixels = pixels_of(dataset);
  const int64_t fit = (budget - pixel_bytes(options) * pixels) / gaussian_bytes(options);
  const AutoCount& given = options.densify.max_gaussians;
  if (fit < std::min(kFewestGaussians, int64_t{given})) {
    const auto& camera = dataset.train.front().camera;
    throw DeviceError(concat("memory_gib: expected room for a step at ", camera.width, "x",
                             camera.height, " with ", options.exposure.samples, " moments and ",
                             grouped(kFewestGaussians), " Gaussians (",
                             mib(memory_plan(options, dataset, kFewestGaussians).step()),
                             " MiB), found ", mib(std::max<int64_t>(budget, 0)),
                             " MiB; use fewer moments (exposure.samples), smaller images "
                             "(dataset.image_folder) or --device cpu"));
  }
  if (!given.is_auto()) {
    const bool grows = options.densify.strategy != gaussians::DensifyStrategy::kNone;
    if (grows && given > fit) {
      log_warn(concat("densify.max_gaussians: ", grouped(given), " Gaussians may not fit in ",
                      mib(budget), " MiB of GPU memory; ", grouped(fit), " would"));
    }
    return given;
  }
  const int64_t wanted =
      std::max(int64_t{given}, int64_t(std::lround(500 * std::sqrt(double(pixels)))));
  if (fit < wanted) {
    log_warn(concat("densify.max_gaussians: at most ", grouped(fit), " instead of ",
                    grouped(wanted), " Gaussians, as ", mib(budget),
                    " MiB of GPU memory hold no more"));
  }
  return std::min(wanted, fit);
}

int64_t most_gaussians(const TrainState& state, const RunOptions& options) {
  const int64_t now = state.gaussians.size();
  const bool grows = options.densify.strategy != gaussians::DensifyStrategy::kNone;
  return grows ? std::max(now, int64_t{options.densify.max_gaussians}) : now;
}

MemoryPlan memory_plan(const RunOptions& options, const data::Dataset& dataset,
                       int64_t most_gaussians) {
  MemoryPlan plan;
  plan.gaussians = most_gaussians * gaussian_bytes(options);
  plan.renders = pixels_of(dataset) * pixel_bytes(options);
  return plan;
}

int64_t constants_budget(const MemoryPlan& plan, int64_t budget) {
  return std::clamp<int64_t>(budget - plan.step(), 0, kMostConstantBytes);
}

std::string text_of(const MemoryPlan& plan, int64_t views, int64_t most_gaussians) {
  return concat(mib(plan.total()), " MiB: ", views, " frames ", mib(plan.constants.frames),
                ", EDI ", mib(plan.constants.edi), ", restorations ",
                mib(plan.constants.restorations), ", ", grouped(most_gaussians), " Gaussians ",
                mib(plan.gaussians), ", renders ", mib(plan.renders));
}

}  // namespace jade::train
