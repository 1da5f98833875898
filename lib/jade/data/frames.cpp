// SPDX-License-Identifier: Apache-2.0
#include "jade/data/frames.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/data/stray_views.h"
#include "jade/events/event_files.h"
#include "jade/imaging/image_header.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/range.h"
#include "jade/imaging/unread_images.h"

namespace jade::data {

namespace fs = std::filesystem;

namespace {

/// Whether a folder's name says that its images are no frames.
bool is_of_other_images(const fs::path& folder) {
  const std::string name = folder.filename().string();
  const auto starts_with = [&](const char* front) { return name.rfind(front, 0) == 0; };
  return starts_with(".") || starts_with("mask") || starts_with("depth") || starts_with("normal") ||
         starts_with("semantic");
}

/// For messages: the first folder with images under another name; empty if there is none.
std::string other_images(const fs::path& root) {
  std::set<fs::path> folders;
  std::error_code error;
  for (fs::directory_iterator entry(root, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    if (!is_of_other_images(entry->path()) && entry->is_directory(ignored))
      folders.insert(entry->path());
  }
  for (const fs::path& folder : folders) {
    const size_t count = imaging::list_images(folder).size();
    if (count > 0) return concat("=", folder.filename().string(), ", which has ", count, " images");
  }
  return "";
}

}  // namespace

std::vector<fs::path> list_images_within(const fs::path& folder) {
  std::vector<fs::path> images = imaging::list_images(folder), folders;
  for (const auto& entry : fs::directory_iterator(folder)) {
    std::error_code ignored;  // of links that lead nowhere
    if (!is_of_other_images(entry.path()) && entry.is_directory(ignored))
      folders.push_back(entry.path());
  }
  std::sort(folders.begin(), folders.end());
  for (const fs::path& inner : folders) {
    const std::vector<fs::path> more = list_images_within(inner);
    images.insert(images.end(), more.begin(), more.end());
  }
  return images;
}

fs::path find_image_folder(const fs::path& root, const std::string& wanted, ImageDepth depth) {
  if (!wanted.empty()) {
    if (fs::is_directory(root / wanted)) return root / wanted;
    throw DataError(
        concat((root / wanted).string(),
               ": no such folder; set dataset.image_folder to the folder of the frames"));
  }
  std::vector<fs::path> candidates = {root / "images_1", root / "images"};
  std::vector<fs::path> others;
  for (const auto& entry : fs::directory_iterator(root)) {
    const std::string name = entry.path().filename().string();
    std::error_code ignored;  // of links that lead nowhere
    if (name.rfind("images_", 0) == 0 && name != "images_edi" && entry.is_directory(ignored)) {
      others.push_back(entry.path());
    }
  }
  std::sort(others.begin(), others.end());
  candidates.insert(candidates.end(), others.begin(), others.end());
  for (const fs::path& folder : candidates) {
    if (fs::is_directory(folder) && !imaging::list_images(folder).empty()) return folder;
  }
  for (const fs::path& folder : candidates) {
    const bool nested = depth == ImageDepth::kNested && fs::is_directory(folder);
    if (nested && !list_images_within(folder).empty()) return folder;
  }
  std::string unread;
  for (const fs::path& folder : candidates) {
    if (unread.empty()) unread = imaging::unread_images(folder);
  }
  throw DataError(concat(root.string(), ": expected frames in images_1/ or images/, found none",
                         unread, unread.empty() ? "; set" : ", or set", " dataset.image_folder",
                         other_images(root)));
}

double folder_scale(const fs::path& image_folder) {
  const std::string name = image_folder.filename().string();
  if (name.rfind("images_", 0) != 0) return 1;
  const double scale = std::atof(name.c_str() + 7);
  return scale >= 1 ? scale : 1;
}

namespace {

bool is_utf8(const std::string& text) {
  try {
    return !nlohmann::json(text).dump().empty();
  } catch (const nlohmann::json::exception&) {
    return false;
  }
}

/// "cam0_001" of ".../cam0/001".
std::string in_folder(const fs::path& path) {
  std::string name = concat(path.parent_path().filename().string(), "_", path.filename().string());
  std::replace(name.begin(), name.end(), '.', '_');
  return name;
}

/// Checks that names are unique, because pictures, cameras and scores are identified by name, and
/// poses of an exposure are called NAME_k.
void check_names(const std::vector<std::string>& names, const std::vector<fs::path>& paths) {
  std::map<std::string, size_t> known;
  for (size_t i = 0; i < names.size(); ++i) {
    const auto [at, added] = known.emplace(names[i], i);
    if (added) continue;
    throw DataError(concat(paths[i].string(), ": expected frames of names that differ, found '",
                           names[i], "' for ", paths[at->second].string(),
                           " too; rename one of them"));
  }
  for (size_t i = 0; i < names.size(); ++i) {
    const size_t size = names[i].size();
    const bool is_pose = size > 2 && names[i][size - 2] == '_' && names[i][size - 1] >= '0' &&
                         names[i][size - 1] <= '8';
    const auto exposure = is_pose ? known.find(names[i].substr(0, size - 2)) : known.end();
    if (exposure == known.end()) continue;
    throw DataError(concat(paths[i].string(), ": the poses of frame '", exposure->first,
                           "' have such names; rename one of the two"));
  }
}

/// Warns of images with a rotation tag. COLMAP ignores such tags too, but other tools and viewers
/// turn the image, so that poses may be of the turned one.
void check_orientation(const std::vector<fs::path>& paths,
                       const std::vector<std::optional<imaging::ImageHeader>>& headers,
                       const Warnings& warnings) {
  const auto is_turned = [](const auto& header) { return header && header->orientation != 1; };
  const auto first = std::find_if(headers.begin(), headers.end(), is_turned);
  if (first == headers.end()) return;
  const int64_t others = std::count_if(first + 1, headers.end(), is_turned);
  const std::string more = others == 0 ? "" : concat(" and ", others, " more");
  warnings.add(paths[size_t(first - headers.begin())].string(), more,
               ": expected an EXIF orientation of 1, found ", (*first)->orientation,
               ", which is not applied (as in COLMAP); if the poses are of the turned images, turn "
               "the pixels too");
}

/// Checks the memory of the decoded frames: three floats and a mask per pixel.
void check_frame_memory(const std::vector<fs::path>& paths,
                        const std::vector<std::optional<imaging::ImageHeader>>& headers) {
  constexpr double kBytesPerPixel = 3 * sizeof(float) + 1;
  double pixels = 0, largest = 0;
  for (const auto& header : headers) {
    if (!header) continue;
    const double size = double(header->width) * double(header->height);
    pixels += size;
    largest = std::max(largest, size);
  }
  if (pixels == 0) return;
  events::check_memory(concat(paths.front().parent_path().string(), ": ", paths.size(),
                              " frames of up to ", 0.1 * std::round(1e-5 * largest), " megapixels"),
                       kBytesPerPixel * pixels,
                       "use smaller images (a folder images_2 or images_4, named by "
                       "dataset.image_folder), or fewer");
}

void check_pictures(const std::vector<fs::path>& paths, const std::vector<Frame>& frames,
                    const Warnings& warnings) {
  std::vector<torch::Tensor> images;
  std::vector<std::string> names;
  for (const Frame& frame : frames) {
    images.push_back(frame.image);
    names.push_back(frame.name);
  }
  for (const std::string& fault : imaging::frame_faults(images, names)) {
    warnings.add(paths.front().parent_path().string(), ": ", fault);
  }
  constexpr size_t kTelling = 8;
  const size_t step = std::max<size_t>(1, images.size() / kTelling);
  size_t looked = 0, mosaics = 0;
  for (size_t i = 0; i < images.size(); i += step) {
    ++looked;
    if (imaging::is_mosaic(images[i])) ++mosaics;
  }
  if (2 * mosaics <= looked) return;
  warnings.add(paths.front().parent_path().string(), ": expected gray or colour frames, found the ",
               "raw mosaic of a colour sensor (2x2 pixels of different brightness); convert the "
               "frames to colour, with the pattern of the camera, and put these in their place");
}

void add_masks(const std::vector<fs::path>& paths, const MaskSources& sources,
               const Warnings& warnings, std::vector<Frame>& frames) {
  if (frames.empty()) return;
  std::vector<torch::Tensor> images;
  for (const Frame& frame : frames) images.push_back(frame.image);
  const std::vector<torch::Tensor> masks = read_masks(paths, images, sources, warnings);
  for (size_t i = 0; i < frames.size(); ++i) {
    frames[i].mask = masks[i];
    frames[i].image = masked(frames[i].image, masks[i]);
  }
}

}  // namespace

std::vector<std::string> frame_names(const std::vector<fs::path>& paths) {
  std::vector<std::string> names;
  std::map<std::string, int> stems, wholes;
  for (const fs::path& path : paths) {
    if (const std::string name = path.filename().string(); !is_utf8(name)) {
      throw DataError(concat(path.string(), ": expected a name in UTF-8; rename the file"));
    }
    ++stems[path.stem().string()];
    ++wholes[in_folder(path.parent_path() / path.stem())];
  }
  for (const fs::path& path : paths) {
    const std::string whole = in_folder(path.parent_path() / path.stem());
    names.push_back(stems[path.stem().string()] == 1 ? path.stem().string()
                    : wholes[whole] == 1             ? whole
                                                     : in_folder(path));
  }
  check_names(names, paths);
  return names;
}

std::vector<Frame> read_frames(const std::vector<fs::path>& paths, const MaskSources& masks,
                               const Warnings& warnings, FrameSizes sizes) {
  const std::vector<std::string> names = frame_names(paths);
  std::vector<std::optional<imaging::ImageHeader>> headers;
  for (const fs::path& path : paths) headers.push_back(imaging::read_image_header(path));
  check_frame_memory(paths, headers);
  check_orientation(paths, headers, warnings);
  std::vector<Frame> frames(paths.size());
  std::vector<std::string> faults(paths.size());
  at::parallel_for(0, int64_t(paths.size()), 1, [&](int64_t begin, int64_t end) {
    for (auto i = size_t(begin); i < size_t(end); ++i)
      frames[i] = {names[i], imaging::read_image(paths[i], &faults[i]), {}};
  });
  if (const std::string fault = imaging::fault_of_all(faults); !fault.empty()) warnings.add(fault);
  for (size_t i = 1; sizes == FrameSizes::kOne && i < frames.size(); ++i) {
    const auto size = frames[i].image.sizes();
    const auto first = frames[0].image.sizes();
    if (size == first) continue;
    throw DataError(concat(paths[i].string(), ": is ", size[2], "x", size[1], " while ",
                           paths[0].filename().string(), " is ", first[2], "x", first[1],
                           "; frames with events come from one sensor and must have one size"));
  }
  check_pictures(paths, frames, warnings);
  add_masks(paths, masks, warnings, frames);
  return frames;
}

DepthBounds depth_bounds(const torch::Tensor& points,
                         const std::vector<geometry::Pose>& cameras_from_world) {
  const std::vector<geometry::Pose> poses = without_strays(cameras_from_world, points);
  std::vector<double> depths;
  if (points.defined()) {
    const torch::Tensor xyz = points.to(torch::kFloat64).contiguous();
    const double* point = xyz.data_ptr<double>();
    // A few hundred thousand depths determine the quantiles well enough.
    const int64_t step = std::max<int64_t>(1, xyz.size(0) * int64_t(poses.size()) / 400000);
    for (size_t view = 0; view < poses.size(); ++view) {
      for (int64_t i = int64_t(view) % step; i < xyz.size(0); i += step) {
        const auto in_camera =
            geometry::transform(poses[view], {point[3 * i], point[3 * i + 1], point[3 * i + 2]});
        if (in_camera[2] > 0) depths.push_back(in_camera[2]);
      }
    }
  }
  if (depths.size() < 10) {
    double spread = 0;
    for (const geometry::Pose& pose : poses) {
      const auto a = geometry::centre(pose);
      const auto b = geometry::centre(poses.front());
      spread = std::max(spread, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
    }
    return spread > 0 ? DepthBounds{0.01 * spread, 100 * spread} : DepthBounds{0.1, 100};
  }
  const auto quantile = [&](double q) {
    const auto at = depths.begin() + static_cast<int64_t>(q * double(depths.size() - 1));
    std::nth_element(depths.begin(), at, depths.end());
    return *at;
  };
  const double low = quantile(0.005);
  return {0.9 * low, 1.1 * quantile(0.995)};
}

}  // namespace jade::data
