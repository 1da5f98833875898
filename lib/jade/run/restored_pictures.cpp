// SPDX-License-Identifier: Apache-2.0
#include "jade/run/restored_pictures.h"

#include <chrono>
#include <nlohmann/json.hpp>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/restore/restorations.h"
#include "jade/serve/render_queue.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

/// @throws DataError if the restorer differs from the run's.
void check_restorer(const fs::path& run, const train::RunOptions& options) {
  const std::string found = train::restorer_sha256(options);
  if (found.empty() || !fs::exists(run / "env.json")) return;
  const auto environment =
      nlohmann::json::parse(read_file(run / "env.json"), nullptr, /*allow_exceptions=*/false);
  const auto began = environment.find("restorer_sha256");
  if (began == environment.end() || *began == found) return;
  throw DataError(
      "expected the restorer that the run began with, found another; set "
      "efnet.path in its config.yaml to the file");
}

torch::Tensor density_of(const Restored& restored) {
  const torch::Tensor events = restored.events.sum(0);
  return (events / events.max().clamp_min(1)).unsqueeze(0);
}

}  // namespace

RestoredPictures::RestoredPictures(const fs::path& run, const train::RunOptions& options,
                                   const data::Dataset& dataset, torch::Device device)
    : dataset_(dataset) {
  // Training has stored its restorations in the cache.
  DeblurOptions how{options, 0, run, train::restored_times(options)};
  const bool routed =
      options.objective.target == losses::Target::kRouted && train::needs_efnet(options);
  // Try the method with most layers first.
  std::vector<std::string> methods{"edi"};
  if (train::needs_efnet(options)) methods.insert(methods.begin(), "efnet");
  if (routed) methods.insert(methods.begin(), "router");
  for (const std::string& name : methods) {
    const restore::Method& method = restore::find_method(name);
    try {
      if (method.needs_efnet) check_restorer(run, options);
      deblurrer_.emplace(how, method, dataset, device);
      efnet_ = method.needs_efnet;
      alpha_ = method.needs_run;
      return;
    } catch (const Error& problem) {
      log_warn(concat(run.string(), ": not all layers can be shown: ", problem.what()));
    }
  }
}

RestoredPictures::~RestoredPictures() {
  const std::lock_guard<std::mutex> lock(one_at_a_time_);
  ends_ = true;
}

Restored RestoredPictures::restore(int64_t index) {
  const torch::NoGradGuard no_grad;
  const std::lock_guard<std::mutex> lock(one_at_a_time_);
  if (ends_) throw Interrupted();
  return deblurrer_->restore(dataset_.train[static_cast<size_t>(index)], index);
}

const Restored& RestoredPictures::restored(int64_t index) {
  auto found = found_.find(index);
  if (found == found_.end()) {
    auto task = std::async(std::launch::async, [this, index] { return restore(index); });
    found = found_.emplace(index, task.share()).first;
  }
  if (found->second.wait_for(std::chrono::milliseconds(50)) != std::future_status::ready) {
    throw serve::NotYet();
  }
  return found->second.get();
}

std::vector<ViewPicture> RestoredPictures::of(int64_t index) {
  if (!deblurrer_) return {};
  const bool judged = true;
  std::vector<ViewPicture> pictures{
      {"EDI", [this, index] { return restored(index).candidates.edi; }, judged}};
  if (efnet_) {
    pictures.push_back(
        {"EFNet", [this, index] { return restored(index).candidates.efnet; }, judged});
  }
  if (alpha_) {
    const geometry::Intrinsics& camera = dataset_.train[static_cast<size_t>(index)].camera;
    pictures.push_back(
        {"α", [this, index, &camera] {
           return restored(index).candidates.alpha.expand({1, camera.height, camera.width});
         }});
    pictures.push_back({"fused",
                        [this, index] {
                          const restore::Candidates& all = restored(index).candidates;
                          return restore::fuse(all.alpha, {all.edi, all.efnet});
                        },
                        judged});
  }
  pictures.push_back({"event density", [this, index] { return density_of(restored(index)); }});
  return pictures;
}

}  // namespace jade::run
