// SPDX-License-Identifier: Apache-2.0
#include "jade/train/view_memory.h"

#include <torch/types.h>

#include "jade/imaging/ssim.h"
#include "jade/train/plan.h"

namespace jade::train {
namespace {

/// Bytes of device memory that are still free for constants.
class Budget {
 public:
  explicit Budget(int64_t bytes) : left_(bytes) {}

  /// Takes so many bytes, or none.
  bool take(int64_t bytes) {
    if (bytes > left_) return false;
    left_ -= bytes;
    return true;
  }

 private:
  int64_t left_;
};

int64_t bytes_of(const torch::Tensor& tensor) {
  return tensor.defined() ? static_cast<int64_t>(tensor.storage().nbytes()) : 0;
}

}  // namespace

torch::Tensor moved(const torch::Tensor& moments, torch::Device device) {
  if (!moments.defined()) return moments;
  const bool repeated = moments.size(0) > 1 && moments.stride(0) == 0;
  if (!repeated) return moments.to(device);
  return moments.narrow(0, 0, 1).to(device).expand(moments.sizes());
}

torch::Tensor fetched(const torch::Tensor& tensor, torch::Device device) {
  if (tensor.device().type() == device.type()) return tensor.to(torch::kFloat32);
  const torch::Tensor locked = torch::empty_like(tensor, tensor.options().pinned_memory(true));
  locked.copy_(tensor);
  return locked.to(device, /*non_blocking=*/true).to(torch::kFloat32);
}

View with_frame(View view, torch::Device device) {
  for (torch::Tensor* const each : {&view.blurry, &view.mask, &view.fixed_target}) {
    if (each->defined()) *each = fetched(*each, device);
  }
  if (!view.blurry_moments.mean.defined()) {
    view.blurry_moments = imaging::ssim_target(view.blurry);
  }
  return view;
}

void place_constants(const RunOptions& options, torch::Device device, int64_t most_bytes,
                     std::vector<View>& views) {
  int64_t frames = 0, factors = 0, restored = 0;
  for (const View& view : views) {
    frames += 3 * bytes_of(view.blurry) + bytes_of(view.mask) + bytes_of(view.fixed_target);
    factors += bytes_of(view.edi_factors) + bytes_of(view.taught_factors);
    restored += bytes_of(view.restored_poses.efnet);
  }
  Budget budget(most_bytes);
  const bool all = !device.is_cuda();
  const bool place_frames =
      budget.take(frames) || all || options.objective.target == losses::Target::kRouted;
  const bool place_factors = budget.take(factors) || all;
  const bool place_restored = budget.take(restored) || all;
  for (View& view : views) {
    if (place_frames) {
      for (torch::Tensor* const each : {&view.blurry, &view.mask, &view.fixed_target}) {
        *each = moved(*each, device);
      }
      view.blurry_moments = imaging::ssim_target(view.blurry);
    }
    if (place_factors) {
      view.edi_factors = moved(view.edi_factors, device);
      view.taught_factors = moved(view.taught_factors, device);
    }
    if (place_restored) view.restored_poses.efnet = moved(view.restored_poses.efnet, device);
  }
}

}  // namespace jade::train
