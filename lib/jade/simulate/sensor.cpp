// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/sensor.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>

#include "jade/data/bayer.h"
#include "jade/world/noise.h"

namespace jade::simulate {
namespace {

torch::Tensor quantized(const torch::Tensor& image) {
  return (image.clamp(0, 1) * 255).round() / 255;
}

}  // namespace

float decode(float v, Encoding encoding) {
  if (encoding == Encoding::kLinear) return v;
  return v <= 0.04045f ? v / 12.92f : std::pow((v + 0.055f) / 1.055f, 2.4f);
}

float encode(float v, Encoding encoding) {
  if (encoding == Encoding::kLinear) return v;
  return v <= 0.0031308f ? 12.92f * v : 1.055f * std::pow(v, 1 / 2.4f) - 0.055f;
}

void event_intensity(const world::SharpFrame& frame, const ImageSensorOptions& image,
                     const EventSensorOptions& events, std::vector<float>& intensity) {
  const int64_t pixels = frame.width * frame.height;
  const bool light = events.space == Space::kLinear && image.encoding != Encoding::kLinear;
  intensity.resize(static_cast<size_t>(pixels));
  at::parallel_for(0, pixels, 4096, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      float c[3] = {frame.channel(0)[i], frame.channel(1)[i], frame.channel(2)[i]};
      for (float& v : c) v = light ? decode(v, image.encoding) : v;
      intensity[static_cast<size_t>(i)] =
          events.bayer == Bayer::kRggb ? c[data::filter_channel(i / frame.width, i % frame.width)]
                                       : 0.299f * c[0] + 0.587f * c[1] + 0.114f * c[2];
    }
  });
}

Exposing::Exposing(const ImageSensorOptions& options, int64_t width, int64_t height)
    : options_(options),
      width_(width),
      height_(height),
      in_light_(options.blur_space == Space::kLinear && options.encoding != Encoding::kLinear),
      sum_(static_cast<size_t>(3 * width * height)) {}

void Exposing::add(const world::SharpFrame& before, const world::SharpFrame& after,
                   double duration_us) {
  total_us_ += duration_us;
  at::parallel_for(0, static_cast<int64_t>(sum_.size()), 8192, [&](int64_t begin, int64_t end) {
    for (auto i = static_cast<size_t>(begin); i < static_cast<size_t>(end); ++i) {
      float a = before.rgb[i], b = after.rgb[i];
      if (in_light_) a = decode(a, options_.encoding), b = decode(b, options_.encoding);
      sum_[i] += 0.5 * duration_us * (static_cast<double>(a) + b);
    }
  });
}

torch::Tensor Exposing::mean() const {
  auto image = torch::empty({3, height_, width_});
  auto* out = image.data_ptr<float>();
  for (size_t i = 0; i < sum_.size(); ++i) {
    const auto value = static_cast<float>(sum_[i] / total_us_);
    out[i] = in_light_ ? encode(value, options_.encoding) : value;
  }
  return image;
}

torch::Tensor Exposing::develop(uint64_t seed, const ExposureSetting& setting,
                                const FixedPattern* pattern) const {
  auto image = mean();
  auto* out = image.data_ptr<float>();
  const auto pixels = static_cast<size_t>(width_ * height_);
  const bool patterned = pattern != nullptr && !pattern->is_empty();
  const bool changed = options_.full_well > 0 || options_.read_noise > 0 || patterned ||
                       setting.time != 1 || setting.gain != 1;
  at::parallel_for(0, changed ? image.numel() : 0, 8192, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      world::Draw draw(seed, static_cast<uint64_t>(i));
      double light = decode(std::max(out[i], 0.0f), options_.encoding) * setting.time;
      light = std::min(light, 1.0);
      if (options_.full_well > 0)
        light = draw.poisson(light * options_.full_well) / options_.full_well;
      light += options_.read_noise * draw.normal();
      light *= setting.gain;
      if (patterned) light = pattern->apply(light, static_cast<size_t>(i) % pixels);
      out[i] = encode(static_cast<float>(std::clamp(light, 0.0, 1.0)), options_.encoding);
    }
  });
  return quantized(image);
}

torch::Tensor to_image(const world::SharpFrame& frame) {
  const auto image = torch::from_blob(const_cast<float*>(frame.rgb.data()),
                                      {3, frame.height, frame.width}, torch::kFloat32);
  return quantized(image);
}

}  // namespace jade::simulate
