// SPDX-License-Identifier: Apache-2.0
// Applies EDI and the kernel of Eq. (7) to images; the library itself stores the factors and
// multiplies where needed.
#pragma once

#include <torch/types.h>

#include "jade/imaging/edi.h"
#include "jade/imaging/reblur.h"

namespace jade::test {

/// EDI of one exposure at the moments of its integral.
struct EdiKernel {
  torch::Tensor gain;  ///< [S,H,W], I_s / B
  torch::Tensor blur;  ///< [H,W], B / I_mid
};

inline EdiKernel edi_kernel(const torch::Tensor& windows,
                            geometry::QuadratureRule rule = geometry::QuadratureRule::kEqual) {
  const int64_t moments = windows.size(0) + 1;
  const auto gain =
      imaging::edi_gain(windows, rule, torch::linspace(0, 1, moments, torch::kFloat64));
  return {gain, 1 / gain[moments / 2]};
}

/// The latent image at pose k, 0 to 8, of a blurry one [C,H,W].
inline torch::Tensor edi_at(const torch::Tensor& blurry, const EdiKernel& kernel, int64_t k) {
  return blurry * kernel.gain.narrow(0, k, 1);
}

/// All nine latent images, [9,C,H,W].
inline torch::Tensor edi_all(const torch::Tensor& blurry, const EdiKernel& kernel) {
  return blurry.unsqueeze(0) * kernel.gain.unsqueeze(1);
}

/// Nine-sample blur of a mid-exposure image: the inverse of EDI.
inline torch::Tensor reblur_exposure(const torch::Tensor& mid, const EdiKernel& kernel) {
  return mid * kernel.blur.unsqueeze(0);
}

/// The reblur operator of Eq. (7).
inline torch::Tensor reblur(const torch::Tensor& image, const events::EventVoxel& voxel,
                            double contrast) {
  return image * imaging::reblur_kernel(voxel, contrast);
}

/// The mid-exposure image whose reblur is `blurry`. With contrast Θ · v_max it is the EDI of T
/// samples.
inline torch::Tensor unblur(const torch::Tensor& blurry, const events::EventVoxel& voxel,
                            double contrast) {
  return blurry / imaging::reblur_kernel(voxel, contrast);
}

}  // namespace jade::test
