// SPDX-License-Identifier: Apache-2.0
#include "jade/import/vignetting.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/median.h"
#include "jade/data/masks.h"
#include "jade/imaging/color.h"
#include "jade/imaging/image_io.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr char kFile[] = "vignetting.json";
constexpr size_t kFewestSamples = 300;
/// Number of samples beyond the reach, so that single outliers do not determine it.
constexpr size_t kBeyondReach = 10;
constexpr double kLeastLoss = 0.03;  // least loss at the corners
constexpr double kClearErrors = 6;
constexpr int kRounds = 12;
constexpr double kHuber = 1.345;  // standard deviations beyond which the loss is linear
/// Values outside are noise or saturated.
constexpr double kDarkest = 0.02, kBrightest = 0.98;

double log_part(const std::array<double, 3>& terms, double r) {
  const double q = r * r;
  return q * (terms[0] + q * (terms[1] + q * terms[2]));
}

/// Weighted least squares over samples grouped by point, whose brightness is eliminated.
class Fit {
 public:
  /// @param samples  sorted by point
  Fit(const std::vector<BrightnessSample>& samples, size_t terms)
      : samples_(samples), terms_(terms), weights_(samples.size(), 1.0), residuals_(weights_) {
    std::map<int64_t, size_t> shots;
    for (const BrightnessSample& s : samples) {
      shot_.push_back(shots.emplace(s.shot, shots.size()).first->second);
    }
    unknowns_ = terms_ + shots.size();
    for (size_t i = 0; i < samples.size(); ++i) {
      if (i == 0 || samples[i].point != samples[i - 1].point) starts_.push_back(i);
    }
    starts_.push_back(samples.size());
  }

  /// Alternates solving and weighting. @return false if the samples do not determine the terms
  bool run() {
    for (int round = 0; round < kRounds; ++round) {
      throw_if_interrupted();
      if (!solve()) return false;
      weigh();
    }
    return true;
  }

  std::array<double, 3> terms() const {
    std::array<double, 3> terms{};
    for (size_t k = 0; k < terms_; ++k) terms[k] = solution_[k];
    return terms;
  }

  /// Standard error of log v(r), from the sums of the points' errors (sandwich estimator).
  double error_at(double r) const {
    torch::Tensor direction = torch::zeros({int64_t(unknowns_)}, torch::kFloat64);
    for (size_t k = 0; k < terms_; ++k) direction[int64_t(k)] = std::pow(r * r, double(k + 1));
    const torch::Tensor solved = at::linalg_solve(matrix_, direction);
    const double* z = solved.const_data_ptr<double>();
    double sum = 0;
    for_points([&](size_t begin, size_t end) {
      double total = 0, mean = 0, score = 0;
      for (size_t i = begin; i < end; ++i) total += weights_[i], mean += weights_[i] * along(z, i);
      mean /= total;
      for (size_t i = begin; i < end; ++i) {
        score += weights_[i] * residuals_[i] * (along(z, i) - mean);
      }
      sum += score * score;
    });
    return std::sqrt(sum);
  }

 private:
  template <class Visit>
  void for_points(const Visit& visit) const {
    for (size_t k = 0; k + 1 < starts_.size(); ++k) visit(starts_[k], starts_[k + 1]);
  }

  /// Dot product of a vector of unknowns with the row of a sample.
  double along(const double* unknowns, size_t i) const {
    double value = unknowns[terms_ + shot_[i]], power = 1;
    const double q = samples_[i].radius * samples_[i].radius;
    for (size_t k = 0; k < terms_; ++k) value += (power *= q) * unknowns[k];
    return value;
  }

  bool solve() {
    std::vector<double> matrix(unknowns_ * unknowns_), right(unknowns_);
    std::map<size_t, double> row;  // column → Σ w x of a point
    for_points([&](size_t begin, size_t end) {
      row.clear();
      double total = 0, weighted_y = 0;
      for (size_t i = begin; i < end; ++i) {
        const double w = weights_[i], y = samples_[i].log_brightness;
        const double q = samples_[i].radius * samples_[i].radius;
        std::array<std::pair<size_t, double>, 4> entries;
        double power = 1;
        for (size_t k = 0; k < terms_; ++k) entries[k] = {k, power *= q};
        entries[terms_] = {terms_ + shot_[i], 1};
        for (size_t a = 0; a <= terms_; ++a) {
          row[entries[a].first] += w * entries[a].second;
          right[entries[a].first] += w * entries[a].second * y;
          for (size_t b = 0; b <= terms_; ++b) {
            matrix[entries[a].first * unknowns_ + entries[b].first] +=
                w * entries[a].second * entries[b].second;
          }
        }
        total += w, weighted_y += w * y;
      }
      for (const auto& [a, x] : row) {
        right[a] -= x * weighted_y / total;
        for (const auto& [b, z] : row) matrix[a * unknowns_ + b] -= x * z / total;
      }
    });
    const auto n = int64_t(unknowns_);
    matrix_ = torch::tensor(matrix, torch::kFloat64).reshape({n, n});
    // Making all shots brighter and all points darker changes nothing: keep the shots near 0.
    matrix_.diagonal().add_(1e-9 * double(samples_.size()));
    const torch::Tensor solution = at::linalg_solve(matrix_, torch::tensor(right, torch::kFloat64));
    if (!solution.isfinite().all().item<bool>()) return false;
    const double* values = solution.const_data_ptr<double>();
    solution_.assign(values, values + n);
    return true;
  }

