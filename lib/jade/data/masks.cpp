// SPDX-License-Identifier: Apache-2.0
#include "jade/data/masks.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cstdio>
#include <map>
#include <set>
#include <string>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/core/readable.h"
#include "jade/core/text.h"
#include "jade/data/named_files.h"
#include "jade/events/pixels.h"
#include "jade/imaging/image_io.h"
#include "jade/io/accents.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// A folder that may contain masks, and the subfolder for frames of this folder.
struct MaskFolder {
  fs::path folder, inside;
};

/// Folders named masks beside the folder of a frame, or beside one of its parents up to the root.
/// Inside, frames have the path that they have from there, with or without its first folder.
class MaskFolders {
 public:
  explicit MaskFolders(const fs::path& root) : root_(root) {}
  std::vector<MaskFolder> of(const fs::path& frame);

 private:
  /// Keeps the places, because frames share them and folders may be long.
  fs::path spelled(const fs::path& folder, const std::string& name) {
    const auto [at, added] = known_.emplace(folder / name, fs::path());
    if (added) at->second = in_any_case(folder, name);
    return at->second;
  }

  fs::path root_;
  std::map<fs::path, fs::path> known_;
};

std::vector<MaskFolder> MaskFolders::of(const fs::path& frame) {
  const fs::path home = frame.parent_path().lexically_normal();
  const fs::path top = fs::absolute(root_ / ".").lexically_normal().parent_path();
  const std::string name = home.filename().string();
  std::vector<MaskFolder> folders;
  if (name.rfind("images_", 0) == 0) {
    folders.push_back({spelled(home.parent_path(), "masks_" + name.substr(7)), {}});
  }
  if (fs::absolute(home / ".").lexically_normal().parent_path() == top) {
    folders.push_back({spelled(home, "masks"), {}});
    return folders;
  }
  const auto is_within = [&](const fs::path& place) {
    const fs::path inside = fs::absolute(place / ".").lexically_normal().lexically_relative(top);
    return !inside.empty() && *inside.begin() != "..";
  };
  const bool outside = !is_within(home);
  constexpr int kParentsOutside = 2;
  fs::path place = home, whole;
  for (int parents = 0; place.has_relative_path(); ++parents) {
    const fs::path inner = whole;
    whole = place.filename() / whole;
    place = place.parent_path();
    if (outside ? parents >= kParentsOutside : !is_within(place)) break;
    folders.push_back({spelled(place, "masks"), inner});
    folders.push_back({spelled(place, "masks"), whole});
  }
  return folders;
}

fs::path mask_in(const MaskFolder& at, const fs::path& frame) {
  const std::string stem = frame.stem().string(), whole = frame.filename().string();
  const std::string names[] = {whole + ".png",    stem + ".png",     stem + ".png.png",
                               stem + ".jpg.png", stem + ".JPG.png", whole};
  for (const std::string& name : names) {
    fs::path path = at.folder / at.inside / name;
    if (fs::is_regular_file(path)) return path;
  }
  for (const std::string& name : names) {
    fs::path path = io::respelled(at.folder / at.inside / name);
    if (fs::is_regular_file(path)) return path;
  }
  return {};
}

/// The mask beside a frame, or an empty path.
fs::path mask_beside(const fs::path& frame, MaskFolders& folders) {
  for (const MaskFolder& at : folders.of(frame)) {
    if (fs::path path = mask_in(at, frame); !path.empty()) return path;
  }
  return {};
}

torch::Tensor checked_mask(const fs::path& path, const fs::path& frame,
                           const torch::Tensor& image) {
  torch::Tensor mask = imaging::read_mask(path);
  if (mask.size(1) != image.size(1) || mask.size(2) != image.size(2)) {
    throw DataError(concat(path.string(), ": expected a mask of ", image.size(2), "x",
                           image.size(1), " px, as ", frame.filename().string(), " has, found ",
                           mask.size(2), "x", mask.size(1), "; make it at the size of the frames"));
  }
  if (!mask.any().item<bool>()) {
    throw DataError(concat(path.string(),
                           ": expected a mask with pixels that count (not black), found none; "
                           "invert or remove it"));
  }
  return mask;
}

