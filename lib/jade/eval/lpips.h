// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <torch/types.h>

namespace torch::jit {
struct Module;
}

namespace jade::eval {

/// Note below a table that has "-" for LPIPS; names the folder that has been searched.
std::string lpips_absent();

/// LPIPS v0.1 through the TorchScript modules of scripts/export_lpips.py, which take two RGB images
/// in [0,1]: lpips_alex01.pt (AlexNet on [0,1], as in published tables) and lpips_vgg.pt (VGG16,
/// which rescales to [-1,1]).
class Lpips {
 public:
  /// Loads the modules in `cache`; if one is missing or unreadable, its metric has no value.
  /// @param cache  empty: core/cache_folder.h.
  explicit Lpips(torch::Device device, std::filesystem::path cache = {});
  ~Lpips();

  /// Distance of two [3,H,W] images, 0 for equal ones; no value without its module.
  std::optional<double> alex01(const torch::Tensor& image, const torch::Tensor& truth) const;
  std::optional<double> vgg(const torch::Tensor& image, const torch::Tensor& truth) const;

 private:
  std::optional<double> distance(const std::unique_ptr<torch::jit::Module>& module,
                                 const torch::Tensor& image, const torch::Tensor& truth) const;

  torch::Device device_;
  std::unique_ptr<torch::jit::Module> alex01_, vgg_;
};

}  // namespace jade::eval
