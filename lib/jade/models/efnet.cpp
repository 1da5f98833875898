// SPDX-License-Identifier: Apache-2.0
#include "jade/models/efnet.h"

#include <algorithm>
#include <c10/core/Allocator.h>
#include <nlohmann/json.hpp>
#include <torch/nn/functional/padding.h>
#include <torch/script.h>

#include "jade/core/check.h"
#include "jade/core/digest.h"

namespace jade::models {
namespace {

namespace F = torch::nn::functional;

constexpr const char* kMetadataFile = "jade_efnet.json";
constexpr int64_t kFormatVersion = 1;
constexpr int64_t kBins = 6;

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& what) {
  throw DataError(concat(path.string(), ": ", what));
}

/// The first line of a torch message, without its C++ trace.
std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

void check_values(const std::filesystem::path& path, const RestorerMetadata& m,
                  const std::string& normalization) {
  if (m.kind != "efnet" && m.kind != "image") {
    fail(path, concat("expected kind efnet or image, found '", m.kind, "'"));
  }
  const bool events = m.kind == "efnet";
  if (events ? m.input != "scer" && m.input != "bins" : m.input != "none") {
    fail(path, concat("input '", m.input, "' does not fit kind ", m.kind));
  }
  if (events && normalization != "max_abs") {
    fail(path, concat("unknown normalization '", normalization, "'; expected max_abs"));
  }
  if (m.padding_multiple < 1 || m.padding_multiple > 1024 || m.minimum_size < 1 ||
      m.minimum_size > 65536) {
    fail(path, concat("padding_multiple ", m.padding_multiple, " or minimum_size ", m.minimum_size,
                      " makes no sense"));
  }
}

RestorerMetadata parse_metadata(const std::filesystem::path& path, const std::string& text) {
  if (text.empty()) {
    fail(path, concat("has no ", kMetadataFile, ": export the restorer with scripts/efnet/",
                      "export_efnet.py --help"));
  }
  RestorerMetadata m;
  std::string normalization;
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    if (json.at("format").get<std::string>() != "jade-restorer") {
      fail(path, concat(kMetadataFile, " is not of format jade-restorer"));
    }
    const auto version = json.at("format_version").get<int64_t>();
    if (version > kFormatVersion) {
      fail(path, concat("has format version ", version, ", this program reads up to ",
                        kFormatVersion, ": update it, or export the restorer anew"));
    }
    const std::string dtype = json.at("dtype").get<std::string>();
    if (dtype != "float32") fail(path, concat("expected dtype float32, found ", dtype));
    m.kind = json.at("kind").get<std::string>();
    m.name = json.at("name").get<std::string>();
    m.width = json.at("width").get<int64_t>();
    m.parameters = json.at("parameters").get<int64_t>();
    m.input = json.at("input").get<std::string>();
    m.channel_order = json.at("channel_order").get<std::string>();
    m.padding_multiple = json.at("padding_multiple").get<int64_t>();
    m.minimum_size = json.at("minimum_size").get<int64_t>();
    m.uses_mask = json.at("uses_mask").get<bool>();
    m.weights_sha256 = json.at("weights_sha256").get<std::string>();
    m.source = json.at("source").get<std::string>();
    normalization = json.at("normalization").get<std::string>();
  } catch (const nlohmann::json::exception& problem) {
    fail(path, concat("bad ", kMetadataFile, ": ", problem.what()));
  }
  check_values(path, m, normalization);
  return m;
}

/// How much to add to `size` so that the network can take it.
int64_t padding(int64_t size, const RestorerMetadata& m) {
  const int64_t multiple = m.padding_multiple;
  const int64_t wanted = std::max(size, m.minimum_size);
  return (wanted + multiple - 1) / multiple * multiple - size;
}

torch::Tensor pad_replicate(const torch::Tensor& image, int64_t right, int64_t bottom) {
  return F::pad(image, F::PadFuncOptions({0, right, 0, bottom}).mode(torch::kReplicate));
}

torch::Tensor pad_zero(const torch::Tensor& image, int64_t right, int64_t bottom) {
  return torch::constant_pad_nd(image, {0, right, 0, bottom}, 0);
}

/// 3×3 maximum; outside the image counts as the smallest value.
torch::Tensor dilate(const torch::Tensor& image) {
  return torch::max_pool2d(image, {3, 3}, {1, 1}, {1, 1});
}

}  // namespace

