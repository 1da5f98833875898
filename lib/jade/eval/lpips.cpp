// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/lpips.h"

#include <algorithm>
#include <torch/script.h>

#include "jade/core/cache_folder.h"
#include "jade/core/error.h"
#include "jade/core/log.h"

namespace jade::eval {
namespace {

namespace fs = std::filesystem;

/// AlexNet's first layers reduce smaller images to nothing.
constexpr int64_t kSmallest = 32;

std::unique_ptr<torch::jit::Module> load(const fs::path& path, torch::Device device) {
  if (!fs::exists(path)) return nullptr;
  try {
    auto module = std::make_unique<torch::jit::Module>(torch::jit::load(path.string(), device));
    module->eval();
    return module;
  } catch (const c10::Error&) {
    log_warn(path.string() + ": not a TorchScript module; run scripts/setup.sh --metrics");
    return nullptr;
  }
}

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

}  // namespace

std::string lpips_absent() {
  return concat("LPIPS (-) needs images of at least ", kSmallest,
                " px, and lpips_alex01.pt and lpips_vgg.pt in ", cache_folder().string(),
                " ($JADE_CACHE if set); scripts/setup.sh --metrics installs them, with the wheel "
                "jade_metrics\n");
}

Lpips::Lpips(torch::Device device, fs::path cache) : device_(device) {
  if (cache.empty()) cache = cache_folder();
  alex01_ = load(cache / "lpips_alex01.pt", device_);
  vgg_ = load(cache / "lpips_vgg.pt", device_);
}

Lpips::~Lpips() = default;

std::optional<double> Lpips::distance(const std::unique_ptr<torch::jit::Module>& module,
                                      const torch::Tensor& image,
                                      const torch::Tensor& truth) const {
  if (!module || std::min(image.size(1), image.size(2)) < kSmallest) return std::nullopt;
  const torch::NoGradGuard no_grad;
  const auto input = [&](const torch::Tensor& x) {
    return x.clamp(0, 1).to(device_, torch::kFloat32).unsqueeze(0);
  };
  try {
    return module->forward({input(image), input(truth)}).toTensor().item<double>();
  } catch (const std::exception& problem) {
    // Missing one metric is better than losing the other results of a trained run.
    log_warn(concat("LPIPS is left out: ", first_line(problem.what()),
                    "; run scripts/setup.sh --metrics"));
    return std::nullopt;
  }
}

std::optional<double> Lpips::alex01(const torch::Tensor& image, const torch::Tensor& truth) const {
  return distance(alex01_, image, truth);
}

std::optional<double> Lpips::vgg(const torch::Tensor& image, const torch::Tensor& truth) const {
  return distance(vgg_, image, truth);
}

}  // namespace jade::eval
