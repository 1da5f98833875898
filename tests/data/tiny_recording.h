// SPDX-License-Identifier: Apache-2.0
// A small EvDeblur data set for tests: four exposures and two sharp views of noise, a camera with
// constant velocity and rotation, and an event every 100 µs.
#pragma once

#include <algorithm>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/dataset.h"
#include "jade/data/evdeblur_writer.h"

namespace jade::test {

inline constexpr int64_t kWidth = 21;
inline constexpr int64_t kHeight = 13;
inline constexpr int64_t kExposureUs = 8000;

inline geometry::Pose steady_pose(double t_us) {
  const double s = 1e-6 * t_us;
  return geometry::pose_at_centre(geometry::rotation_from_vector({0, 0.4 * s, 0.1 * s}),
                                  {2 * s, -s, 0.5 * s});
}

inline torch::Tensor noise_image(int64_t seed) {
  torch::manual_seed(static_cast<uint64_t>(seed));
  return (torch::rand({3, kHeight, kWidth}) * 255).round() / 255;
}

inline data::EvDeblurContent tiny_content() {
  data::EvDeblurContent content;
  const geometry::Intrinsics camera = geometry::Intrinsics::centred(25, kWidth, kHeight);
  for (int64_t i = 0; i < 4; ++i) {
    data::Exposure exposure;
    exposure.blurry = noise_image(i);
    exposure.t_start_us = 10000 + 20000 * i;
    exposure.t_end_us = exposure.t_start_us + kExposureUs;
    for (size_t k = 0; k < 9; ++k) {
      exposure.poses[k] = steady_pose(double(exposure.t_start_us) + double(k) * 1000);
    }
    exposure.camera = camera;
    content.train.push_back(exposure);
    content.sharp_mid.push_back(noise_image(100 + i));
  }
  // One at the middle of exposure 1, one between exposures.
  for (const int64_t t_us : {34000, 62000}) {
    content.test.push_back({"", noise_image(t_us), steady_pose(double(t_us)), camera, t_us});
  }
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  for (int64_t i = 0; i < 1000; ++i) {
    x.push_back(float(i % kWidth));
    y.push_back(float((i / 3) % kHeight));
    t.push_back(100 * i);
    p.push_back(i % 3 == 0 ? -1 : 1);
  }
  content.events = events::EventStream::from_lists(x, y, t, p);
  for (int64_t t_us = 0; t_us <= 100000; t_us += 1000) {
    content.path_t_us.push_back(t_us);
    content.path.push_back(steady_pose(double(t_us)));
  }
  content.near = 0.5;
  content.far = 4;
  return content;
}

/// Events as stored, x and y as uint16; tests may truncate or change any of the lists.
struct RawEvents {
  std::vector<double> x, y, t, p;
};

inline RawEvents raw_events(const events::EventStream& events) {
  RawEvents raw;
  const auto list = [](const torch::Tensor& values) {
    const torch::Tensor wide = values.to(torch::kFloat64).contiguous();
    return std::vector<double>(wide.data_ptr<double>(), wide.data_ptr<double>() + wide.numel());
  };
  raw.x = list(events.x());
  raw.y = list(events.y());
  raw.t = list(events.t_us());
  raw.p = list(events.polarity());
  return raw;
}

/// True if any line contains `text`.
inline bool mentions(const std::vector<std::string>& lines, const std::string& text) {
  return std::any_of(lines.begin(), lines.end(),
                     [&](const std::string& line) { return line.find(text) != std::string::npos; });
}

/// Equal 8-bit images; reading a file may round the last bit of a float differently.
inline bool same_image(const torch::Tensor& a, const torch::Tensor& b) {
  return torch::allclose(a, b, 0, 1e-6);
}

inline double pose_distance(const geometry::Pose& a, const geometry::Pose& b) {
  return (geometry::to_tensor(a) - geometry::to_tensor(b)).abs().max().item<double>();
}

}  // namespace jade::test
