// SPDX-License-Identifier: Apache-2.0
#include "jade/run/deblurrer.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/random.h"
#include "jade/events/counts.h"
#include "jade/events/voxel.h"
#include "jade/restore/restored_exposure.h"
#include "jade/run/checkpoint.h"
#include "jade/run/evaluate.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

std::shared_ptr<router::Allocation> load_allocation(const fs::path& run,
                                                    const data::Dataset& dataset) {
  const train::RunOptions options = load_run_options(run);
  const auto checkpoints = list_checkpoints(run);
  if (checkpoints.empty()) {
    throw CheckpointError(
        concat(run.string(), ": expected a checkpoint with a router, found none; train first"));
  }
  if (options.objective.target != losses::Target::kRouted) {
    throw ConfigError(concat(run.string(),
                             ": expected a run with a router, found objective.target ",
                             word_of(options.objective.target),
                             "; choose another --method, or a run of configs/paper.yaml"));
  }
  const auto& camera = dataset.train.front().camera;
  auto allocation = router::make_allocation(
      options.allocation, static_cast<int64_t>(dataset.train.size()), camera.height, camera.width,
      make_generator(static_cast<uint64_t>(options.seed), "router start"));
  load_checkpoint_allocation(checkpoints.front(), *allocation);
  return allocation;
}

}  // namespace

Deblurrer::Deblurrer(const DeblurOptions& options, const restore::Method& method,
                     const data::Dataset& dataset, torch::Device device)
    : options_(options),
      events_(dataset.events),
      restorer_(options.settings.cache,
                method.needs_efnet ? std::optional(options.settings.efnet) : std::nullopt, device,
                dataset.monochrome) {
  if (method.needs_run) allocation_ = load_allocation(options.run, dataset);
}

bool Deblurrer::has_any_time_network() const {
  return restorer_.has_network() && restorer_.metadata().any_time;
}

Restored Deblurrer::restore(const data::Exposure& exposure, int64_t index,
                            const std::vector<double>& times) {
  restore::RestoreOptions how{options_.settings.events, options_.settings.exposure,
                              options_.log_offset};
  how.times = times.empty() ? options_.kept_times : times;
  how.only_kept_times = times.empty();
  const restore::RestoredExposure found =
      restore::restore_exposure(exposure, events_, how, restorer_);
  Restored restored;
  restored.gain = found.gain.unsqueeze(1).cpu();
  const events::ImageSize size{exposure.camera.height, exposure.camera.width};
  restored.events = events::to_events(
      events::count_events(exposure.events, {exposure.t_start_us, exposure.t_end_us}, size))[0];
  restore::Candidates& c = restored.candidates;
  c.blurry = exposure.blurry;
  c.edi = found.restorations.edi.cpu();
  if (found.restorations.efnet.defined()) c.efnet = found.restorations.efnet.cpu();
  if (allocation_) {
    const auto psi = events::polarity_projection(found.maps.voxel.values);
    c.alpha = allocation_->forward(torch::cat({exposure.blurry, psi}), index);
  }
  for (size_t k = 0; k < times.size(); ++k) {
    const torch::Tensor gain = restore::gain_at(found, how, {times[k]}).cpu();
    restore::Candidates at;
    at.blurry = exposure.blurry;
    at.edi = (exposure.blurry + options_.log_offset) * gain - options_.log_offset;
    if (found.efnet_at.defined()) {
      at.efnet = found.efnet_at[static_cast<int64_t>(k)].to(torch::kCPU, torch::kFloat32);
    }
    if (allocation_) {
      const auto psi = events::polarity_projection(found.maps.voxel.values, times[k]);
      at.alpha = allocation_->forward(torch::cat({exposure.blurry, psi}), index);
    }
    restored.at.push_back(std::move(at));
  }
  return restored;
}

torch::Tensor Deblurrer::at_all_poses(const torch::Tensor& mid, const Restored& restored) const {
  const torch::Tensor ratio = restored.gain / restored.gain[restored.gain.size(0) / 2];
  return (mid + options_.log_offset) * ratio - options_.log_offset;
}

}  // namespace jade::run
