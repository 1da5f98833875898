// SPDX-License-Identifier: Apache-2.0
#include "support/tiny_dataset.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <tuple>

#include "jade/data/evdeblur_writer.h"

namespace jade::test {
namespace {

constexpr double kDepth = 2.0, kThreshold = 0.2;
constexpr int64_t kExposureUs = 40000, kGapUs = 20000;
constexpr double kPixelsPerUs = 6.0 / kExposureUs;

/// The plane's pattern, in pixels of the camera at time 0.
double pattern(double x, double y, int channel) {
  const double phase = 0.7 * channel;
  return 0.5 + 0.2 * std::sin(0.9 * x + phase) * std::cos(0.5 * y) +
         0.15 * std::cos(0.35 * x - 0.6 * y + phase);
}

int pattern_of(int64_t channel, const TinyDatasetOptions& options) {
  return options.gray ? 0 : static_cast<int>(channel);
}

double shift_at(double t_us) { return kPixelsPerUs * t_us; }

torch::Tensor image_at(double t_us, const TinyDatasetOptions& options) {
  auto image = torch::empty({3, options.height, options.width});
  auto pixels = image.accessor<float, 3>();
  for (int64_t c = 0; c < 3; ++c) {
    for (int64_t y = 0; y < options.height; ++y) {
      for (int64_t x = 0; x < options.width; ++x) {
        pixels[c][y][x] = static_cast<float>(
            pattern(static_cast<double>(x) + shift_at(t_us), y, pattern_of(c, options)));
      }
    }
  }
  return image;
}

geometry::Pose pose_at(double t_us, const geometry::Intrinsics& camera) {
  geometry::Pose pose;
  pose.translation[0] = -shift_at(t_us) * kDepth / camera.fx;
  return pose;
}

double log_gray(double x, double y, double t_us, const TinyDatasetOptions& options) {
  const double sx = x + shift_at(t_us);
  const auto channel = [&](int64_t c) { return pattern(sx, y, pattern_of(c, options)); };
  return std::log(0.299 * channel(0) + 0.587 * channel(1) + 0.114 * channel(2));
}

/// Threshold crossings of each pixel over [0, end), found on a grid of 100 µs.
events::EventStream events_until(int64_t end_us, const TinyDatasetOptions& options) {
  std::vector<std::tuple<int64_t, float, float, int8_t>> all;
  for (int64_t y = 0; y < options.height; ++y) {
    for (int64_t x = 0; x < options.width; ++x) {
      double reference = log_gray(static_cast<double>(x), static_cast<double>(y), 0, options);
      for (int64_t t = 100; t < end_us; t += 100) {
        const double change = log_gray(static_cast<double>(x), static_cast<double>(y),
                                       static_cast<double>(t), options) -
                              reference;
        if (std::abs(change) < kThreshold) continue;
        const int8_t polarity = change > 0 ? 1 : -1;
        reference += polarity * kThreshold;
        all.emplace_back(t, static_cast<float>(x), static_cast<float>(y), polarity);
      }
    }
  }
  std::sort(all.begin(), all.end());
  std::vector<float> xs, ys;
  std::vector<int64_t> times;
  std::vector<int8_t> polarities;
  for (const auto& [t, x, y, polarity] : all) {
    times.push_back(t);
    xs.push_back(x);
    ys.push_back(y);
    polarities.push_back(polarity);
  }
  return events::EventStream::from_lists(xs, ys, times, polarities);
}

}  // namespace

void write_tiny_dataset(const std::filesystem::path& folder, const TinyDatasetOptions& options) {
  const auto camera = geometry::Intrinsics::centred(0.9 * static_cast<double>(options.width),
                                                    options.width, options.height);
  data::EvDeblurContent content;
  content.near = 1;
  content.far = 3;
  const int64_t end_us = options.exposures * (kExposureUs + kGapUs) + 2 * kGapUs;
  for (int64_t i = 0; i < options.exposures; ++i) {
    data::Exposure exposure;
    exposure.t_start_us = i * (kExposureUs + kGapUs);
    exposure.t_end_us = exposure.t_start_us + kExposureUs;
    constexpr int kSamples = 81;
    exposure.blurry = torch::zeros({3, options.height, options.width});
    for (int s = 0; s < kSamples; ++s) {
      const double t =
          static_cast<double>(exposure.t_start_us) + kExposureUs * (s + 0.5) / kSamples;
      exposure.blurry += image_at(t, options) / kSamples;
    }
    exposure.camera = camera;
    for (int k = 0; k < geometry::kExposurePoses; ++k) {
      exposure.poses[k] =
          pose_at(static_cast<double>(exposure.t_start_us) + kExposureUs * k / 8.0, camera);
    }
    content.train.push_back(exposure);
  }
  for (int64_t i = 0; i < 2; ++i) {
    data::SharpView view;
    view.t_us = end_us - kGapUs + i * 1000;
    view.image = image_at(static_cast<double>(view.t_us), options);
    view.pose = pose_at(static_cast<double>(view.t_us), camera);
    view.camera = camera;
    content.test.push_back(view);
  }
  const int64_t events_end =
      options.last_exposure_without_events ? content.train.back().t_start_us : end_us;
  content.events = events_until(events_end, options);
  for (int64_t t = 0; t <= end_us; t += kGapUs / 2) {
    content.path_t_us.push_back(t);
    content.path.push_back(pose_at(static_cast<double>(t), camera));
  }
  data::write_evdeblur(folder, content);
}

}  // namespace jade::test
