// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>

#include "jade/config/config.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/sweep/spec.h"

namespace jade::sweep {
namespace {

constexpr double kNoiseDb = 0.3;

const std::vector<Column>& known_columns() {
  static const std::vector<Column> list = {
      {"psnr", "PSNR (global)", "of the mean squared error over all pixels and channels, dB", 2, 1,
       kNoiseDb},
      {"psnr_channel_mean", "PSNR",
       "mean of the PSNRs of the three channels, dB (the published tables' definition)", 2, 1,
       kNoiseDb},
      {"psnr_seen", "PSNR (global), seen", "over the test views taken within a training exposure",
       2, 1, kNoiseDb},
      {"psnr_unseen", "PSNR (global), unseen", "over the test views taken outside all of them", 2,
       1, kNoiseDb},
      {"psnr_channel_mean_seen", "PSNR, seen",
       "over the test views taken within a training exposure", 2, 1, kNoiseDb},
      {"psnr_channel_mean_unseen", "PSNR, unseen", "over the test views taken outside all of them",
       2, 1, kNoiseDb},
      {"ssim", "SSIM", "11x11 Gaussian window, sigma 1.5, zero padding", 4, 1, 0.003},
      {"lpips_alex01", "LPIPS", "v0.1, AlexNet, inputs in [0,1] (the published definition)", 4, -1,
       0.004},
      {"lpips_vgg", "LPIPS (VGG)", "v0.1, VGG16, inputs in [-1,1]", 4, -1, 0.004},
      {"psnr_reblur", "PSNR, reblurred",
       "of held-out blurry frames against the mean of renders along their exposure, dB", 2, 1,
       kNoiseDb},
      {"musiq", "MUSIQ", "scripts/evaluate_perceptual.py", 2, 1},
      {"clipiqa", "CLIP-IQA", "scripts/evaluate_perceptual.py", 4, 1},
      {"alpha_mean", "mean α", "over all pixels and training views, at the end", 4, 0},
      {"alpha_std", "std α", "over all pixels and training views, at the end", 4, 0},
      {"alpha_min", "least α", "over all pixels and training views, at the end", 3, 0},
      {"alpha_max", "largest α", "over all pixels and training views, at the end", 3, 0},
      {"alpha_correlation", "corr(α, events)",
       "Pearson's r of α and event density in a view, mean over the views", 4, 0},
      {"alpha_correlation_std", "its std", "sample deviation of that r over the views", 4, 0},
      {"choice_right", "right choice",
       "share of pixels where α prefers the restoration nearer to the sharp test view at "
       "mid-exposure, mean over the views that have one",
       4, 1},
      {"choice_gain_db", "gain of the mix",
       "PSNR of the mix less that of the better restoration, mean over the same views, dB", 2, 1},
      {"gaussians", "Gaussians", "at the end", 0, 0},
      {"minutes", "min", "wall clock of the whole run, data and evaluation included", 2, -1},
      {"hours", "h", "the same in hours", 3, -1},
      {"iterations_per_second", "it/s", "median over the run's log lines", 1, 1},
      {"memory_gib", "GiB", "peak of the device: tensors on a GPU, resident size on the CPU", 2,
       -1}};
  return list;
}

/// Whether evaluations on the way measure it; the rest is known only at the end.
bool is_evaluated(const std::string& key) {
  for (const char* start : {"psnr", "ssim", "lpips"}) {
    if (key.rfind(start, 0) == 0) return true;
  }
  return false;
}

}  // namespace

std::string empty_column(const Column& column, const std::set<Schedule>& schedules) {
  const size_t at = column.key.find('@');
  if (at == std::string::npos) return "";
  const std::string base = column.key.substr(0, at), step_text = column.key.substr(at + 1);
  const int64_t step = std::atoll(step_text.c_str());
  const bool is_plain = step_text == std::to_string(step);  // 003 names no step
  std::vector<std::string> found;
  for (const auto& [iterations, every] : schedules) {
    const bool on_the_way = every > 0 && step > 0 && step < iterations && step % every == 0;
    const bool has_value = step == iterations || (is_evaluated(base) && on_the_way);
    if (is_plain && has_value) return "";
    found.push_back(concat(iterations, " steps with train.evaluate_every ", every));
  }
  const std::string runs = listing(found, 3);
  if (!is_evaluated(base)) {
    return concat(column.key, ": expected the last step, found runs of ", runs, "; write ", base);
  }
  return concat(column.key, ": no evaluation at step ", step_text, ", found runs of ", runs,
                "; set train.evaluate_every, or remove the column");
}

Column column_of(const std::string& key) {
  const size_t at = key.find('@');
  const std::string base = key.substr(0, at);
  std::vector<std::string> names;
  for (const Column& column : known_columns()) {
    names.push_back(column.key);
    if (column.key != base) continue;
    if (at == std::string::npos) return column;
    const std::string step = key.substr(at + 1);
    if (step.empty() || step.find_first_not_of("0123456789") != std::string::npos) break;
    Column timed = column;
    timed.key = key;
    timed.heading += " @" + step;
    timed.meaning += ", at step " + step + " of the run (train.evaluate_every)";
    return timed;
  }
  const std::string close = config::nearest(base, names);
  throw ConfigError(concat("expected a column, such as ssim or ssim@20000, found '", key, "'",
                           close.empty() || close == base ? "" : "; did you mean " + close + "?"));
}

}  // namespace jade::sweep