[[noreturn]] void refuse_empty(const std::string& frame) {
  throw DataError(concat(frame,
                         ": expected pixels that count, found all of them excluded by the masks "
                         "together; correct the masks or leave the frame out"));
}

}  // namespace

torch::Tensor opaque_part(const fs::path& path) {
  const torch::Tensor alpha = imaging::read_alpha(path);
  if (!alpha.defined()) return {};
  torch::Tensor mask = alpha >= 0.5;
  if (!mask.any().item<bool>()) {
    throw DataError(concat(path.string(),
                           ": expected pixels that are opaque, found alpha below half everywhere; "
                           "remove its alpha channel or the frame"));
  }
  return mask;
}

namespace {

/// Warns of frames without a mask if others have one.
void tell_unmatched(const std::vector<fs::path>& paths, const std::vector<fs::path>& beside,
                    MaskFolders& places, const Warnings& warnings) {
  std::vector<std::string> without;
  std::set<fs::path> folders;
  for (size_t i = 0; i < paths.size(); ++i) {
    if (beside[i].empty()) without.push_back(paths[i].filename().string());
    for (const MaskFolder& at : places.of(paths[i])) {
      if (fs::is_directory(at.folder)) folders.insert(at.folder);
    }
  }
  if (without.empty() || folders.empty()) return;
  const auto empty = [](const fs::path& folder) { return fs::is_empty(folder); };
  if (std::all_of(folders.begin(), folders.end(), empty)) return;
  warnings.add(folders.begin()->string(), ": has no mask for ", without.size(), " of ",
               paths.size(), " frames (", listing(without, 3),
               "); all of their pixels count. Masks are named as their frames, NAME.png");
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f %%", 100 * share);
  return text;
}

double share_excluded(const torch::Tensor& mask) {
  return 1 - mask.sum().item<double>() / double(mask.numel());
}

/// Training and held-out exposures, sorted by time.
std::vector<const Exposure*> timed_exposures(const Dataset& data) {
  std::vector<const Exposure*> exposures;
  for (const auto* list : {&data.train, &data.held_out}) {
    for (const Exposure& exposure : *list) exposures.push_back(&exposure);
  }
  std::sort(exposures.begin(), exposures.end(),
            [](const Exposure* a, const Exposure* b) { return a->t_start_us < b->t_start_us; });
  return exposures;
}

events::EventStream without_masked(const Dataset& data) {
  const std::vector<const Exposure*> exposures = timed_exposures(data);
  std::vector<torch::Tensor> parts;
  int64_t done = 0;
  for (size_t i = 0; i < exposures.size(); ++i) {
    int64_t until = data.events.size();
    if (i + 1 < exposures.size()) {
      // Each of two neighbours gets half of the gap.
      const int64_t end = exposures[i]->t_end_us, next = exposures[i + 1]->t_start_us;
      until = std::max(done, data.events.count_before(end + (next - end) / 2));
    }
    const torch::Tensor& mask = exposures[i]->mask;
    parts.push_back(mask.defined() ? events::kept_by(mask[0], data.events.range(done, until))
                                   : torch::ones({until - done}, torch::kBool));
    done = until;
  }
  const torch::Tensor keep = torch::cat(parts);
  if (keep.all().item<bool>()) return data.events;
  events::EventStream kept = data.events.select(keep);
  log_info(concat("masks: ", grouped(data.events.size() - kept.size()), " of ",
                  grouped(data.events.size()), " events lie at excluded pixels and are dropped"));
  return kept;
}

}  // namespace

MaskSources::MaskSources(const DatasetOptions& options, std::vector<fs::path> named_masks)
    : root(options.path), of_all(options.mask), named(std::move(named_masks)) {}

