// SPDX-License-Identifier: Apache-2.0
#include "jade/simulate/optics.h"

#include <ATen/Parallel.h>
#include <cmath>

#include "jade/core/random.h"
#include "jade/simulate/sensor.h"
#include "jade/world/noise.h"

namespace jade::simulate {
namespace {

constexpr double kCycle = 6.283185307179586;
constexpr int kStepsPerFlicker = 24;

double vignette(const OpticsOptions& o, double x, double y, double width, double height) {
  const double dx = x + 0.5 - 0.5 * width, dy = y + 0.5 - 0.5 * height;
  return 1 - o.vignetting * 4 * (dx * dx + dy * dy) / (width * width + height * height);
}

/// Adds a soft dark spot.
void add_spot(const OpticsOptions& o, int64_t width, int64_t height, world::Draw& draw,
              std::vector<float>& passed) {
  const double x = draw.uniform() * static_cast<double>(width);
  const double y = draw.uniform() * static_cast<double>(height);
  const double radius = o.dust_radius_px * draw.range(0.5f, 1.5f), depth = draw.range(0.3f, 0.8f);
  for (int64_t row = 0; row < height; ++row) {
    for (int64_t column = 0; column < width; ++column) {
      const double far =
          std::hypot(static_cast<double>(column) + 0.5 - x, static_cast<double>(row) + 0.5 - y) /
          radius;
      passed[static_cast<size_t>(row * width + column)] *=
          static_cast<float>(1 - depth * std::exp(-far * far * far * far));
    }
  }
}

}  // namespace

Optics::Optics(const SimulateOptions& options, int64_t width, int64_t height, uint64_t seed)
    : options_(options) {
  const OpticsOptions& o = options.optics;
  if (o.vignetting <= 0 && o.dust == 0) return;
  for (int64_t i = 0; i < width * height; ++i) {
    passed_.push_back(static_cast<float>(
        vignette(o, static_cast<double>(i % width), static_cast<double>(i / width),
                 static_cast<double>(width), static_cast<double>(height))));
  }
  world::Draw draw(derive_seed(seed, "dust"));
  for (int64_t i = 0; i < o.dust; ++i) add_spot(o, width, height, draw, passed_);
}

double Optics::flicker_at(double t_us) const {
  const LightOptions& o = options_.light;
  return 1 + o.flicker * std::cos(kCycle * o.flicker_hz * t_us * 1e-6);
}

double Optics::flicker_step_us() const {
  return 1e6 / options_.light.flicker_hz / kStepsPerFlicker;
}

void Optics::light(const world::SharpFrame& frame, double t_us, world::SharpFrame& lit) const {
  scale(frame, options_.light.brightness * (flickers() ? flicker_at(t_us) : 1), passed_, lit);
}

void Optics::brighten(world::SharpFrame& frame) const {
  if (options_.light.brightness != 1) scale(frame, options_.light.brightness, {}, frame);
}

void Optics::scale(const world::SharpFrame& frame, double factor, const std::vector<float>& map,
                   world::SharpFrame& scaled) const {
  const Encoding encoding = options_.image.encoding;
  const auto pixels = static_cast<int64_t>(frame.depth.size());
  scaled.resize(frame.width, frame.height);
  if (&scaled != &frame) scaled.depth = frame.depth;
  at::parallel_for(0, 3 * pixels, 8192, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const auto k = static_cast<size_t>(i);
      const float passed = map.empty() ? 1.0f : map[static_cast<size_t>(i % pixels)];
      scaled.rgb[k] =
          encode(decode(frame.rgb[k], encoding) * static_cast<float>(factor) * passed, encoding);
    }
  });
}

void mix(const world::SharpFrame& before, const world::SharpFrame& after, float share,
         world::SharpFrame& mixed) {
  mixed.resize(before.width, before.height);
  for (size_t i = 0; i < mixed.rgb.size(); ++i) {
    mixed.rgb[i] = before.rgb[i] + share * (after.rgb[i] - before.rgb[i]);
  }
  mixed.depth = before.depth;
}

}  // namespace jade::simulate
