// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/folders.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/text.h"
#include "jade/imaging/color.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/range.h"

namespace jade::eval {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void refuse_size(const fs::path& path, const torch::Tensor& found,
                              const torch::Tensor& expected, const fs::path& as) {
  throw DataError(concat(path.string(), ": expected ", expected.size(2), "x", expected.size(1),
                         " as ", as.string(), ", found ", found.size(2), "x", found.size(1)));
}

/// A true image and its mask.
struct MaskedTruth {
  torch::Tensor image, mask;
};

MaskedTruth read_truth(const fs::path& path, const torch::Tensor& of_all, const fs::path& mask) {
  MaskedTruth truth{imaging::read_image(path), of_all};
  if (of_all.defined() && of_all.sizes().slice(1) != truth.image.sizes().slice(1)) {
    refuse_size(mask, of_all, truth.image, path);
  }
  if (const torch::Tensor alpha = imaging::read_alpha(path); alpha.defined()) {
    const torch::Tensor opaque = alpha >= 0.5;
    truth.mask = of_all.defined() ? of_all.logical_and(opaque) : opaque;
  }
  if (truth.mask.defined() && !truth.mask.any().item<bool>()) {
    throw DataError(concat(path.string(),
                           ": expected pixels that count, found all of them transparent or "
                           "excluded by --mask"));
  }
  return truth;
}

/// Images of a folder by their names without extension.
/// @throws DataError if two share a name.
std::map<std::string, fs::path> images_by_name(const fs::path& folder) {
  std::map<std::string, fs::path> by_name;
  for (const fs::path& path : imaging::list_images(folder)) {
    const auto [at, added] = by_name.try_emplace(path.stem().string(), path);
    if (added) continue;
    throw DataError(concat(folder.string(), ": expected one image per name, found ",
                           at->second.filename().string(), " and ", path.filename().string(),
                           "; remove one"));
  }
  return by_name;
}

/// The render of that name; an array (.npy) only where there is no image.
/// @throws DataError if there is neither.
fs::path render_of(const std::string& name, const std::map<std::string, fs::path>& by_name,
                   const fs::path& renders, const fs::path& truth) {
  const auto found = by_name.find(name);
  if (found != by_name.end()) return found->second;
  if (const fs::path array = renders / (name + ".npy"); fs::is_regular_file(array)) return array;
  throw DataError(concat(renders.string(), ": expected an image or .npy named ", name, " as in ",
                         truth.string(), ", found none"));
}

/// The images of a folder of truths; arrays (.npy) only in a folder without images.
std::vector<fs::path> truths_in(const fs::path& folder) {
  std::vector<fs::path> out = imaging::list_images(folder);
  if (!out.empty()) return out;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_regular_file() && entry.path().extension() == ".npy") out.push_back(entry.path());
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// Some pixels of each image of a folder, its brightest among them: enough to check the range
/// without keeping all images in memory.
struct Sampled {
  std::vector<torch::Tensor> pixels;
  std::vector<std::string> names;

  void add(const std::string& name, const torch::Tensor& image) {
    constexpr int64_t kStep = 101;
    names.push_back(name);
    pixels.push_back(
        torch::cat({image.flatten().slice(0, 0, c10::nullopt, kStep), image.max().reshape({1})}));
  }
  void warn_of_range(const fs::path& folder) const {
    const std::string fault = imaging::range_fault(pixels, names);
    if (!fault.empty()) log_warn(concat(folder.string(), ": ", fault));
  }
};

/// Warns of gray renders of truths in colour.
void warn_of_gray(const fs::path& renders, const std::vector<std::string>& gray, size_t all) {
  if (gray.empty()) return;
  log_warn(concat(renders.string(), ": expected renders in colour like their truths, found ",
                  gray.size(), " of ", all, " gray (", listing(gray, 3),
                  "); render them in colour, or make the truths gray too"));
}

/// Warns of renders that no truth used.
/// @param unused  by name
void warn_of_unused(const fs::path& renders, const std::map<std::string, fs::path>& unused,
                    size_t all) {
  if (unused.empty()) return;
  std::vector<std::string> names;
  for (const auto& [name, path] : unused) names.push_back(path.filename().string());
  log_warn(concat(renders.string(), ": expected a truth for each of ", all, " renders, found none ",
                  "for ", listing(names, 5),
                  ", which are not scored; add truths or remove the renders"));
}

}  // namespace

Evaluation compare_folders(const fs::path& renders, const fs::path& truth, const Lpips& lpips,
                           const fs::path& mask) {
  const std::map<std::string, fs::path> by_name = images_by_name(renders);
  std::map<std::string, fs::path> unused = by_name;
  const torch::Tensor of_all = mask.empty() ? torch::Tensor() : imaging::read_mask(mask);
  std::vector<Scores> scores;
  Sampled sampled_renders, sampled_truth;
  std::vector<std::string> gray;
  int64_t masked = 0, composited = 0;
  double excluded = 0;
  images_by_name(truth);  // Refuses two of one name.
  for (const fs::path& path : truths_in(truth)) {
    unused.erase(path.stem().string());
    // jade_render --depth writes NAME_depth.png beside NAME.png.
    unused.erase(path.stem().string() + "_depth");
    const std::string name = path.stem().string();
    const fs::path render = render_of(name, by_name, renders, truth);
    torch::Tensor image = imaging::read_image(render);
    const MaskedTruth reference = read_truth(path, of_all, mask);
    if (image.sizes() != reference.image.sizes()) {
      refuse_size(render, image, reference.image, path);
    }
    sampled_renders.add(name, image);
    sampled_truth.add(name, reference.image);
    const bool is_gray = imaging::is_gray(image) && image.any().item<bool>();
    if (is_gray && !imaging::is_gray(reference.image)) gray.push_back(name);
    if (const torch::Tensor alpha = imaging::read_alpha(render); alpha.defined()) {
      image = image * alpha;
      ++composited;
    }
    scores.push_back(score(name, image, reference.image, &lpips, reference.mask));
    masked += int64_t(reference.mask.defined());
    excluded += scores.back().excluded;
  }
  if (scores.empty())
    throw DataError(concat(truth.string(), ": expected images or .npy, found none"));
  warn_of_unused(renders, unused, by_name.size());
  sampled_renders.warn_of_range(renders);
  sampled_truth.warn_of_range(truth);
  warn_of_gray(renders, gray, scores.size());
  if (masked > 0) {
    log_info(concat(truth.string(), ": ", masked, " of ", scores.size(),
                    " truths have pixels that do not count (alpha or mask), ",
                    0.1 * std::round(1000 * excluded / double(scores.size())), " % of all pixels"));
  }
  if (composited > 0) {
    log_info(concat(renders.string(), ": ", composited, " of ", scores.size(),
                    " renders have alpha and are laid over black"));
  }
  return evaluation_of(std::move(scores));
}

}  // namespace jade::eval
