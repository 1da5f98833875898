// SPDX-License-Identifier: Apache-2.0
#include "jade/import/motion_check.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/core/median.h"
#include "jade/imaging/color.h"

namespace jade::import {
namespace {

constexpr int64_t kSearchPx = 6;  // margin of a patch on each side, px
constexpr int64_t kMostPoints = 500;

/// Peaks of pure noise reach 7.5 standard deviations of the correlation on images of up to 346x260
/// px.
constexpr double kLeastPeak = 9;

/// Least share of an image's energy that differs from the mean of all images.
constexpr double kLeastRest = 1e-8;

/// The band of spatial frequencies used to measure motion, [H,W].
torch::Tensor pass_band(int64_t height, int64_t width) {
  const torch::Tensor square =
      at::fft_fftfreq(height).square().unsqueeze(1) + at::fft_fftfreq(width).square().unsqueeze(0);
  const auto gaussian = [&](double sigma_px) {
    return (-2 * M_PI * M_PI * sigma_px * sigma_px * square).exp();
  };
  return gaussian(1) * (1 - gaussian(double(width) / 16));
}

/// Spectra of the difference from the mean of all images, which is scaled to each by least squares.
std::vector<torch::Tensor> moving_spectra(const std::vector<torch::Tensor>& images) {
  std::vector<torch::Tensor> grays;
  for (const torch::Tensor& image : images) {
    const torch::Tensor gray = imaging::gray(image)[0].to(torch::kFloat32);
    grays.push_back(gray - gray.mean());
  }
  const torch::Tensor mean = torch::stack(grays).mean(0);
  const torch::Tensor energy = mean.square().sum().clamp_min(1e-12);
  const torch::Tensor window =
      torch::hann_window(mean.size(0)).unsqueeze(1) * torch::hann_window(mean.size(1)).unsqueeze(0);
  const torch::Tensor band = pass_band(mean.size(0), mean.size(1));
  for (torch::Tensor& gray : grays) {
    torch::Tensor rest = gray - (gray * mean).sum() / energy * mean;
    // The rounding errors of equal images would correlate as well as any texture.
    if ((rest.square().sum() < kLeastRest * gray.square().sum()).item<bool>()) {
      rest = torch::zeros_like(rest);
    }
    gray = at::fft_fft2((rest - rest.mean()) * window) * band;
  }
  return grays;
}

double signed_place(int64_t place, int64_t size) {
  return static_cast<double>(place > size / 2 ? place - size : place);
}

/// Projection of the point, px.
std::array<double, 2> seen_at(const PosedExposure& e, size_t pose, const geometry::Vector3& point) {
  return geometry::project(e.camera, geometry::transform(e.poses[pose], point));
}

/// Points well inside the image for all poses, as places [P,K,2] in px.
torch::Tensor tracks_of(const PosedExposure& e) {
  std::vector<double> places;
  const auto width = double(e.camera.width), height = double(e.camera.height);
  int64_t count = 0;
  for (const geometry::Vector3& point : e.points) {
    std::vector<double> track;
    for (size_t k = 0; k < e.poses.size(); ++k) {
      if (geometry::transform(e.poses[k], point)[2] <= 0) break;
      const auto at = seen_at(e, k, point);
      if (at[0] < kSearchPx || at[1] < kSearchPx || at[0] > width - kSearchPx ||
          at[1] > height - kSearchPx) {
        break;
      }
      track.insert(track.end(), at.begin(), at.end());
    }
    if (track.size() != 2 * e.poses.size() || count == kMostPoints) continue;
    places.insert(places.end(), track.begin(), track.end());
    ++count;
  }
  return torch::tensor(places, torch::kFloat64)
      .reshape({count, static_cast<int64_t>(e.poses.size()), 2});
}

/// Bilinear samples [3,P,N] at places [P,N,2] in px.
torch::Tensor sampled(const torch::Tensor& image, const torch::Tensor& places) {
  const auto size = torch::tensor({double(image.size(2)), double(image.size(1))}, torch::kFloat64);
  const torch::Tensor grid = (2 * places / size - 1).to(torch::kFloat32).unsqueeze(0);
  return at::grid_sampler_2d(image.to(torch::kFloat32).unsqueeze(0), grid, 0, 1,
                             /*align_corners=*/false)[0];
}

/// The patches around `base` [P,N,2] of an image averaged along the paths [P,K,2], ends at half
/// weight.
torch::Tensor blurred(const torch::Tensor& sharp, const torch::Tensor& base,
                      const torch::Tensor& ways) {
  torch::Tensor sum = torch::zeros({3, base.size(0), base.size(1)});
  const int64_t count = ways.size(1);
  for (int64_t k = 0; k < count; ++k) {
    const double weight = (k == 0 || k == count - 1 ? 0.5 : 1.0) / double(count - 1);
    sum += weight * sampled(sharp, base - ways.select(1, k).unsqueeze(1));
  }
  return sum;
}

torch::Tensor patch_offsets() {
  const torch::Tensor steps = torch::arange(-kSearchPx, kSearchPx + 1, torch::kFloat64);
  const auto mesh = torch::meshgrid({steps, steps}, "ij");
  return torch::stack({mesh[1].reshape({-1}), mesh[0].reshape({-1})}, 1);
}

}  // namespace

FrameMotion frame_motion(const std::vector<torch::Tensor>& images) {
  JADE_CHECK(images.size() >= 2, "expected at least two images, found ", images.size());
  const std::vector<torch::Tensor> spectra = moving_spectra(images);
  FrameMotion motion;
  const auto compare = [&](size_t a, size_t b) {
    const torch::Tensor cross = spectra[b] * spectra[a].conj();
    // Partial whitening: full whitening amplifies noise, none favours the coarsest structure.
    const torch::Tensor peak =
        torch::real(at::fft_ifft2(cross / cross.abs().sqrt().clamp_min(1e-9)));
    ++motion.compared;
    const double deviation = peak.std().item<double>();
    if (!(peak.max().item<double>() > kLeastPeak * deviation)) return;
    ++motion.measured;
    const int64_t place = peak.argmax().item<int64_t>(), width = peak.size(1);
    motion.shift_px = std::max(
        motion.shift_px,
        std::hypot(signed_place(place / width, peak.size(0)), signed_place(place % width, width)));
  };
  for (size_t i = 1; i < spectra.size(); ++i) {
    compare(i - 1, i);
    if (i > 1) compare(0, i);
  }
  return motion;
}

double explained_blur(const std::vector<PosedExposure>& exposures) {
  const torch::Tensor offsets = patch_offsets();
  double left = 0, still = 0, turned = 0;
  for (const PosedExposure& e : exposures) {
    const torch::Tensor tracks = tracks_of(e);
    if (tracks.size(0) == 0) continue;
    const torch::Tensor middle = tracks.select(1, tracks.size(1) / 2).unsqueeze(1);
    const torch::Tensor ways = tracks - middle;
    const torch::Tensor across = torch::stack({-ways.select(2, 1), ways.select(2, 0)}, 2);
    const torch::Tensor base = middle + offsets, blurry = sampled(e.blurry, base);
    const auto error = [&](const torch::Tensor& sum) {
      return (blurry - sum).square().sum().item<double>();
    };
    left += error(blurred(e.sharp, base, ways));
    turned += error(blurred(e.sharp, base, across));
    still += error(sampled(e.sharp, base));
  }
  const double rival = std::min(still, turned);
  return rival > 0 ? 1 - left / rival : 0;
}

double posed_blur_px(const std::vector<PosedExposure>& exposures) {
  std::vector<double> lengths;
  for (const PosedExposure& e : exposures) {
    const torch::Tensor tracks = tracks_of(e);
    if (tracks.size(0) == 0) continue;
    const torch::Tensor ways = tracks - tracks.select(1, tracks.size(1) / 2).unsqueeze(1);
    const torch::Tensor longest = 2 * ways.norm(2, 2).amax(1).contiguous();
    lengths.insert(lengths.end(), longest.const_data_ptr<double>(),
                   longest.const_data_ptr<double>() + longest.numel());
  }
  return median_of(std::move(lengths));
}

}  // namespace jade::import
