// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/range.h"

#include "support/catch.h"

#include <torch/types.h>

#include "support/naming.h"

using namespace jade;
using namespace jade::imaging;

namespace {

/// An image whose values are multiples of 1/top, different in every channel, row and column.
torch::Tensor pattern(int64_t height, int64_t width, int64_t top) {
  return (torch::arange(3 * height * width).mul(7919).remainder(top + 1).to(torch::kFloat32) /
          double(top))
      .view({3, height, width});
}

std::string first_fault(const std::vector<torch::Tensor>& images,
                        const std::vector<std::string>& names) {
  const std::vector<std::string> faults = frame_faults(images, names);
  return faults.empty() ? "" : faults.front();
}

}  // namespace

TEST_CASE("image: frames that are all black or fill 10 or 12 of 16 bits are reported",
          "[imaging]") {
  const auto images = [](int64_t top, double steps) {
    const auto image = pattern(9, 11, top) * (double(top) / steps);
    image[0][0][0] = double(top) / steps;
    return std::vector<torch::Tensor>{image, image * 0};
  };
  const auto range_fault = [](const std::vector<torch::Tensor>& set) {
    return first_fault(set, {"a", "b"});
  };
  CHECK(range_fault({}).empty());
  CHECK_THAT(range_fault(images(255, 255)), test::naming("1 of 2 all black"));
  CHECK_THAT(range_fault(images(65535, 65535)), test::naming("1 of 2 all black"));
  CHECK_THAT(range_fault(images(15, 255)), test::naming("1 of 2 all black"));  // dark, in 8 bits
  CHECK(range_fault(images(290, 65535)).find("10-bit") != std::string::npos);
  CHECK(range_fault(images(255, 65535)).find("multiply the frames by 257") != std::string::npos);
  const std::string fault = range_fault(images(4095, 65535));
  CHECK(fault.find("4095") != std::string::npos);
  CHECK(fault.find("multiply the frames by 16") != std::string::npos);
  CHECK(range_fault({torch::zeros({3, 2, 2})}).find("black") != std::string::npos);
}

TEST_CASE("image: dark 16-bit frames among 8-bit ones are reported with the first's name",
          "[imaging]") {
  const std::vector<std::string> names{"00", "01", "02", "03"};
  const auto bright = pattern(9, 11, 255), full = pattern(9, 11, 65535);
  const auto narrow = pattern(9, 11, 4095) * (4095.0 / 65535);
  const std::string fault = first_fault({bright, bright * 0, narrow, narrow}, names);
  CHECK(fault.find("of 2 beside") != std::string::npos);
  CHECK(fault.find("first is 02") != std::string::npos);
  CHECK(fault.find("these frames by 16") != std::string::npos);
  // Beside frames that fill 16 bits, dark ones may show a dark moment.
  CHECK(first_fault({full, narrow}, names).empty());
  CHECK(first_fault({bright, full, narrow}, names).empty());
  CHECK(first_fault({bright, full}, names).empty());
}

TEST_CASE("image: a raw mosaic is distinguished from a gray frame", "[imaging]") {
  const auto rgb = [](const torch::Tensor& gray) { return gray.expand({3, -1, -1}).contiguous(); };
  const torch::Tensor row = torch::arange(60) * 0.3;
  const torch::Tensor frame =
      (0.5 + 0.2 * row.sin() * (torch::arange(40).reshape({40, 1}) * 0.2).cos()).unsqueeze(0);
  CHECK_FALSE(is_mosaic(rgb(frame)));
  torch::Tensor mosaic = frame.clone();
  mosaic[0].slice(0, 0, {}, 2).slice(1, 0, {}, 2) *= 0.7;
  mosaic[0].slice(0, 1, {}, 2).slice(1, 1, {}, 2) *= 0.85;
  CHECK(is_mosaic(rgb(mosaic)));
  // Rows of different gain are a fault of the sensor, not a filter.
  torch::Tensor rows = frame.clone();
  rows[0].slice(0, 0, {}, 2) *= 0.9;
  CHECK_FALSE(is_mosaic(rgb(rows)));
  CHECK_FALSE(is_mosaic(torch::rand({3, 8, 8})));
}

TEST_CASE("image: black, white and repeated frames are counted with the first's name",
          "[imaging]") {
  const std::vector<std::string> names{"00", "01", "02", "03", "04"};
  const auto a = pattern(9, 11, 255), b = pattern(9, 11, 251), c = pattern(9, 11, 241);
  const auto black = torch::full({3, 9, 11}, 1.0 / 255), white = torch::ones({3, 9, 11});
  CHECK(frame_faults({a, b, c, a, b}, names).empty());
  CHECK_THAT(first_fault({a, black, b, c, black}, names),
             test::naming("2 of 5 all black (the first is 01)"));
  CHECK_THAT(
      first_fault({a, white, b, black, c}, names),
      test::naming("1 of 5 all black (the first is 03)", "1 of 5 all white (the first is 01)"));
  CHECK_THAT(first_fault({white, white, white, white, white}, names),
             test::naming("5 of 5 all white"));
  CHECK_THAT(first_fault({a, b, b.clone(), c, c.clone()}, names),
             test::naming("2 of 5 identical to the frame before (the first is 02)"));
  // Frames that differ by one step of one pixel are two frames.
  auto other = b.clone();
  other[1][4][5] += 1.0 / 255;
  CHECK(frame_faults({a, b, other, c, a}, names).empty());
  CHECK(frame_faults({a, b, torch::ones({3, 9, 12}) * 0.5, c, a}, names).empty());
}
