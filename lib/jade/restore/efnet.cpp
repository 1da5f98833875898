// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/efnet.h"

#include <ATen/autocast_mode.h>
#include <algorithm>
#include <c10/core/Allocator.h>
#include <map>
#include <new>
#include <optional>
#include <torch/csrc/jit/runtime/graph_executor.h>
#include <torch/nn/functional/padding.h>
#include <torch/script.h>

#include "jade/core/asset.h"
#include "jade/core/check.h"
#include "jade/core/device.h"
#include "jade/core/digest.h"
#include "jade/core/freed_memory.h"
#include "jade/core/log.h"

namespace jade::restore {
namespace {

namespace F = torch::nn::functional;

constexpr int64_t kBins = 6;
// Tiles for low memory: the size of the core that is kept, and the margin around it.
constexpr int64_t kLargestTile = 512, kSmallestTile = 64, kTileMargin = 32;
// A CPU is slower with larger batches (docs/engineering/restorer.md), and an operating system may
// kill a program rather than refuse memory.
constexpr int64_t kPixelsPerCpuCall = int64_t{1} << 17;
// Memory of a call per pixel of each image on a GPU. The others limit the memory of a call with
// several images, and that of one image before it is split into tiles.
constexpr int64_t kGpuBytesPerPixel = 1600;
constexpr int64_t kGpuCallBytes = int64_t{512} << 20, kGpuFrameBytes = int64_t{4} << 30;
constexpr int64_t kGpuTile = 1280;  ///< including margins, as large as such an image

/// The device has too little memory for this call.
struct OutOfMemory : DeviceError {
  using DeviceError::DeviceError;
};

std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

/// Drops torch's advice after it, which refers to torch's own checkpoints.
std::string first_sentence(const std::string& text) {
  const std::string line = first_line(text);
  return line.substr(0, line.find(". "));
}

/// TorchScript puts the reason on the last line, after its trace.
std::string last_line(const std::string& text) {
  const size_t end = text.find_last_not_of(" \n");
  if (end == std::string::npos) return text;
  const size_t newline = text.find_last_of('\n', end);
  return text.substr(newline == std::string::npos ? 0 : newline + 1,
                     end - (newline == std::string::npos ? 0 : newline + 1) + 1);
}

/// TorchScript passes errors of its operators on as text only.
bool says_out_of_memory(const std::string& text) {
  for (const char* words :
       {"out of memory", "ALLOC_FAILED", "can't allocate memory", "not enough memory"}) {
    if (text.find(words) != std::string::npos) return true;
  }
  return false;
}

/// Convolutions and products of matrices in half precision on a GPU, the rest in float32: a frame
/// takes two thirds of the time and of the memory, and differs by 1/25,000 (88 dB).
class HalfProducts {
 public:
  explicit HalfProducts(torch::Device device) : on_(device.is_cuda()) {
    if (!on_) return;
    at::autocast::set_autocast_dtype(at::kCUDA, at::kHalf);
    at::autocast::set_autocast_enabled(at::kCUDA, true);
    at::autocast::increment_nesting();
  }
  ~HalfProducts() {
    if (!on_) return;
    if (at::autocast::decrement_nesting() == 0) at::autocast::clear_cache();
    at::autocast::set_autocast_enabled(at::kCUDA, false);
  }
  HalfProducts(const HalfProducts&) = delete;
  HalfProducts& operator=(const HalfProducts&) = delete;