std::vector<torch::Tensor> read_masks(const std::vector<fs::path>& paths,
                                      const std::vector<torch::Tensor>& images,
                                      const MaskSources& sources, const Warnings& warnings) {
  std::vector<torch::Tensor> masks(paths.size());
  std::set<std::string> said;
  const auto add = [&](size_t i, const torch::Tensor& mask, const std::string& source) {
    if (!mask.defined()) return;
    masks[i] = both_masks(masks[i], mask);
    said.insert(source);
  };
  std::vector<torch::Tensor> alphas(paths.size());
  at::parallel_for(0, int64_t(paths.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) alphas[size_t(i)] = opaque_part(paths[size_t(i)]);
  });
  MaskFolders folders(sources.root);
  std::vector<fs::path> beside(paths.size());
  for (size_t i = 0; i < paths.size(); ++i) {
    add(i, alphas[i], "alpha");
    beside[i] = mask_beside(paths[i], folders);
    if (!beside[i].empty()) add(i, checked_mask(beside[i], paths[i], images[i]), "masks/");
    if (i < sources.named.size() && !sources.named[i].empty()) {
      add(i, checked_mask(sources.named[i], paths[i], images[i]), "mask_path");
    }
  }
  tell_unmatched(paths, beside, folders, warnings);
  for (const fs::path& path : {sources.of_all, in_any_case(sources.root, kMaskFile)}) {
    if (path.empty() || (path != sources.of_all && !fs::is_regular_file(path))) continue;
    const torch::Tensor mask = checked_mask(path, paths.front(), images.front());
    for (size_t i = 0; i < paths.size(); ++i) {
      if (mask.sizes().slice(1) != images[i].sizes().slice(1))
        checked_mask(path, paths[i], images[i]);
      add(i, mask, path.filename().string());
    }
  }
  int64_t frames = 0;
  double excluded = 0;
  for (size_t i = 0; i < masks.size(); ++i) {
    if (masks[i].defined() && masks[i].all().item<bool>()) masks[i] = torch::Tensor();
    if (!masks[i].defined()) continue;
    if (!masks[i].any().item<bool>()) refuse_empty(paths[i].string());
    ++frames;
    excluded += share_excluded(masks[i]) / double(masks.size());
  }
  constexpr double kNearlyAll = 0.95;
  if (excluded > kNearlyAll) {
    warnings.add(paths.front().parent_path().string(), ": expected masks that leave most pixels, ",
                 "found ", percent(excluded),
                 " of the pixels excluded; pixels that count are white");
  }
  if (frames > 0) {
    log_info(concat("masks: ", frames, " of ", paths.size(), " frames, ", percent(excluded),
                    " of the pixels excluded (from ", listing({said.begin(), said.end()}), ")"));
  }
  return masks;
}

torch::Tensor masked(const torch::Tensor& image, const torch::Tensor& mask) {
  return mask.defined() ? image.masked_fill(~mask.to(image.device()), 0) : image;
}

torch::Tensor both_masks(const torch::Tensor& a, const torch::Tensor& b) {
  return !a.defined() ? b : !b.defined() ? a : a.logical_and(b);
}

void apply_masks(Dataset& data) {
  bool any = false;
  const auto apply = [&](const std::string& name, const torch::Tensor& mask, torch::Tensor& image) {
    if (!mask.defined()) return;
    if (!mask.any().item<bool>()) refuse_empty(name);
    image = masked(image, mask);
    any = true;
  };
  for (auto* list : {&data.train, &data.held_out}) {
    for (Exposure& exposure : *list) apply(exposure.name, exposure.mask, exposure.blurry);
  }
  for (SharpView& view : data.test) apply(view.name, view.mask, view.image);
  if (!any || data.events.empty()) return;
  data.events = without_masked(data);
  for (auto* list : {&data.train, &data.held_out}) {
    for (Exposure& exposure : *list) {
      exposure.events = data.events.slice(exposure.t_start_us, exposure.t_end_us);
    }
  }
}

MaskSummary summarize_masks(const Dataset& data) {
  MaskSummary summary;
  int64_t all = 0;
  const auto add = [&](const torch::Tensor& mask) {
    ++all;
    if (!mask.defined()) return;
    const double share = share_excluded(mask);
    ++summary.frames;
    summary.excluded += share;
    summary.largest = std::max(summary.largest, share);
  };
  for (const auto* list : {&data.train, &data.held_out}) {
    for (const Exposure& exposure : *list) add(exposure.mask);
  }
  for (const SharpView& view : data.test) add(view.mask);
  if (all > 0) summary.excluded /= double(all);
  return summary;
}

}  // namespace jade::data
