// SPDX-License-Identifier: Apache-2.0
#include "jade/geometry/undistort.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <torch/types.h>

#include "jade/core/check.h"

namespace jade::geometry {
namespace {

/// Fills a [2,H,W] map with place(column, row), row by row in threads.
template <class Place>
torch::Tensor make_map(int64_t height, int64_t width, const Place& place) {
  auto map = torch::empty({2, height, width}, torch::kFloat32);
  float* data = map.mutable_data_ptr<float>();
  at::parallel_for(0, height, 8, [&](int64_t begin, int64_t end) {
    for (int64_t row = begin; row < end; ++row) {
      for (int64_t column = 0; column < width; ++column) {
        const auto [x, y] = place(double(column), double(row));
        data[row * width + column] = float(x);
        data[(height + row) * width + column] = float(y);
      }
    }
  });
  return map;
}

std::array<double, 2> pixel_index(const Intrinsics& camera,
                                  const std::array<double, 2>& direction) {
  const auto [u, v] = project(camera, {direction[0], direction[1], 1.0});
  return {u - 0.5, v - 0.5};
}

}  // namespace

std::array<double, 2> distort(const Distortion& lens, double x, double y) {
  const double rho = x * x + y * y;
  const double radial = 1 + rho * (lens.k1 + rho * (lens.k2 + rho * lens.k3));
  return {x * radial + 2 * lens.p1 * x * y + lens.p2 * (rho + 2 * x * x),
          y * radial + lens.p1 * (rho + 2 * y * y) + 2 * lens.p2 * x * y};
}

std::array<double, 2> undistort(const Distortion& lens, double x, double y) {
  double u = x, v = y;
  for (int step = 0; step < 30; ++step) {
    const double rho = u * u + v * v;
    const double radial = 1 + rho * (lens.k1 + rho * (lens.k2 + rho * lens.k3));
    const double slope = 2 * (lens.k1 + rho * (2 * lens.k2 + rho * 3 * lens.k3));
    const double uu = radial + slope * u * u + 2 * lens.p1 * v + 6 * lens.p2 * u;
    const double uv = slope * u * v + 2 * lens.p1 * u + 2 * lens.p2 * v;
    const double vv = radial + slope * v * v + 6 * lens.p1 * v + 2 * lens.p2 * u;
    const double determinant = uu * vv - uv * uv;
    if (!(determinant > 1e-9)) break;  // beyond the fold of the lens
    const auto [dx, dy] = distort(lens, u, v);
    const double rx = x - dx, ry = y - dy;
    if (std::abs(rx) + std::abs(ry) < 1e-13) return {u, v};
    u += (vv * rx - uv * ry) / determinant;
    v += (uu * ry - uv * rx) / determinant;
  }
  const auto [dx, dy] = distort(lens, u, v);
  if (std::abs(x - dx) + std::abs(y - dy) < 1e-9) return {u, v};
  const double nan = std::numeric_limits<double>::quiet_NaN();
  return {nan, nan};
}

torch::Tensor undistortion_map(const Intrinsics& raw, const Distortion& lens,
                               const Intrinsics& rectified) {
  check_camera(raw, "raw camera");
  check_camera(rectified, "rectified camera");
  return make_map(rectified.height, rectified.width, [&](double column, double row) {
    const auto direction = unproject(rectified, column + 0.5, row + 0.5);
    return pixel_index(raw, distort(lens, direction[0], direction[1]));
  });
}

torch::Tensor rectification_map(const Intrinsics& raw, const Distortion& lens,
                                const Intrinsics& rectified) {
  check_camera(raw, "raw camera");
  check_camera(rectified, "rectified camera");
  return make_map(raw.height, raw.width, [&](double column, double row) {
    const auto direction = unproject(raw, column + 0.5, row + 0.5);
    return pixel_index(rectified, undistort(lens, direction[0], direction[1]));
  });
}

torch::Tensor sample(const torch::Tensor& image, const torch::Tensor& map) {
  check_shape(image, "image", {-1, -1, -1});
  check_shape(map, "map", {2, -1, -1});
  check_dtype(image, "image", torch::kFloat32);
  check_dtype(map, "map", torch::kFloat32);
  JADE_CHECK(image.is_cpu() && map.is_cpu() && image.numel() > 0,
             "sample: expected an image on the CPU");
  const auto source = image.contiguous(), places = map.contiguous();
  const int64_t channels = image.size(0), height = image.size(1), width = image.size(2);
  const int64_t pixels = map.size(1) * map.size(2);
  auto out = torch::zeros({channels, map.size(1), map.size(2)}, torch::kFloat32);
  const float *in = source.const_data_ptr<float>(), *xs = places.const_data_ptr<float>(),
              *ys = xs + pixels;
  float* target = out.mutable_data_ptr<float>();
  at::parallel_for(0, pixels, 4096, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      if (!std::isfinite(xs[i]) || !std::isfinite(ys[i])) continue;
      const float x = std::clamp(xs[i], 0.0f, float(width - 1)),
                  y = std::clamp(ys[i], 0.0f, float(height - 1));
      const int64_t x0 = int64_t(x), y0 = int64_t(y);
      const int64_t x1 = std::min(x0 + 1, width - 1), y1 = std::min(y0 + 1, height - 1);
      const float fx = x - float(x0), fy = y - float(y0);
      for (int64_t c = 0; c < channels; ++c) {
        const float* plane = in + c * height * width;
        const float top = plane[y0 * width + x0] * (1 - fx) + plane[y0 * width + x1] * fx;
        const float bottom = plane[y1 * width + x0] * (1 - fx) + plane[y1 * width + x1] * fx;
        target[c * pixels + i] = top * (1 - fy) + bottom * fy;
      }
    }
  });
  return out;
}

}  // namespace jade::geometry
