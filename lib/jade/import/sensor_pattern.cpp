// SPDX-License-Identifier: Apache-2.0
#include "jade/import/sensor_pattern.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/imaging/color.h"
#include "jade/import/color.h"
#include "jade/import/motion_check.h"
#include "jade/io/npy.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Places = std::vector<std::array<double, 2>>;

constexpr char kFile[] = "pattern.json", kArrays[] = "pattern.npz";
constexpr size_t kFewestFrames = 8;
/// Frames that are looked at, spread over the recording, and their values altogether (256 MB).
constexpr size_t kMostFrames = 120, kMostValues = size_t{64} << 20;
constexpr double kLowPass_px = 8;        // wider than dust
constexpr double kNearby_px = 3;         // over which the scene's own contrast is measured
constexpr double kLeastPattern = 0.003;  // of white, standard deviation
/// Power against that of the scene left in the mean, below which nothing is kept.
constexpr double kClearPower = 4;
/// Frequencies of which the mean keeps more of the scene tell nothing of a pattern.
constexpr double kMostOfScene = 0.5;
/// Spots stand out of the usual pixel by so many deviations, are this deep at least, in parts of
/// white, and so large a part of the frames shows them on one side of their surroundings. On the
/// battery's vignetting_dust 186 pixels are above 4 deviations, and all of them pass; without dust
/// none does.
constexpr double kClearSpot = 4, kLeastSpot = 0.01, kOnOneSide = 0.9;
constexpr double kEdgeOfSpot = 1.5, kEdgeOnOneSide = 0.85;
constexpr double kSaturated = 1 - 0.5 / 255;

/// [A,B,H,W] through a separable Gaussian; borders continue.
torch::Tensor blurred(const torch::Tensor& images, double sigma_px) {
  const auto radius = int64_t(std::ceil(3 * sigma_px));
  torch::Tensor kernel =
      (-torch::arange(-radius, radius + 1, torch::kFloat32).square() / (2 * sigma_px * sigma_px))
          .exp();
  kernel = kernel / kernel.sum();
  const torch::Tensor flat = images.reshape({-1, 1, images.size(2), images.size(3)});
  const torch::Tensor padded = at::replication_pad2d(flat, {radius, radius, radius, radius});
  return at::conv2d(at::conv2d(padded, kernel.reshape({1, 1, 1, -1})),
                    kernel.reshape({1, 1, -1, 1}))
      .reshape(images.sizes());
}

enum class Model { kAdditive, kMultiplicative };

/// Pattern that frames have in common, under one model.
struct Common {
  torch::Tensor mean;   ///< [C,H,W]
  torch::Tensor parts;  ///< [N,C,H,W]: the mean's error is the mean of these
  /// [1,1,H,W] part of the frames whose detail has the sign of the mean.
  torch::Tensor on_one_side;
  double left = 0;   ///< mean absolute residual
  double light = 1;  ///< mean light that the pattern multiplies
};

/// Weighted mean of the frames' details, or their slope on the light. The weight of a pixel is the
/// inverse of the variance nearby in its frame: where the scene is plain, the pattern shows.
/// @param plain  [1,1,H,W] 1 where the pixel's neighbours may be compared with it
Common common_of(const torch::Tensor& frames, const torch::Tensor& plain, Model model) {
  throw_if_interrupted();
  const torch::Tensor low =
      blurred(frames * plain, kLowPass_px) / blurred(plain, kLowPass_px).clamp_min(1e-3);
  const torch::Tensor detail = frames - low;
  const torch::Tensor light =
      model == Model::kAdditive ? torch::ones_like(low) : low.clamp_min(1e-3);
  torch::Tensor residual = detail, weight, power;
  Common common;
  for (int round = 0; round < 3; ++round) {
    const torch::Tensor nearby = blurred(residual.square(), kNearby_px);
    const torch::Tensor variance = nearby + 0.25 * nearby.median() + 1e-7;
    const torch::Tensor far = residual.abs() / variance.sqrt();
    weight = variance.reciprocal() * (2 / far.clamp_min(2));
    power = (weight * light.square()).sum(0);
    common.mean = (weight * light * detail).sum(0) / power;
    residual = detail - common.mean * light;
  }
  common.parts = double(frames.size(0)) * weight * light * residual / power;
  const auto side = [](const torch::Tensor& details) {
    return at::avg_pool2d(details, {3, 3}, {1, 1}, {1, 1}).mean(1, true).sign();
  };
  common.on_one_side =
      side(detail).eq(side(common.mean.unsqueeze(0))).to(torch::kFloat32).mean(0, true);
  common.left = residual.abs().mean().item<double>();
  common.light = light.mean().item<double>();
  return common;
}