torch::Tensor scer_from_bins(const torch::Tensor& voxel) {
  check_shape(voxel, "voxel", {-1, kBins, -1, -1});
  const auto bin = [&](int64_t i) { return voxel.narrow(1, i, 1); };
  const torch::Tensor before2 = bin(1) + bin(2), after2 = bin(3) + bin(4);
  return torch::cat({-(bin(0) + before2), -before2, -bin(2), bin(3), after2, after2 + bin(5)}, 1);
}

torch::Tensor normalize_views(const torch::Tensor& events) {
  const torch::Tensor largest = events.abs().amax({1, 2, 3}, true);
  return events / torch::where(largest > 0, largest, torch::ones_like(largest));
}

torch::Tensor event_mask(const torch::Tensor& events) {
  const torch::Tensor any = (events != 0).any(1, true).to(events.scalar_type());
  return 1 - dilate(1 - dilate(any));
}

Restorer::Restorer(const EfnetOptions& options, torch::Device device)
    : path_(options.path), device_(device) {
  file_sha256_ = jade::file_sha256(path_);
  if (!options.sha256.empty() && options.sha256 != file_sha256_) {
    fail(path_, concat("expected SHA-256 ", options.sha256, ", found ", file_sha256_,
                       ": another file than the configuration means"));
  }
  torch::jit::ExtraFilesMap extra{{kMetadataFile, ""}};
  try {
    module_ =
        std::make_unique<torch::jit::Module>(torch::jit::load(path_.string(), torch::kCPU, extra));
  } catch (const c10::Error& problem) {
    fail(path_, concat("no TorchScript file: ", first_line(problem.what_without_backtrace())));
  }
  metadata_ = parse_metadata(path_, extra[kMetadataFile]);
  module_->eval();
  for (const torch::Tensor& parameter : module_->parameters()) parameter.set_requires_grad(false);
  to(device);
}

Restorer::~Restorer() = default;
Restorer::Restorer(Restorer&&) noexcept = default;
Restorer& Restorer::operator=(Restorer&&) noexcept = default;

void Restorer::to(torch::Device device) {
  try {
    module_->to(device);
  } catch (const c10::OutOfMemoryError&) {
    throw DeviceError(concat(path_.string(), ": does not fit the memory of ", device.str()));
  }
  device_ = device;
}

torch::Tensor Restorer::call(const torch::Tensor& image, const torch::Tensor& voxel) const {
  const int64_t height = image.size(2), width = image.size(3);
  const int64_t right = padding(width, metadata_), bottom = padding(height, metadata_);
  std::vector<torch::IValue> inputs{pad_replicate(image, right, bottom)};
  if (metadata_.kind == "efnet") {
    check_shape(voxel, "voxel", {image.size(0), kBins, height, width});
    const torch::Tensor events =
        normalize_views(metadata_.input == "scer" ? scer_from_bins(voxel) : voxel);
    inputs.emplace_back(pad_zero(events, right, bottom));
    inputs.emplace_back(pad_zero(event_mask(events), right, bottom));
  }
  torch::Tensor output;
  try {
    output = module_->forward(std::move(inputs)).toTensor();
  } catch (const c10::OutOfMemoryError&) {
    throw DeviceError(concat("not enough memory on ", device_.str(), " to restore ", width, "x",
                             height, " images with ", metadata_.name, ": use --device cpu"));
  } catch (const std::exception& problem) {
    fail(path_, concat("the network refused ", width, "x", height,
                       " images: ", first_line(problem.what())));
  }
  const std::vector<int64_t> expected{image.size(0), 3, height + bottom, width + right};
  if (output.sizes() != torch::IntArrayRef(expected)) {
    fail(path_, concat("the network returned shape ", shape_string(output), " for ",
                       shape_string(image), " images"));
  }
  return output.narrow(2, 0, height).narrow(3, 0, width);
}

torch::Tensor Restorer::restore(const torch::Tensor& blurry, const torch::Tensor& voxel) const {
  const torch::NoGradGuard no_grad;
  const bool single = blurry.dim() == 3;
  const auto prepared = [&](const torch::Tensor& tensor) {
    const torch::Tensor plain = tensor.detach().to(device_, torch::kFloat32);
    return plain.dim() == 3 ? plain.unsqueeze(0) : plain;
  };
  const torch::Tensor image = prepared(blurry);
  check_shape(image, "blurry frame", {-1, 3, -1, -1});
  torch::Tensor output = call(image, voxel.defined() ? prepared(voxel) : voxel);
  if (!output.isfinite().all().item<bool>()) {
    throw NumericError(concat(path_.string(), ": the network returned NaN or Inf for a ",
                              image.size(3), "x", image.size(2), " image"));
  }
  output = output.clamp(0, 1).to(blurry.device()).contiguous();
  return single ? output.squeeze(0) : output;
}

}  // namespace jade::models
