// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms.h"

#include <algorithm>
#include <set>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/data/colmap_scene.h"
#include "jade/data/frames.h"
#include "jade/data/named_files.h"
#include "jade/data/origin.h"
#include "jade/data/transforms_camera.h"
#include "jade/data/transforms_json.h"
#include "jade/data/transforms_split.h"
#include "jade/data/undistorter.h"
#include "jade/data/unused_parts.h"
#include "jade/imaging/image_io.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// Reads nerfstudio's initial points, in the axes of the poses.
void read_points(const TransformsFile& file, Dataset& data, const Warnings& warnings) {
  const std::string name = text_of(file.root, "ply_file_path", file.path.string());
  if (name.empty()) return;
  NamedFiles files{file.path.parent_path(), {}, {}, {}, {}};
  const fs::path path = files.find(name);
  if (path.empty()) {
    warnings.add(file.path.string(), ": 'ply_file_path' names ", name,
                 ", which is not there; no points are used");
    return;
  }
  io::ColmapModel model;
  read_ply_points(path, data.origin, warnings, model);
  set_points(model, data);
}

/// Warns of images beside those in use that no file names.
void tell_unnamed(const fs::path& root, const std::string& image_folder,
                  const std::vector<fs::path>& used, const Warnings& warnings) {
  const std::set<fs::path> named = named_images(root, image_folder);
  std::set<fs::path> folders;
  for (const fs::path& path : used) folders.insert(path.parent_path());
  for (const fs::path& folder : folders) {
    std::vector<std::string> others;
    size_t all = 0;
    for (const fs::path& image : imaging::list_images(folder)) {
      const std::string name = image.filename().string();
      // Skip the maps that NeRF's Blender scenes keep beside their test views, and instant-ngp's
      // masks.
      const bool map = name.find("_depth_") != std::string::npos ||
                       name.find("_normal_") != std::string::npos ||
                       name.rfind("dynamic_mask_", 0) == 0;
      if (map || in_small_letters(name) == kMaskFile) continue;
      ++all;
      if (named.count(fs::weakly_canonical(fs::absolute(image))) == 0) others.push_back(name);
    }
    if (others.empty()) continue;
    warnings.add(folder.string(), ": ", others.size(), " of ", all,
                 " images have no pose in transforms.json and are left out: ", listing(others, 3));
  }
}

void tell_unused(const fs::path& root, const TransformsListing& found, const Warnings& warnings) {
  const bool names_masks = std::any_of(found.views.begin(), found.views.end(),
                                       [](const ListedView& view) { return !view.mask.empty(); });
  std::vector<fs::path> read;
  for (const ListedView& view : found.views) read.push_back(view.path);
  UnusedParts unused =
      unused_in_any_layout(root, found.views.front().path.parent_path(), names_masks, read);
  unused.look_for_keys(found.keys, unused_keys());
  unused.look_for_files(root, {{"events*", "events; frames have no exposure times here"},
                               {"events*/", "events; frames have no exposure times here"},
                               {"timestamps.npz", "times of frames"},
                               {"sparse/", "a COLMAP model"}});
  if (!found.main.root.contains("ply_file_path")) {
    unused.look_for_files(root, {{"*.ply", "points that no 'ply_file_path' names"}});
  }
  unused.warn(root, "transforms", warnings);
}

}  // namespace

bool is_transforms(const fs::path& folder) {
  return fs::exists(folder / "transforms.json") || fs::exists(folder / "transforms_train.json");
}

std::vector<fs::path> named_folders(const fs::path& folder) {
  std::set<fs::path> folders;
  for (const fs::path& image : named_images(folder)) folders.insert(image.parent_path());
  return {folders.begin(), folders.end()};
}

Dataset load_transforms(const DatasetOptions& options, const Warnings& warnings) {
  TransformsListing listing = listing_of(options, warnings);
  std::vector<ListedView>& views = listing.views;
  const std::vector<bool>& is_test = listing.is_test;
  Dataset data;
  data.split = listing.rule;
  std::vector<fs::path> paths, masks;
  for (const ListedView& view : views) {
    paths.push_back(view.path);
    masks.push_back(view.mask);
  }
  const std::vector<Frame> frames =
      read_frames(paths, MaskSources(options, masks), warnings, FrameSizes::kAny);
  data.root = options.path;
  std::vector<geometry::Pose> poses;
  for (const ListedView& view : views) poses.push_back(view.pose);
  data.origin = origin_of(poses, {});
  for (size_t i = 0; i < views.size(); ++i) {
    views[i].pose = poses[i] = geometry::with_origin(poses[i], data.origin);
  }
  Undistorter undistorter;
  DoubtfulCameras doubtful;
  std::string scaled;
  for (size_t i = 0; i < views.size(); ++i) {
    torch::Tensor image = frames[i].image, mask = frames[i].mask;
    const geometry::LensCamera fitted = fit_camera(views[i], image.size(2), image.size(1));
    if (scaled.empty()) {
      scaled = scale_note(sized_camera(views[i], image.size(2), image.size(1)), image.size(2),
                          image.size(1), listing.main.path.string());
    }
    doubtful.look(views[i], fitted.pinhole(), image.size(2), image.size(1));
    const geometry::Intrinsics camera =
        undistorter.undistort(fitted, options.path.string(), image, mask);
    if (is_test[i]) {
      data.test.push_back({frames[i].name, image, views[i].pose, camera, SharpView::kNoTime});
      data.test.back().mask = mask;
      continue;
    }
    Exposure exposure;
    exposure.name = frames[i].name;
    exposure.blurry = image;
    exposure.poses.fill(views[i].pose);
    exposure.camera = camera;
    exposure.mask = mask;
    data.train.push_back(std::move(exposure));
  }
  doubtful.tell(listing.main.path, warnings);
  if (!scaled.empty()) data.notes.push_back(scaled);
  undistorter.tell(warnings, data.notes);
  data.undistorted = undistorter.has_undistorted();
  read_points(listing.main, data, warnings);
  tell_unnamed(options.path, options.image_folder, paths, warnings);
  tell_unused(options.path, listing, warnings);
  const DepthBounds bounds = depth_bounds(data.points, poses);
  data.near = bounds.near;
  data.far = bounds.far;
  return data;
}

}  // namespace jade::data
