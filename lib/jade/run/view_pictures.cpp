// SPDX-License-Identifier: Apache-2.0
#include "jade/run/view_pictures.h"

#include <iterator>
#include <utility>

#include "jade/data/masks.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/run/evaluate.h"
#include "jade/train/routing_step.h"

namespace jade::run {
namespace {

ViewPicture render_picture(const data::Exposure& exposure, const GaussianSource& gaussians,
                           const splat::RenderOptions& draw) {
  return {"render",
          [&exposure, gaussians, draw] {
            return render_view(gaussians(), exposure.poses[geometry::kMidPose], exposure.camera,
                               draw);
          },
          true};
}

void add_truth(const torch::Tensor& truth, std::vector<ViewPicture>& pictures) {
  if (truth.defined()) pictures.push_back({"truth", [truth] { return truth; }, false, true});
}

}  // namespace

torch::Tensor truth_of(const data::Dataset& dataset, int64_t exposure) {
  for (const data::SharpView& view : dataset.test) {
    if (data::exposure_of(dataset, view) == exposure) return view.image;
  }
  return {};
}

torch::Tensor truth_mask_of(const data::Dataset& dataset, int64_t exposure) {
  const torch::Tensor& mask = dataset.train[static_cast<size_t>(exposure)].mask;
  for (const data::SharpView& view : dataset.test) {
    if (data::exposure_of(dataset, view) == exposure) return data::both_masks(mask, view.mask);
  }
  return mask;
}

std::vector<ViewPicture> training_pictures(const data::Dataset& dataset,
                                           const train::ViewBank& bank, int64_t index,
                                           train::TrainState& state,
                                           const splat::RenderOptions& draw) {
  const data::Exposure& exposure = dataset.train[static_cast<size_t>(index)];
  const auto view = [&bank, index] { return bank.picture_view(index); };
  const bool judged = true, fixed = true;
  std::vector<ViewPicture> pictures{
      {"blurry", [view] { return view().blurry(); }, judged, fixed},
      {"EDI", [view] { return view().restorations.edi; }, judged, fixed},
  };
  if (bank.has_efnet()) {
    pictures.push_back({"EFNet", [view] { return view().restorations.efnet; }, judged, fixed});
  }
  if (state.allocation) {
    pictures.push_back({"α", [view, &state, &exposure, index] {
                          return train::allocation_map(state, view(), index)
                              .expand({1, exposure.camera.height, exposure.camera.width});
                        }});
    pictures.push_back({"fused",
                        [view, &state, index] { return train::scene_target(state, view(), index); },
                        judged});
  }
  // Normalised counts, as used in the correlation with α.
  pictures.push_back({"event density",
                      [&bank, index] {
                        const torch::Tensor density = bank.density(index);
                        return (density / density.max().clamp_min(1)).unsqueeze(0);
                      },
                      false, fixed});
  const auto gaussians = [&state] { return state.gaussians.detached(); };
  pictures.push_back(render_picture(exposure, gaussians, draw));
  add_truth(truth_of(dataset, index), pictures);
  return pictures;
}

std::vector<ViewPicture> exposure_pictures(const data::Dataset& dataset, int64_t index,
                                           std::vector<ViewPicture> known,
                                           const GaussianSource& gaussians,
                                           const splat::RenderOptions& draw) {
  const data::Exposure& exposure = dataset.train[static_cast<size_t>(index)];
  std::vector<ViewPicture> pictures{{"blurry", [&exposure] { return exposure.blurry; }, true}};
  std::move(known.begin(), known.end(), std::back_inserter(pictures));
  pictures.push_back(render_picture(exposure, gaussians, draw));
  add_truth(truth_of(dataset, index), pictures);
  return pictures;
}

std::vector<ViewPicture> test_pictures(const data::SharpView& view, const GaussianSource& gaussians,
                                       const splat::RenderOptions& draw) {
  std::vector<ViewPicture> pictures{
      {"render",
       [&view, gaussians, draw] { return render_view(gaussians(), view.pose, view.camera, draw); },
       true}};
  add_truth(view.image, pictures);
  return pictures;
}

}  // namespace jade::run
