// SPDX-License-Identifier: Apache-2.0
#include "deblurrer.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/events/exposure_maps.h"
#include "jade/imaging/edi.h"
#include "jade/run/checkpoint.h"
#include "jade/run/evaluate.h"

namespace jade::apps {
namespace {

namespace fs = std::filesystem;

std::shared_ptr<router::Allocation> load_allocation(const fs::path& run,
                                                    const data::Dataset& dataset) {
  const train::RunOptions options = run::load_run_options(run);
  const auto checkpoints = run::list_checkpoints(run);
  if (checkpoints.empty()) {
    throw CheckpointError(
        concat(run.string(), ": expected a checkpoint with a router, found none; train first"));
  }
  const auto& camera = dataset.train.front().camera;
  auto allocation = router::make_allocation(
      options.allocation, static_cast<int64_t>(dataset.train.size()), camera.height, camera.width,
      make_generator(static_cast<uint64_t>(options.seed), "router start"));
  if (!allocation || options.objective.target != losses::Target::kRouted) {
    throw ConfigError(concat(run.string(),
                             ": expected a run with a router, found objective.target ",
                             word_of(options.objective.target), " and allocation.kind ",
                             word_of(options.allocation.kind)));
  }
  run::load_checkpoint_allocation(checkpoints.front(), *allocation);
  return allocation;
}

}  // namespace

Deblurrer::Deblurrer(const DeblurOptions& options, const Method& method,
                     const data::Dataset& dataset, torch::Device device)
    : options_(options),
      needs_efnet_(method.needs_efnet),
      restorer_(options.settings.cache,
                method.needs_efnet ? std::optional(options.settings.efnet) : std::nullopt, device,
                dataset.monochrome) {
  if (method.needs_run) allocation_ = load_allocation(options.run, dataset);
}

/// A sensor that follows log(I + ε) sees B + ε as the mean of I_k + ε, so the offset is added
/// before EDI and taken off after.
Restored Deblurrer::restore(const data::Exposure& exposure, int64_t index) {
  const events::EventOptions& settings = options_.settings.events;
  const events::ImageSize size{exposure.camera.height, exposure.camera.width};
  const events::ExposureMaps maps = events::map_exposure(
      exposure.events, {exposure.t_start_us, exposure.t_end_us}, settings.bins, size);
  const torch::Tensor windows = events::edi_windows(maps.windows, settings.thresholds());
  const imaging::EdiKernel kernel = imaging::edi_kernel(windows, settings.edi_index);
  const double offset = options_.log_offset;
  std::string recipe = concat("index ", word_of(settings.edi_index));
  if (offset != 0) recipe += concat(" offset ", offset);

  Restored restored;
  restored.gain = kernel.gain.unsqueeze(1);
  restored.events = torch::stack({maps.windows.positive.sum(0), maps.windows.negative.sum(0)});
  Candidates& c = restored.candidates;
  c.blurry = exposure.blurry;
  const auto edi = [&] { return imaging::edi_mid(exposure.blurry + offset, kernel) - offset; };
  c.edi = restorer_.edi(exposure.blurry, windows, recipe, edi).cpu();
  if (needs_efnet_) c.efnet = restorer_.efnet(exposure.blurry, maps.voxel.values).cpu();
  if (allocation_) {
    c.alpha = allocation_->forward(
        {exposure.blurry, events::polarity_projection(maps.voxel.values), index});
  }
  return restored;
}

torch::Tensor Deblurrer::at_all_poses(const torch::Tensor& mid, const Restored& restored) const {
  const torch::Tensor ratio = restored.gain / restored.gain[geometry::kMidPose];
  return (mid + options_.log_offset) * ratio - options_.log_offset;
}

}  // namespace jade::apps
