// SPDX-License-Identifier: Apache-2.0
#include "jade/run/metrics_log.h"

#include <cmath>
#include <fstream>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/eval/metrics.h"
#include "jade/losses/poses.h"
#include "jade/train/routing_step.h"

namespace jade::run {

MetricsLog::MetricsLog(std::filesystem::path path, int64_t step) : path_(std::move(path)) {
  std::string kept;
  std::ifstream old(path_);
  for (std::string line; std::getline(old, line);) {
    const auto object = nlohmann::json::parse(line, nullptr, /*allow_exceptions=*/false);
    // A killed run may leave an incomplete line, which is not valid JSON.
    if (!object.is_object() || object.value("step", int64_t{0}) > step) continue;
    kept += line + "\n";
    seconds_before_ = object.value("seconds", seconds_before_);
  }
  write_file(path_, kept);
}

void MetricsLog::append(const nlohmann::ordered_json& line) {
  const std::string text = line.dump();
  std::ofstream out(path_, std::ios::app);
  out << text << '\n';
  out.close();
  if (!out) throw DataError(concat(path_.string(), ": cannot be written; is the disk full?"));
  if (listener_) listener_(text);
}

nlohmann::ordered_json step_line(const train::StepInputs& inputs, const train::StepOutputs& out,
                                 train::TrainState& state, const train::RunOptions& options) {
  const torch::NoGradGuard no_grad;
  const train::View& view = inputs.view;
  const int64_t index = inputs.view_index;
  nlohmann::ordered_json line{{"step", state.step}};
  double total = 0;
  for (const losses::NamedTerm& term : out.terms) {
    const double value = term.value.item<double>();
    line[term.name] = value;
    if (term.in_total) total += value;
  }
  line["loss"] = total;
  // How well the simulated blur explains the frame: the only PSNR that needs no true sharp image.
  const torch::Tensor all =
      out.renders.all_poses
          ? out.renders.color.detach()
          : train::as_in_frame(
                state, inputs,
                splat::render(state.gaussians.detached(), train::exposure_cameras(state, inputs),
                              train::render_options(options))
                    .color);
  double psnr = eval::psnr(losses::weighted_mean(all, view.weights), view.blurry());
  // Masked pixels are black in both and do not count.
  if (view.mask.defined()) psnr += 10 * std::log10(view.mask.mean().item<double>());
  line["psnr_train"] = psnr;
  if (state.allocation) {
    const auto alpha = train::allocation_map(state, view, index);
    line["alpha_mean"] = alpha.mean().item<double>();
    line["alpha_std"] = alpha.numel() > 1 ? alpha.std().item<double>() : 0.0;
  }
  if (state.gains) {
    const auto [least, most] = state.gains->range();
    line["gain_min"] = least;
    line["gain_max"] = most;
  }
  line["gaussians"] = state.gaussians.size();
  return line;
}

nlohmann::ordered_json evaluation_line(int64_t step, double seconds,
                                       const eval::Evaluation& evaluation) {
  const eval::Scores& mean = evaluation.mean;
  nlohmann::ordered_json line{{"step", step}, {"seconds", seconds}};
  if (!evaluation.views.empty()) {
    log_info(concat("step ", step, ": test PSNR ", mean.psnr, " dB, SSIM ", mean.ssim));
    line["test_psnr"] = mean.psnr;
    line["test_psnr_channel_mean"] = mean.psnr_channel_mean;
    line["test_ssim"] = mean.ssim;
  }
  if (mean.psnr_reblur) {
    log_info(concat("step ", step, ": held-out PSNR after reblur ", *mean.psnr_reblur));
    line["test_psnr_reblur"] = *mean.psnr_reblur;
  }
  if (mean.lpips_alex01) line["test_lpips_alex01"] = *mean.lpips_alex01;
  if (mean.lpips_vgg) line["test_lpips_vgg"] = *mean.lpips_vgg;
  const auto split = [&](const std::optional<eval::Scores>& part, const std::string& ending) {
    if (!part) return;
    line["test_psnr_" + ending] = part->psnr;
    line["test_psnr_channel_mean_" + ending] = part->psnr_channel_mean;
  };
  split(evaluation.mean_seen, "seen");
  split(evaluation.mean_unseen, "unseen");
  return line;
}

}  // namespace jade::run