  void weigh() {
    std::vector<double> sizes;
    for_points([&](size_t begin, size_t end) {
      double total = 0, mean = 0;
      for (size_t i = begin; i < end; ++i) {
        residuals_[i] = samples_[i].log_brightness - along(solution_.data(), i);
        total += weights_[i], mean += weights_[i] * residuals_[i];
      }
      for (size_t i = begin; i < end; ++i) {
        residuals_[i] -= mean / total;
        sizes.push_back(std::abs(residuals_[i]));
      }
    });
    const double bound = kHuber * std::max(1.4826 * median_of(std::move(sizes)), 1e-6);
    for (size_t i = 0; i < weights_.size(); ++i) {
      weights_[i] = std::min(1.0, bound / std::max(std::abs(residuals_[i]), 1e-12));
    }
  }

  const std::vector<BrightnessSample>& samples_;
  size_t terms_, unknowns_ = 0;
  std::vector<double> weights_, residuals_, solution_;
  std::vector<size_t> shot_, starts_;
  torch::Tensor matrix_;
};

bool falls(const std::array<double, 3>& terms, double reach) {
  constexpr int kSteps = 100;
  for (int i = 0; i < kSteps; ++i) {
    if (log_part(terms, reach * (i + 1) / kSteps) > log_part(terms, reach * i / kSteps)) {
      return false;
    }
  }
  return true;
}

double reach_of(const std::vector<BrightnessSample>& samples) {
  std::vector<double> radii;
  for (const BrightnessSample& s : samples) radii.push_back(s.radius);
  const auto at = radii.end() - std::ptrdiff_t(kBeyondReach);
  std::nth_element(radii.begin(), at, radii.end());
  return *at;
}

/// Distances of pixels from the image centre, [H,W] float64; 1 at the corners of the image.
torch::Tensor radii(int64_t height, int64_t width) {
  const auto from_middle = [](int64_t size) {
    return torch::arange(size, torch::kFloat64) + 0.5 - 0.5 * double(size);
  };
  return (from_middle(height).square().unsqueeze(1) + from_middle(width).square().unsqueeze(0))
             .sqrt() /
         (0.5 * std::hypot(double(height), double(width)));
}

/// 3x3 means of a latent image at the size of the shots, [H,W] float32.
torch::Tensor smoothed(const torch::Tensor& latent, const Capture& capture) {
  const torch::Tensor gray = at::adaptive_avg_pool2d(imaging::gray(latent).slice(0, 0, 1),
                                                     {capture.height(), capture.width()});
  return at::avg_pool2d(gray.unsqueeze(0), {3, 3}, {1, 1}, {1, 1}, /*ceil_mode=*/false,
                        /*count_include_pad=*/false)[0][0]
      .contiguous();
}

/// Bilinear sample of [H,W] at projection coordinates; none outside.
std::optional<double> sampled(const torch::Tensor& image, double u, double v) {
  const int64_t height = image.size(0), width = image.size(1);
  const double x = u - 0.5, y = v - 0.5;
  if (!(x >= 0 && y >= 0 && x < double(width - 1) && y < double(height - 1))) return std::nullopt;
  const auto column = int64_t(x), row = int64_t(y);
  const float* p = image.const_data_ptr<float>() + row * width + column;
  const double right = x - double(column), down = y - double(row);
  return (1 - down) * ((1 - right) * p[0] + right * p[1]) +
         down * ((1 - right) * p[width] + right * p[width + 1]);
}

}  // namespace

double Vignetting::at(double radius) const {
  return std::exp(log_part(terms, std::min(radius, reach)));
}

