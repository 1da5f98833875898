// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/warp.h"

#include <opencv2/imgproc.hpp>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::imaging {
namespace {

cv::Mat header_of(const torch::Tensor& plane) {
  return {int(plane.size(0)), int(plane.size(1)), CV_32F,
          const_cast<float*>(plane.const_data_ptr<float>())};
}

}  // namespace

torch::Tensor remap(const torch::Tensor& image, const torch::Tensor& map) {
  check_shape(image, "image", {-1, -1, -1});
  check_shape(map, "map", {2, -1, -1});
  check_dtype(image, "image", torch::kFloat32);
  check_dtype(map, "map", torch::kFloat32);
  JADE_CHECK(image.is_cpu() && map.is_cpu() && image.numel() > 0 && map.numel() > 0,
             "remap: expected an image and a map on the CPU");
  const torch::Tensor source = image.contiguous();
  const auto width = double(image.size(2)), height = double(image.size(1));
  // NaN fails every comparison.
  const torch::Tensor inside = (map[0] > -1) & (map[0] < width) & (map[1] > -1) & (map[1] < height);
  const torch::Tensor columns = torch::where(inside, map[0], 0).contiguous();
  const torch::Tensor rows = torch::where(inside, map[1], 0).contiguous();
  const torch::Tensor out =
      torch::empty({image.size(0), map.size(1), map.size(2)}, torch::kFloat32);
  for (int64_t c = 0; c < image.size(0); ++c) {
    const torch::Tensor target = out[c];
    cv::Mat result = header_of(target);
    cv::remap(header_of(source[c]), result, header_of(columns), header_of(rows), cv::INTER_CUBIC,
              cv::BORDER_REPLICATE);
  }
  return out.clamp(0, 1) * inside;
}

torch::Tensor remap_mask(const torch::Tensor& mask, const torch::Tensor& map) {
  // Bicubic samples reach two pixels from the nearest one.
  const torch::Tensor excluded = mask.logical_not().to(torch::kFloat32).unsqueeze(0);
  const torch::Tensor near = torch::max_pool2d(excluded, {5, 5}, {1, 1}, {2, 2})[0];
  return remap(1 - near, map) > 0.5;
}

}  // namespace jade::imaging