 private:
  bool on_;
};

/// Number of pixels to add to `size` so that the network accepts it.
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

/// 3×3 maximum; outside the image is the smallest value.
torch::Tensor dilate(const torch::Tensor& image) {
  return torch::max_pool2d(image, {3, 3}, {1, 1}, {1, 1});
}

std::unique_ptr<torch::jit::Module> load_module(const std::filesystem::path& path) {
  try {
    return std::make_unique<torch::jit::Module>(torch::jit::load(path.string(), torch::kCPU));
  } catch (const c10::Error& problem) {
    fail_restorer(path, concat("no TorchScript file, or a damaged one: ",
                               first_sentence(problem.what_without_backtrace()),
                               "; make it with scripts/efnet/export_efnet.py"));
  } catch (const std::exception& problem) {
    fail_restorer(path, concat("cannot be loaded: ", first_line(problem.what())));
  }
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

std::string weights_sha256(const torch::jit::Module& module) {
  std::map<std::string, torch::Tensor> by_name;
  for (const auto& parameter : module.named_parameters()) {
    by_name[parameter.name] =
        parameter.value.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  }
  Sha256 digest;
  for (const auto& [name, values] : by_name) {
    digest.update(name.c_str(), name.size() + 1);
    digest.update(values.const_data_ptr(), values.nbytes());
  }
  return digest.hex();
}

std::filesystem::path restorer_path(const EfnetOptions& options) {
  return options.path.empty() ? asset("assets/efnet_anytime.pt") : options.path;
}

namespace {

std::filesystem::path existing_file(const EfnetOptions& options) {
  std::filesystem::path path = restorer_path(options);
  if (!std::filesystem::is_regular_file(path)) {
    throw DataError(concat("efnet.path: expected the TorchScript file of the restorer, found no ",
                           "file ", path.string(),
                           options.path.empty() ? ", which comes with the program; name another"
                                                : "; leave the key empty for the one that ships"));
  }
  return path;
}

}  // namespace

std::string restorer_file_sha256(const EfnetOptions& options) {
  return file_sha256(existing_file(options));
}

Restorer::Restorer(const EfnetOptions& options, torch::Device device)
    : path_(existing_file(options)), device_(device) {
  metadata_ = read_restorer_metadata(path_);
  module_ = load_module(path_);
  const std::string weights = weights_sha256(*module_);
  if (weights != metadata_.weights_sha256) {
    fail_restorer(path_, concat("its metadata is of weights ", metadata_.weights_sha256,
                                ", it holds ", weights, ": damaged or edited; export it again"));
  }
  if (metadata_.stored_as_half) module_->to(torch::kFloat32);
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
    log_warn(concat(path_.string(), ": does not fit the memory of ", device.str(),
                    "; restoring on the CPU"));
    device = torch::kCPU;
    module_->to(device);
  }
  device_ = device;
  // Convolutions use the memory format of their weights. With channels last a frame takes an eighth
  // less time on a CPU, a quarter less on a GPU.
  for (torch::Tensor parameter : module_->parameters()) {
    if (parameter.dim() == 4) {
      parameter.set_data(parameter.contiguous(at::MemoryFormat::ChannelsLast));
    }
  }
}

Restorer::Inputs Restorer::inputs_of(const torch::Tensor& image, const torch::Tensor& events,
                                     const torch::Tensor& times) const {
  if (metadata_.kind != "efnet") return {{image}, {}};
  check_shape(events, "events", {image.size(0), metadata_.windows, image.size(2), image.size(3)});
  if (metadata_.any_time) return {{image, events}, times};
  const torch::Tensor channels =
      normalize_views(metadata_.input == "scer" ? scer_from_bins(events) : events);
  return {{image, channels, event_mask(channels)}, {}};
}

torch::Tensor Restorer::call(const Inputs& inputs) const {
  const torch::Tensor& image = inputs.maps.front();
  const int64_t height = image.size(2), width = image.size(3);
  const int64_t right = padding(width, metadata_), bottom = padding(height, metadata_);
  const std::string size = concat(width, "x", height, " images");
  std::optional<FreedMemoryKept> kept;
  if (device_.is_cpu()) kept.emplace();
  torch::Tensor output;
  try {
    std::vector<torch::IValue> padded{pad_replicate(image.to(device_), right, bottom)};
    for (size_t i = 1; i < inputs.maps.size(); ++i) {
      padded.emplace_back(pad_zero(inputs.maps[i].to(device_), right, bottom));
    }
    if (inputs.times.defined()) padded.emplace_back(inputs.times.to(device_));
    // Profiling and fusing for each new shape takes seconds; a run restores about a dozen views.
    const torch::jit::GraphOptimizerEnabledGuard as_written(false);
    const HalfProducts half_products(device_);
    output = module_->forward(std::move(padded)).toTensor().to(torch::kFloat32);
  } catch (const std::bad_alloc&) {
    throw OutOfMemory(concat("not enough memory on ", device_.str(), " to restore ", size));
  } catch (const std::exception& problem) {
    if (says_out_of_memory(problem.what())) {
      throw OutOfMemory(concat("not enough memory on ", device_.str(), " to restore ", size));
    }
    fail_restorer(path_, concat("the network refused ", size, ": ", last_line(problem.what())));
  }
  const std::vector<int64_t> expected{image.size(0), 3, height + bottom, width + right};
  if (output.sizes() != torch::IntArrayRef(expected)) {
    fail_restorer(path_, concat("the network returned shape ", shape_string(output), " for ",
                                shape_string(image), " images"));
  }
  return output.narrow(2, 0, height).narrow(3, 0, width);
}

RestorerCall restorer_call(torch::Device device, int64_t pixels) {
  if (device.is_cpu()) return {std::max<int64_t>(1, kPixelsPerCpuCall / pixels), 0};
  const int64_t bytes = kGpuBytesPerPixel * pixels;
  return {std::max<int64_t>(1, kGpuCallBytes / bytes), bytes > kGpuFrameBytes ? kGpuTile : 0};
}

RestorerCall Restorer::call_for(const torch::Tensor& image) const {
  RestorerCall call = restorer_call(device_, image.size(2) * image.size(3));
  if (batch_ > 0) call.images = std::min(batch_, call.images);
  if (tile_ > 0) call.tile = tile_;
  return call;
}

torch::Tensor Restorer::call_in_parts(const Inputs& inputs) const {
  const int64_t images = inputs.maps.front().size(0);
  const auto [each, tile] = call_for(inputs.maps.front());
  std::vector<torch::Tensor> restored;
  for (int64_t first = 0; first < images; first += each) {
    const int64_t count = std::min(each, images - first);
    Inputs part;
    for (const torch::Tensor& map : inputs.maps) part.maps.push_back(map.narrow(0, first, count));
    if (inputs.times.defined()) part.times = inputs.times.narrow(0, first, count);
    restored.push_back(tile == 0 ? call(part) : call_in_tiles(part, tile));
  }
  return restored.size() == 1 ? restored.front() : torch::cat(restored);
}

torch::Tensor Restorer::call_in_tiles(const Inputs& inputs, int64_t core) const {
  const torch::Tensor& image = inputs.maps.front();
  const int64_t height = image.size(2), width = image.size(3);
  torch::Tensor output = torch::empty_like(image);
  for (int64_t y = 0; y < height; y += core) {
    for (int64_t x = 0; x < width; x += core) {
      const int64_t top = std::max<int64_t>(0, y - kTileMargin);
      const int64_t left = std::max<int64_t>(0, x - kTileMargin);
      const int64_t tall = std::min(height, y + core + kTileMargin) - top;
      const int64_t wide = std::min(width, x + core + kTileMargin) - left;
      Inputs part;
      for (const torch::Tensor& map : inputs.maps) {
        part.maps.push_back(map.narrow(2, top, tall).narrow(3, left, wide));
      }
      part.times = inputs.times;
      const int64_t kept_height = std::min(core, height - y),
                    kept_width = std::min(core, width - x);
      const torch::Tensor restored = call(part);
      output.narrow(2, y, kept_height)
          .narrow(3, x, kept_width)
          .copy_(restored.narrow(2, y - top, kept_height).narrow(3, x - left, kept_width));
    }
  }
  return output;
}

torch::Tensor Restorer::restore_where_it_fits(const Inputs& inputs) {
  const torch::Tensor& frame = inputs.maps.front();
  if (const int64_t tile = call_for(frame).tile; tile > 0 && tile_ == 0 && !told_of_tiles_) {
    log_warn(concat(metadata_.name, ": frames of ", frame.size(3), "x", frame.size(2),
                    " px are restored in tiles of ", tile,
                    " px, as a whole one takes more than 4 GiB; tiles differ slightly from it"));
    told_of_tiles_ = true;
  }
  while (true) {
    try {
      return call_in_parts(inputs);
    } catch (const OutOfMemory& problem) {
      const torch::Tensor& image = inputs.maps.front();
      const int64_t together = std::min(image.size(0), call_for(image).images);
      if (together > 1) {
        batch_ = together / 2;
        log_warn(concat(problem.what(), " with ", metadata_.name, ", ", together,
                        " at once; going on with ", batch_, " at once"));
        continue;
      }
      const int64_t longest = std::max(image.size(2), image.size(3));
      do {
        tile_ = tile_ == 0 ? kLargestTile : tile_ / 2;
      } while (tile_ >= longest);
      if (tile_ < kSmallestTile && !device_.is_cpu()) {
        log_warn(concat(problem.what(), " with ", metadata_.name, "; going on on the CPU"));
        to(torch::kCPU);
        tile_ = 0;
        continue;
      }
      if (tile_ < kSmallestTile) {
        throw DeviceError(concat(problem.what(), " with ", metadata_.name,
                                 ", not even in tiles; close other programs"));
      }
      log_warn(concat(problem.what(), " with ", metadata_.name, " at once; going on in tiles of ",
                      tile_, " px, which differ slightly from whole frames"));
    }
  }
}

torch::Tensor Restorer::restore_batch(const torch::Tensor& image, const torch::Tensor& events,
                                      const torch::Tensor& times) {
  check_shape(image, "blurry frame", {-1, 3, -1, -1});
  const torch::Tensor output = restore_where_it_fits(inputs_of(image, events, times));
  if (!output.isfinite().all().item<bool>()) {
    throw NumericError(concat(path_.string(), ": the network returned NaN or Inf for a ",
                              image.size(3), "x", image.size(2), " image"));
  }
  return output.clamp(0, 1);
}

torch::Tensor Restorer::restore(const torch::Tensor& blurry, const torch::Tensor& events) {
  const torch::NoGradGuard no_grad;
  const bool single = blurry.dim() == 3;
  const auto prepared = [&](const torch::Tensor& tensor) {
    if (!tensor.defined()) return tensor;
    const torch::Tensor plain = tensor.detach().to(device_, torch::kFloat32);
    return plain.dim() == 3 ? plain.unsqueeze(0) : plain;
  };
  const torch::Tensor image = prepared(blurry);
  const torch::Tensor middle = torch::full({image.size(0)}, 0.5, image.options());
  const torch::Tensor output =
      restore_batch(image, prepared(events), middle).to(blurry.device()).contiguous();
  return single ? output.squeeze(0) : output;
}

torch::Tensor Restorer::restore(const torch::Tensor& blurry, const torch::Tensor& events,
                                const std::vector<double>& times) {
  check_times(path_, metadata_, times);
  const torch::NoGradGuard no_grad;
  const auto count = static_cast<int64_t>(times.size());
  const auto repeated = [&](const torch::Tensor& tensor) {
    if (!tensor.defined()) return tensor;
    return tensor.detach().to(device_, torch::kFloat32).expand({count, -1, -1, -1});
  };
  return restore_batch(repeated(blurry), repeated(events),
                       torch::tensor(times, torch::kFloat32).to(device_))
      .to(blurry.device())
      .contiguous();
}

void Restorer::warm_up() {
  const torch::NoGradGuard no_grad;
  const int64_t side = 64;
  const auto zeros = [&](int64_t channels) {
    return torch::zeros({1, channels, side, side}, torch::TensorOptions(device_));
  };
  try {
    call(inputs_of(zeros(3), zeros(metadata_.windows),
                   torch::full({1}, 0.5, torch::TensorOptions(device_))));
  } catch (const std::exception&) {
    // This call only warms up: the first real frame reports problems of the network.
  }
  // A copy to the CPU synchronises this thread's work on the device, so that other threads see
  // complete weights.
  zeros(1).to(torch::kCPU);
}

std::future<Restorer> load_beside(const EfnetOptions& options, torch::Device device) {
  return std::async(std::launch::async, [options, device] {
    bound_stack_memory(device);
    Restorer restorer(options, device);
    restorer.warm_up();
    return restorer;
  });
}

}  // namespace jade::restore