/// Smoothed over neighbouring frequencies.
torch::Tensor smoothed_power(const torch::Tensor& power) {
  constexpr int64_t kReach = 4;
  const int64_t down = power.size(0) > 2 * kReach ? kReach : 0;
  const int64_t right = power.size(1) > 2 * kReach ? kReach : 0;
  const torch::Tensor padded =
      at::pad(power.unsqueeze(0).unsqueeze(0), {right, right, down, down}, "circular");
  return at::avg_pool2d(padded, {2 * down + 1, 2 * right + 1}, {1, 1})[0][0];
}

/// |mean_k exp(−2πi f·p_k)|², [H,W]: how much of the scene's power the mean of the frames keeps.
torch::Tensor kept_of_scene(const Places& places, int64_t height, int64_t width) {
  const torch::Tensor fy = at::fft_fftfreq(height, 1.0, torch::kFloat64).unsqueeze(1);
  const torch::Tensor fx = at::fft_fftfreq(width, 1.0, torch::kFloat64).unsqueeze(0);
  torch::Tensor real = torch::zeros({height, width}, torch::kFloat64);
  torch::Tensor imaginary = torch::zeros_like(real);
  for (const auto& [x, y] : places) {
    const torch::Tensor phase = 2 * M_PI * (fx * x + fy * y);
    real += phase.cos(), imaginary += phase.sin();
  }
  const auto count = double(places.size());
  return ((real.square() + imaginary.square()) / (count * count)).to(torch::kFloat32);
}

torch::Tensor window_of(int64_t size) {
  if (size == 1) return torch::ones({1});
  const torch::Tensor hann = torch::hann_window(size);
  return hann / hann.square().mean().sqrt();
}

/// Power spectra of a pattern and of its error, [H,W], averaged over channels.
struct Spectra {
  torch::Tensor found, error;
  torch::Tensor scene;  ///< kept_of_scene()
};

Spectra spectra_of(const torch::Tensor& mean, const torch::Tensor& parts, const Places& places) {
  const int64_t height = mean.size(1), width = mean.size(2), count = parts.size(0);
  const torch::Tensor window = window_of(height).unsqueeze(1) * window_of(width).unsqueeze(0);
  const auto power = [&](const torch::Tensor& image) {
    return at::fft_fft2(image * window).abs().square().mean(0);
  };
  torch::Tensor single = torch::zeros({height, width});
  for (int64_t k = 0; k < count; ++k) single += power(parts[k]);
  single /= double(count);
  const torch::Tensor kept = kept_of_scene(places, height, width).clamp(1 / double(count), 0.999);
  // The residuals lack what the mean has taken from them.
  const torch::Tensor error = single * kept / (1 - kept);
  return {smoothed_power(power(mean)), smoothed_power(error), kept};
}

/// The part of a pattern that is clearly not the scene (Wiener filter).
torch::Tensor shrunk(const torch::Tensor& mean, const Spectra& spectra) {
  const torch::Tensor ratio = spectra.error / spectra.found.clamp_min(1e-20);
  const torch::Tensor clear = (ratio < 1 / kClearPower).logical_and(spectra.scene < kMostOfScene);
  const torch::Tensor gain = torch::where(clear, 1 - ratio, torch::zeros_like(ratio));
  return torch::real(at::fft_ifft2(at::fft_fft2(mean) * gain));
}

/// Root mean square distance of the places from their mean, px.
double spread_of(const Places& places) {
  double sx = 0, sy = 0, sum = 0;
  for (const auto& [x, y] : places) sx += x, sy += y, sum += x * x + y * y;
  const auto count = double(places.size());
  return std::sqrt(std::max(0.0, sum / count - (sx * sx + sy * sy) / (count * count)));
}

