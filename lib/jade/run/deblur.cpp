// SPDX-License-Identifier: Apache-2.0
#include "jade/run/deblur.h"

#include <torch/types.h>
#include <unordered_set>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/core/text.h"
#include "jade/data/masks.h"
#include "jade/data/truths.h"
#include "jade/imaging/image_io.h"
#include "jade/run/deblur_pictures.h"
#include "jade/run/evaluate.h"
#include "jade/train/exposure_gains.h"

namespace jade::run {
namespace {

namespace fs = std::filesystem;

void save(const fs::path& stem, const torch::Tensor& image, bool npy) {
  imaging::write_image(stem.string() + ".png", image);
  if (npy) imaging::write_image(stem.string() + ".npy", image);
}

/// The blurry frame first, the method's own result last.
/// @param fit_gain  whether to fit each one's brightness to the true image
std::vector<eval::Scores> score_all(const restore::Method& method,
                                    const restore::Candidates& candidates, const data::Truth& truth,
                                    const eval::Lpips& lpips, bool fit_gain) {
  restore::Candidates c = candidates;
  c.truth = truth.image;
  const auto score = [&](const std::string& name, const torch::Tensor& image) {
    return eval::score(name, fit_gain ? as_bright_as(truth.image, image, truth.mask) : image,
                       truth.image, &lpips, truth.mask);
  };
  std::vector<eval::Scores> scores{score("blurry", c.blurry)};
  for (const restore::Method& other : restore::methods()) {
    const bool possible = c.efnet.defined() ? !other.needs_run : other.name == "edi";
    if (possible && other.name != method.name) {
      scores.push_back(score(other.name, other.restore(c)));
    }
  }
  scores.push_back(score(method.name, method.restore(c)));
  return scores;
}

struct View {
  const data::Exposure* exposure;
  int64_t index;  ///< among the training views; -1: held out
};

/// The exposures to restore: all, but those held out if the method has a map per training view.
std::vector<View> views_of(const data::Dataset& dataset, const DeblurOptions& options,
                           const restore::Method& method) {
  std::vector<View> views;
  for (const data::Exposure& exposure : dataset.train) {
    views.push_back({&exposure, static_cast<int64_t>(views.size())});
  }
  if (!dataset.held_out.empty() && method.needs_run &&
      load_run_options(options.run).allocation.kind == router::AllocationKind::kPerViewMap) {
    log_warn(concat(dataset.held_out.size(),
                    " held-out exposures are left out, because the run "
                    "has learned maps of training views only (allocation.kind per_view_map)"));
    return views;
  }
  for (const data::Exposure& exposure : dataset.held_out) views.push_back({&exposure, -1});
  return views;
}

/// A moment other than the middle, and the suffix of its files.
struct NamedMoment {
  double u;
  std::string ending;
};

/// @param poses  whether poses are restored rather than transformed from the middle
std::vector<NamedMoment> moments_of(const DeblurPictures& pictures, bool poses,
                                    const geometry::ExposureOptions& exposure) {
  std::vector<NamedMoment> moments;
  for (const double u : pictures.times) moments.push_back({u, concat("_t", u)});
  if (!poses) return moments;
  const auto all = geometry::quadrature(exposure.quadrature, exposure.samples).u;
  for (size_t k = 0; k < all.size(); ++k) {
    moments.push_back({all[k], "_" + padded(k, all.size())});
  }
  return moments;
}

/// @param poses  number of additional, numbered pictures per exposure
/// @throws ConfigError if one picture would overwrite another.
void check_names(const std::vector<View>& views, const std::vector<NamedMoment>& moments,
                 size_t poses) {
  std::unordered_set<std::string> names;
  const auto add = [&](const std::string& name) {
    if (names.insert(name).second) return;
    throw ConfigError(concat("expected a name for each picture, found '", name,
                             "' for two; --times must differ by a millionth or more, and no frame ",
                             "may be named as another one with a moment"));
  };
  for (const View& view : views) {
    const std::string& name = view.exposure->name;
    add(name);
    for (const NamedMoment& moment : moments) add(name + moment.ending);
    for (size_t k = 0; k < poses; ++k) add(concat(name, "_", padded(k, poses)));
  }
}

}  // namespace

Deblurred deblur(const data::Dataset& dataset, const DeblurOptions& options,
                 const restore::Method& method, const fs::path& output,
                 const DeblurPictures& pictures, torch::Device device) {
  const torch::NoGradGuard no_grad;
  Deblurrer deblurrer(options, method, dataset, device);
  const bool poses_restored =
      pictures.poses && deblurrer.has_any_time_network() && !method.needs_truth;
  const auto moments = moments_of(pictures, poses_restored, options.settings.exposure);
  const bool poses_carried = pictures.poses && !poses_restored;
  const std::vector<View> views = views_of(dataset, options, method);
  const auto poses = static_cast<size_t>(options.settings.exposure.samples);
  check_names(views, moments, poses_carried ? poses : 0);
  std::vector<double> times;
  for (const NamedMoment& moment : moments) times.push_back(moment.u);
  const eval::Lpips lpips(device);
  // With automatic exposure, frames are not as bright as the true images.
  const bool fit_gain = train::learns_gains({}, dataset);
  Deblurred deblurred;
  Progress progress("restoring", static_cast<int64_t>(views.size()), 0, "frames");
  for (const View& view : views) {
    throw_if_interrupted();
    const data::Exposure& exposure = *view.exposure;
    const auto truth = data::truth_of(dataset, exposure);
    if (method.needs_truth && !truth) {
      ++deblurred.without_truth;
      continue;
    }
    Restored restored = deblurrer.restore(exposure, view.index, times);
    if (truth) restored.candidates.truth = truth->image;
    // Networks and offsets change pixels that a mask set to 0.
    const auto counted = [&](const torch::Tensor& image) {
      return data::masked(image, exposure.mask);
    };
    const torch::Tensor result = counted(method.restore(restored.candidates));
    save(output / exposure.name, result, pictures.npy);
    for (size_t k = 0; k < moments.size(); ++k) {
      save(output / (exposure.name + moments[k].ending), counted(method.restore(restored.at[k])),
           pictures.npy);
    }
    if (poses_carried) {
      const torch::Tensor latents = deblurrer.at_all_poses(result, restored);
      for (size_t k = 0; k < poses; ++k) {
        save(output / concat(exposure.name, "_", padded(k, poses)),
             counted(latents[static_cast<int64_t>(k)]), pictures.npy);
      }
    }
    write_side_pictures(output, exposure.name, restored);
    ++deblurred.written;
    if (truth) {
      deblurred.views.push_back({exposure.name, truth->name,
                                 score_all(method, restored.candidates, *truth, lpips, fit_gain)});
    }
    if (progress.step()) progress.show();
  }
  return deblurred;
}

}  // namespace jade::run
