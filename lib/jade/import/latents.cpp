// SPDX-License-Identifier: Apache-2.0
#include "jade/import/latents.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/core/readable.h"
#include "jade/imaging/color.h"
#include "jade/imaging/image_io.h"
#include "jade/restore/restored_exposure.h"

namespace jade::import {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// Enlarges an image; pixel centres keep their place in the field of view.
torch::Tensor enlarged(const torch::Tensor& image, int64_t factor) {
  if (factor == 1) return image;
  return at::upsample_bicubic2d(image.unsqueeze(0),
                                {factor * image.size(1), factor * image.size(2)},
                                /*align_corners=*/false)[0];
}

std::string image_file(size_t shot, size_t moment) {
  const std::string number = std::to_string(shot);
  return concat(std::string(number.size() < 5 ? 5 - number.size() : 0, '0'), number, "_",
                4 * moment, ".png");
}

bool is_monochrome(const Capture& capture) {
  return std::all_of(capture.shots.begin(), capture.shots.end(),
                     [](const Shot& shot) { return imaging::is_gray(shot.image); });
}

/// Announces the remaining work once the first frame has been timed.
void announce(int64_t frames, std::chrono::duration<double> each, torch::Device device) {
  log_info(concat("restoring ", grouped(frames), " frames x ", std::size(kLatentMoments),
                  " moments, ", about_time(each.count() * double(frames)),
                  device.is_cpu() ? " on this CPU" : " on this GPU"));
}

}  // namespace

bool is_sharp(const Shot& shot, double sharp_px) {
  return shot.duration_us() == 0 || (shot.blur_px >= 0 && shot.blur_px < sharp_px);
}

torch::Tensor latents_of(const Shot& shot, const Capture& capture, const ImportOptions& options,
                         restore::ViewRestorer& restorer) {
  restore::RestoreOptions how{options.events, {geometry::QuadratureRule::kTrapezoid, 9}};
  const bool mean_of_each = options.latents.kind == LatentKind::kMean && restorer.has_network() &&
                            restorer.metadata().any_time;
  if (mean_of_each) how.times.assign(std::begin(kLatentMoments), std::end(kLatentMoments));
  const data::Exposure exposure = exposure_of(shot, capture);
  const restore::RestoredExposure restored =
      restore::restore_exposure(exposure, capture.events, how, restorer);
  const torch::Tensor gain = restore::gain_at(restored, how, {0, 0.5, 1}).unsqueeze(1);
  torch::Tensor latents = exposure.blurry.to(gain.device()) * gain;
  if (options.latents.kind == LatentKind::kEdi) return latents.cpu();
  if (mean_of_each) return (0.5 * (latents + restored.efnet_at)).cpu();
  const torch::Tensor mean = 0.5 * (restored.restorations.edi + restored.restorations.efnet);
  if (options.latents.kind == LatentKind::kMean) return (mean * (gain / gain[1])).cpu();
  latents[1] = mean;
  return latents.cpu();
}

std::vector<LatentImage> write_latents(const fs::path& folder, const Capture& capture,
                                       const ImportOptions& options) {
  make_writable_folder(folder / "images");
  const bool needs_network = options.latents.kind != LatentKind::kEdi;
  const torch::Device device = select_device(options.device);
  restore::ViewRestorer restorer(options.cache,
                                 needs_network ? std::optional(options.efnet) : std::nullopt,
                                 device, is_monochrome(capture));
  std::vector<LatentImage> images;
  Progress progress("restoring", static_cast<int64_t>(capture.shots.size()), 0, "frames");
  const auto write = [&](size_t shot, size_t moment, const torch::Tensor& image, int64_t t_us) {
    images.push_back({image_file(shot, moment), static_cast<int64_t>(shot), t_us});
    imaging::write_image(folder / "images" / images.back().file,
                         enlarged(image, options.latents.upscale));
  };
  // Without events, the frame itself is the best image of the middle.
  const auto is_whole = [&](const Shot& shot) {
    return is_sharp(shot, options.test.sharp_px) ||
           capture.events.slice(shot.t_start_us, shot.t_end_us).empty();
  };
  const auto blurry =
      std::count_if(capture.shots.begin(), capture.shots.end(), std::not_fn(is_whole));
  bool announced = false;
  for (size_t i = 0; i < capture.shots.size(); ++i) {
    throw_if_interrupted();
    const Shot& shot = capture.shots[i];
    if (is_whole(shot)) {
      write(i, 1, shot.image, shot.t_mid_us());
    } else {
      const auto start = std::chrono::steady_clock::now();
      const torch::Tensor latents = latents_of(shot, capture, options, restorer);
      if (!announced) announce(blurry, std::chrono::steady_clock::now() - start, device);
      announced = true;
      for (size_t k = 0; k < std::size(kLatentMoments); ++k) {
        write(
            i, k, latents[static_cast<int64_t>(k)],
            shot.t_start_us + static_cast<int64_t>(kLatentMoments[k] * double(shot.duration_us())));
      }
    }
    if (progress.step()) progress.show(shot.name);
  }
  Json list = Json::array();
  for (const LatentImage& image : images) {
    list.push_back({{"file", image.file}, {"shot", image.shot}, {"t_us", image.t_us}});
  }
  write_file(folder / "images.json", list.dump(1) + "\n");
  return images;
}

std::vector<LatentImage> load_latents(const fs::path& folder) {
  std::vector<LatentImage> images;
  try {
    for (const Json& image : Json::parse(read_file(folder / "images.json"))) {
      images.push_back({image.at("file"), image.at("shot"), image.at("t_us")});
    }
  } catch (const Json::exception& error) {
    throw DataError(concat((folder / "images.json").string(),
                           ": expected what this program wrote, found ", error.what(),
                           "; import again with --from restore"));
  }
  return images;
}

}  // namespace jade::import