/// [1,1,H,W] bool: spots of dust. Few pixels of the frame make little power, so the Wiener filter
/// would take them for the scene.
torch::Tensor spots_in(const Common& common) {
  const torch::Tensor own = common.mean - common.mean.mean(1, true) - common.mean.mean(2, true);
  const torch::Tensor deep =
      at::avg_pool2d(own.mean(0, true).unsqueeze(0), {3, 3}, {1, 1}, {1, 1}).abs();
  const torch::Tensor busy =
      blurred(common.parts.square().mean(0).mean(0, true).unsqueeze(0), kNearby_px).sqrt();
  const torch::Tensor usual =
      1.4826 * deep.median() * (busy / busy.median().clamp_min(1e-12)).clamp_min(1);
  const torch::Tensor& share = common.on_one_side;
  const auto grown = [](const torch::Tensor& spots) {
    return at::max_pool2d(spots.to(torch::kFloat32), {3, 3}, {1, 1}, {1, 1}).gt(0);
  };
  const torch::Tensor edges = (deep > kEdgeOfSpot * usual).logical_and(share > kEdgeOnOneSide);
  torch::Tensor spots = (deep > kClearSpot * usual)
                            .logical_and(share > kOnOneSide)
                            .logical_and(deep > kLeastSpot / common.light);
  for (int k = 0; k < 4; ++k) spots = grown(spots).logical_and(edges);
  return grown(spots);  // the edge of a spot is soft
}

/// The pattern of one model on these frames, [C,H,W]; undefined where none is clear.
torch::Tensor pattern_of(const torch::Tensor& frames, Model model, const Places& places) {
  const int64_t height = frames.size(2), width = frames.size(3);
  torch::Tensor spots = torch::zeros({1, 1, height, width}, torch::kBool);
  Common common;
  for (int round = 0; round < 3; ++round) {
    common = common_of(frames, spots.logical_not().to(torch::kFloat32), model);
    if (round < 2) spots = spots.logical_or(spots_in(common));
  }
  const torch::Tensor in_spot = spots[0].to(torch::kFloat32);
  const torch::Tensor outside = common.mean * (1 - in_spot), parts = common.parts * (1 - in_spot);
  const torch::Tensor columns = outside.mean(1, true), rows = (outside - columns).mean(2, true);
  const torch::Tensor pixels = (outside - columns - rows) * (1 - in_spot);
  torch::Tensor pattern = common.mean * in_spot;
  const auto add = [&](const torch::Tensor& mean, const torch::Tensor& single) {
    const torch::Tensor kept = shrunk(mean, spectra_of(mean, single, places));
    if (kept.square().mean().sqrt().item<double>() * common.light < kLeastPattern) return;
    pattern = pattern + kept * (1 - in_spot);
  };
  add(columns, parts.mean(2, true));
  add(rows, parts.mean(3, true));
  add(pixels, parts);
  return pattern.abs().max().item<double>() > 0 ? pattern : torch::Tensor();
}

/// Takes a pattern out of frames and adds it to what was found before.
void take_out(const torch::Tensor& pattern, Model model, torch::Tensor& frames,
              SensorPattern& found) {
  torch::Tensor scale = torch::ones_like(pattern), offset = torch::zeros_like(pattern);
  const double deviation = pattern.square().mean().sqrt().item<double>();
  if (model == Model::kAdditive) {
    offset = -pattern, found.additive = deviation;
  } else {
    scale = (1 + pattern).clamp_min(0.1).reciprocal(), found.multiplicative = deviation;
  }
  frames = torch::where(frames < kSaturated, frames * scale + offset, frames);
  found.offset = found.is_found() ? found.offset * scale + offset : offset;
  found.scale = found.is_found() ? found.scale * scale : scale;
}

std::vector<torch::Tensor> spread(const std::vector<torch::Tensor>& frames) {
  const size_t fit = kMostValues / std::max<size_t>(size_t(frames.front().numel()), 1);
  const size_t most = std::min(frames.size(), std::clamp(fit, kFewestFrames, kMostFrames));
  std::vector<torch::Tensor> picked;
  for (size_t i = 0; i < most; ++i) picked.push_back(frames[i * frames.size() / most]);
  return picked;
}

