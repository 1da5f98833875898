// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/range.h"

#include "support/catch.h"

#include <torch/types.h>

using namespace jade::imaging;

namespace {

/// An image whose values are multiples of 1/top, different in every channel, row and column.
torch::Tensor pattern(int64_t height, int64_t width, int64_t top) {
  return (torch::arange(3 * height * width).mul(7919).remainder(top + 1).to(torch::kFloat32) /
          double(top))
      .view({3, height, width});
}

}  // namespace

TEST_CASE("image: frames that are all black or fill 10 or 12 of 16 bits are reported",
          "[imaging]") {
  const auto images = [](int64_t top, double steps) {
    const auto image = pattern(9, 11, top) * (double(top) / steps);
    image[0][0][0] = double(top) / steps;
    return std::vector<torch::Tensor>{image, image * 0};
  };
  CHECK(range_fault({}).empty());
  CHECK(range_fault(images(255, 255)).empty());
  CHECK(range_fault(images(65535, 65535)).empty());
  CHECK(range_fault(images(15, 255)).empty());  // dark, in 8 bits
  CHECK(range_fault(images(290, 65535)).find("10-bit") != std::string::npos);
  CHECK(range_fault(images(255, 65535)).find("multiply the frames by 257") != std::string::npos);
  const std::string fault = range_fault(images(4095, 65535));
  CHECK(fault.find("4095") != std::string::npos);
  CHECK(fault.find("multiply the frames by 16") != std::string::npos);
  CHECK(range_fault({torch::zeros({3, 2, 2})}).find("black") != std::string::npos);
}