Vignetting fit_vignetting(const std::vector<BrightnessSample>& given) {
  Vignetting none;
  none.samples = int64_t(given.size());
  none.said = "none found";
  if (given.size() < kFewestSamples) return none;
  std::vector<BrightnessSample> samples = given;
  std::stable_sort(
      samples.begin(), samples.end(),
      [](const BrightnessSample& a, const BrightnessSample& b) { return a.point < b.point; });
  const double reach = reach_of(samples);
  for (const size_t terms : {size_t{3}, size_t{2}, size_t{1}}) {
    Fit fit(samples, terms);
    if (!fit.run() || !falls(fit.terms(), reach)) continue;
    Vignetting found = none;
    found.terms = fit.terms();
    found.error = fit.error_at(reach);
    const double loss = -log_part(found.terms, reach);
    if (!(loss > std::max(-std::log1p(-kLeastLoss), kClearErrors * found.error))) continue;
    found.reach = reach;
    found.said =
        concat("corners have ", std::lround(100 * found.at(1)), " % of the light, corrected");
    return found;
  }
  return none;
}

std::vector<BrightnessSample> sample_brightness(const Capture& capture, const Reconstruction& found,
                                                const std::vector<LatentImage>& images,
                                                const fs::path& latents) {
  std::map<std::pair<int64_t, int64_t>, std::string> files;
  for (const LatentImage& image : images) files[{image.shot, image.t_us}] = image.file;
  std::vector<std::vector<int64_t>> points(found.poses.size());
  for (size_t k = 0; k < found.seen_by.size(); ++k) {
    for (const int64_t pose : found.seen_by[k]) points[size_t(pose)].push_back(int64_t(k));
  }
  const torch::Tensor places = found.points.contiguous();
  const double* place = places.const_data_ptr<double>();
  const auto width = double(capture.width()), height = double(capture.height());
  std::vector<BrightnessSample> samples;
  for (size_t j = 0; j < found.poses.size(); ++j) {
    throw_if_interrupted();
    const TimedPose& timed = found.poses[j];
    const auto file = files.find({timed.shot, timed.t_us});
    if (file == files.end() || points[j].empty()) continue;
    const torch::Tensor image =
        smoothed(imaging::read_image(latents / "images" / file->second), capture);
    const torch::Tensor mask =
        data::both_masks(capture.mask, capture.shots[size_t(timed.shot)].mask);
    for (const int64_t k : points[j]) {
      const auto at =
          geometry::transform(timed.pose, {place[3 * k], place[3 * k + 1], place[3 * k + 2]});
      if (!(at[2] > 0)) continue;
      const auto [u, v] = geometry::project(found.camera, at);
      const std::optional<double> value = sampled(image, u, v);
      if (!value || *value < kDarkest || *value > kBrightest) continue;
      if (mask.defined() && !mask[0][int64_t(v)][int64_t(u)].item<bool>()) continue;
      const double radius =
          std::hypot(u - 0.5 * width, v - 0.5 * height) / (0.5 * std::hypot(width, height));
      samples.push_back({k, timed.shot, radius, std::log(*value)});
    }
  }
  return samples;
}

torch::Tensor vignetting_map(const Vignetting& vignetting, int64_t height, int64_t width) {
  const torch::Tensor q = radii(height, width).clamp_max(vignetting.reach).square();
  const auto& a = vignetting.terms;
  return (q * (a[0] + q * (a[1] + q * a[2]))).exp();
}

void remove_vignetting(const Vignetting& vignetting, Capture& capture) {
  if (!vignetting.is_found()) return;
  const torch::Tensor passed =
      vignetting_map(vignetting, capture.height(), capture.width()).to(torch::kFloat32);
  for (Shot& shot : capture.shots) shot.image = (shot.image / passed).clamp_max(1);
}

void keep_vignetting(const fs::path& folder, const Vignetting& vignetting) {
  const Json all{{"terms", vignetting.terms},
                 {"reach", vignetting.reach},
                 {"corner", vignetting.is_found() ? vignetting.at(1) : 1.0},
                 {"standard_error_log", vignetting.error},
                 {"samples", vignetting.samples},
                 {"said", vignetting.said}};
  write_file(folder / kFile, all.dump(1) + "\n");
}

Vignetting load_vignetting(const fs::path& folder) {
  try {
    const Json all = Json::parse(read_file(folder / kFile));
    return {all.at("terms"), all.at("reach"), all.at("standard_error_log"), all.at("samples"),
            all.at("said")};
  } catch (const Json::exception& error) {
    throw DataError(concat((folder / kFile).string(), ": expected what this program wrote, found ",
                           error.what(), "; import again with --from vignetting"));
  }
}

}  // namespace jade::import