/// Places of all frames: shifts are measured between frames that follow one another. Large frames
/// are looked at smaller.
Places places_of(const std::vector<torch::Tensor>& frames) {
  const int64_t height = frames.front().size(1), width = frames.front().size(2);
  const int64_t factor = std::max<int64_t>(1, width / 320);
  if (factor == 1) return frame_places(frames);
  std::vector<torch::Tensor> small;
  for (const torch::Tensor& frame : frames) {
    small.push_back(at::adaptive_avg_pool2d(frame, {height / factor, width / factor}));
  }
  Places places = frame_places(small);
  for (auto& [x, y] : places) x *= double(factor), y *= double(factor);
  return places;
}

double percent(double part) { return std::round(1000 * part) / 10; }

}  // namespace

SensorPattern find_sensor_pattern(const std::vector<torch::Tensor>& all) {
  SensorPattern found;
  found.said = "none found";
  if (all.size() < kFewestFrames) return found;
  const std::vector<torch::Tensor> some = spread(all);
  // The colour filter of a raw mosaic is fixed to the sensor, too.
  if (2 * std::count_if(some.begin(), some.end(), is_mosaic) >= int64_t(some.size())) return found;
  const Places every = places_of(all);
  Places places;
  for (size_t i = 0; i < some.size(); ++i) places.push_back(every[i * all.size() / some.size()]);
  if (spread_of(places) < kLowPass_px) return found;
  const bool gray = std::all_of(some.begin(), some.end(), imaging::is_gray);
  torch::Tensor frames = torch::stack(some);
  if (gray) frames = frames.slice(1, 0, 1);
  const torch::Tensor plain = torch::ones({1, 1, frames.size(2), frames.size(3)});
  const bool additive = common_of(frames, plain, Model::kAdditive).left <=
                        common_of(frames, plain, Model::kMultiplicative).left;
  const Model first = additive ? Model::kAdditive : Model::kMultiplicative;
  const Model second = additive ? Model::kMultiplicative : Model::kAdditive;
  for (const Model model : {first, second}) {
    const torch::Tensor pattern = pattern_of(frames, model, places);
    if (pattern.defined()) take_out(pattern, model, frames, found);
  }
  if (!found.is_found()) return found;
  const int64_t height = frames.size(2), width = frames.size(3);
  found.scale = found.scale.expand({3, height, width}).contiguous();
  found.offset = found.offset.expand({3, height, width}).contiguous();
  found.said = "";
  if (found.additive > 0)
    found.said += concat("offsets of ", percent(found.additive), " % of white");
  if (found.multiplicative > 0) {
    found.said +=
        concat(found.said.empty() ? "" : " and ", "gains of ", percent(found.multiplicative), " %");
  }
  found.said += " fixed to the sensor, removed";
  return found;
}

void remove_sensor_pattern(const SensorPattern& pattern, Capture& capture) {
  if (!pattern.is_found()) return;
  for (Shot& shot : capture.shots) {
    shot.image =
        torch::where(shot.image < kSaturated,
                     (shot.image * pattern.scale + pattern.offset).clamp(0, 1), shot.image);
  }
}

void keep_sensor_pattern(const fs::path& folder, const SensorPattern& pattern) {
  const Json all{{"additive", pattern.additive},
                 {"multiplicative", pattern.multiplicative},
                 {"said", pattern.said}};
  write_file(folder / kFile, all.dump(1) + "\n");
  if (!pattern.is_found()) return;
  io::write_npz(folder / kArrays, {{"scale", pattern.scale}, {"offset", pattern.offset}});
}

SensorPattern load_sensor_pattern(const fs::path& folder) {
  SensorPattern pattern;
  try {
    const Json all = Json::parse(read_file(folder / kFile));
    pattern.additive = all.at("additive"), pattern.multiplicative = all.at("multiplicative");
    pattern.said = all.at("said");
  } catch (const Json::exception& error) {
    throw DataError(concat((folder / kFile).string(), ": expected what this program wrote, found ",
                           error.what(), "; import again with --from pattern"));
  }
  if (!fs::exists(folder / kArrays)) return pattern;
  const io::Npz arrays(folder / kArrays);
  pattern.scale = arrays.read("scale"), pattern.offset = arrays.read("offset");
  return pattern;
}

}  // namespace jade::import
