// SPDX-License-Identifier: Apache-2.0
#include "jade/data/diet_gs.h"

#include <algorithm>
#include <map>
#include <regex>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/data/colmap_scene.h"
#include "jade/data/event_file.h"
#include "jade/data/frame_times.h"
#include "jade/data/frames.h"
#include "jade/data/named_files.h"
#include "jade/data/undistorter.h"
#include "jade/data/unused_parts.h"
#include "jade/imaging/image_io.h"
#include "jade/io/npy.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using geometry::kExposurePoses;

/// The views of the model, sorted by the role that their names give.
struct NamedViews {
  std::map<int64_t, std::map<int64_t, const io::ColmapImage*>> moving;  ///< frame → pose
  std::map<int64_t, const io::ColmapImage*> sharp;                      ///< i of GT<i>
};

NamedViews sort_by_name(const io::ColmapModel& model, const std::string& where) {
  static const std::regex moving(R"((\d{1,9})_(\d)(\..*)?)");
  static const std::regex sharp(R"(GT(\d{1,9})(\..*)?)");
  NamedViews views;
  for (const io::ColmapImage& image : model.images) {
    const std::string name = fs::path(slashed(image.name)).filename().string();
    std::smatch match;
    bool fresh = true;
    if (std::regex_match(name, match, moving) && std::stoi(match[2]) < kExposurePoses) {
      fresh = views.moving[std::stoll(match[1])].emplace(std::stoll(match[2]), &image).second;
    } else if (std::regex_match(name, match, sharp)) {
      fresh = views.sharp.emplace(std::stoll(match[1]), &image).second;
    } else {
      throw DataError(concat(where, ": image '", name,
                             "' is neither <frame>_<pose> nor GT<i>; "
                             "for a set of sharp images set "
                             "dataset.kind to colmap"));
    }
    if (!fresh) throw DataError(concat(where, ": two images are named '", name, "'"));
  }
  return views;
}

/// Every frame 0 to N−1 must have all its poses.
void check_complete(const NamedViews& views, const std::string& where) {
  int64_t expected = 0;
  for (const auto& [frame, poses] : views.moving) {
    if (frame != expected) {
      throw DataError(concat(where, ": frame ", expected,
                             " has no pose; COLMAP could not place its "
                             "images, run it again on all of them"));
    }
    ++expected;
    if (int64_t(poses.size()) == kExposurePoses) continue;
    std::vector<std::string> missing;
    for (int64_t k = 0; k < kExposurePoses; ++k) {
      if (poses.count(k) == 0) missing.push_back(concat(frame, "_", k));
    }
    throw DataError(concat(where, ": frame ", frame, " has ", poses.size(), " of 9 poses; missing ",
                           listing(missing), "; COLMAP could not place them, run it again"));
  }
  if (expected == 0) throw DataError(concat(where, ": no image is named <frame>_<pose>"));
}

/// Sharp views are the images after the last frame of the model. If COLMAP placed none of the last
/// frames, or the folder has other images, they would be the wrong ones.
void tell_unused(const NamedViews& views, int64_t files, int64_t windows, const fs::path& folder,
                 const Warnings& warnings) {
  if (views.sharp.empty()) return;
  const auto frames = int64_t(views.moving.size());
  const int64_t sharp = views.sharp.rbegin()->first + 1;
  if (windows == frames && files == frames + sharp) return;
  warnings.add(folder.string(), ": expected ", frames, " frames and then ", sharp,
               " sharp views, as in the model, found ", files, " images, and exposure times of ",
               windows, " frames; if the model lacks the last frames, or some images are neither, ",
               "sharp views have wrong images: run COLMAP again on all, or remove the others");
}

fs::path converted_file(const fs::path& root, const std::string& name) {
  const fs::path path = root / "events" / name;
  if (fs::exists(path)) return path;
  throw DataError(concat(path.string(),
                         ": missing; make it from the published pickles with "
                         "scripts/convert_diet_gs.py ",
                         root.string()));
}

torch::Tensor read_color_map(const fs::path& path, int64_t height, int64_t width) {
  const torch::Tensor map = io::read_npy(path);
  if (map.dim() == 3 && map.size(0) == 3 && map.size(1) == height && map.size(2) == width) {
    return map != 0;
  }
  throw DataError(concat(path.string(), ": expected [3, ", height, ", ", width, "], found ",
                         map.sizes(), "; run scripts/convert_diet_gs.py again"));
}

void add_exposures(const NamedViews& views, const io::ColmapModel& model,
                   const std::vector<Frame>& frames, const std::vector<FrameTime>& times,
                   const Warnings& warnings, Dataset& data) {
  const int64_t height = frames.front().image.size(1);
  const int64_t width = frames.front().image.size(2);
  Undistorter undistorter;
  for (const auto& [frame, poses] : views.moving) {
    Exposure exposure;
    exposure.name = frames[size_t(frame)].name;
    exposure.blurry = frames[size_t(frame)].image;
    exposure.mask = frames[size_t(frame)].mask;
    exposure.t_start_us = times[size_t(frame)].start_us;
    exposure.t_end_us = times[size_t(frame)].end_us;
    const io::ColmapCamera& listed = model.camera(poses.at(0)->camera_id);
    exposure.camera = undistorter.undistort(lens_camera_of(listed, width, height), name_of(listed),
                                            exposure.blurry, exposure.mask);
    for (const auto& [k, image] : poses) exposure.poses[size_t(k)] = pose_of(*image);
    data.train.push_back(std::move(exposure));
  }
  const size_t count = views.moving.size();
  for (const auto& [i, image] : views.sharp) {
    const Frame& frame = frames[count + size_t(i)];
    const io::ColmapCamera& listed = model.camera(image->camera_id);
    SharpView view{frame.name, frame.image, pose_of(*image), {}, SharpView::kNoTime};
    view.mask = frame.mask;
    view.camera = undistorter.undistort(lens_camera_of(listed, width, height), name_of(listed),
                                        view.image, view.mask);
    data.test.push_back(std::move(view));
  }
  undistorter.tell(warnings, data.notes);
  data.undistorted = undistorter.has_undistorted();
}

}  // namespace

bool is_diet_gs(const fs::path& folder) {
  const fs::path model = find_colmap_model(folder);
  if (model.empty()) return false;
  if (fs::exists(folder / "events")) return true;
  const std::vector<io::ColmapImage> images = io::read_colmap(model).images;
  for (const io::ColmapImage& image : images) {
    const std::string name = fs::path(slashed(image.name)).filename().string();
    if (name.rfind("GT", 0) != 0 && !std::regex_match(name, std::regex(R"(\d+_\d(\..*)?)"))) {
      return false;
    }
  }
  return !images.empty();  // a model without names has no role
}

Dataset load_diet_gs(const DatasetOptions& options, const Warnings& warnings) {
  const fs::path folder = find_colmap_model(options.path);
  if (folder.empty()) {
    throw DataError(concat(options.path.string(),
                           ": expected a COLMAP model (sparse/0 with cameras and images, .bin or "
                           ".txt), found none"));
  }
  tell_other_models(folder, warnings);
  io::ColmapModel model = io::read_colmap(folder);
  find_points(folder, warnings, model);
  const geometry::Vector3 origin = recentre(model);
  NamedViews views = sort_by_name(model, folder.string());
  check_complete(views, folder.string());
  if (options.split == SplitKind::kNone) views.sharp.clear();
  const int64_t count = int64_t(views.moving.size());

  const fs::path image_folder = find_image_folder(options.path, options.image_folder);
  const std::vector<fs::path> files = imaging::list_images(image_folder);
  const int64_t needed = count + (views.sharp.empty() ? 0 : views.sharp.rbegin()->first + 1);
  if (int64_t(files.size()) < needed) {
    throw DataError(concat(image_folder.string(), ": ", files.size(), " images, but the model has ",
                           count, " frames and ", views.sharp.size(), " sharp views, so ", needed,
                           " are needed; copy the folder again"));
  }
  const fs::path time_path = converted_file(options.path, "timestamps.npz");
  FrameTimes read_times = read_frame_times(time_path, options.time_unit);
  const std::string times_note = milliseconds_note(read_times, options.time_unit, time_path);
  std::vector<FrameTime> times = std::move(read_times.frames);
  if (int64_t(times.size()) < count) {
    throw DataError(concat(time_path.string(), ": ", times.size(), " windows for ", count,
                           " frames; run scripts/convert_diet_gs.py again"));
  }
  tell_unused(views, int64_t(files.size()), int64_t(times.size()), image_folder, warnings);
  times.resize(size_t(count));
  std::vector<std::string> names;
  for (const fs::path& file : files) names.push_back(file.filename().string());
  check_apart(times, names, time_path.string(), warnings);
  converted_file(options.path, "events.h5");
  UnusedParts unused = unused_in_any_layout(options.path, image_folder);
  unused.look_for_files(options.path, {{"poses_bounds*.npy", "other poses"},
                                       {"hold=*", "a split; views named GT<i> are the test views"},
                                       {"transforms*.json", "other poses"}});
  unused.warn(options.path, "diet_gs", warnings);

  Dataset data;
  data.root = options.path;
  data.origin = origin;
  data.split = concat(views.sharp.size(), " views named GT<i>");
  if (!times_note.empty()) data.notes.push_back(times_note);
  add_exposures(views, model, read_frames(files, MaskSources(options), warnings), times, warnings,
                data);
  set_points(model, data);
  std::vector<geometry::Pose> poses;
  EventSpan span{data.train.front().t_start_us, data.train.front().t_end_us};
  for (const Exposure& exposure : data.train) {
    poses.insert(poses.end(), exposure.poses.begin(), exposure.poses.end());
    span.begin_us = std::min(span.begin_us, exposure.t_start_us);
    span.end_us = std::max(span.end_us, exposure.t_end_us);
    if (exposure.duration_us() == 0) {
      throw DataError(
          concat(time_path.string(), ": frame ", exposure.name, " has no exposure time"));
    }
  }
  const DepthBounds bounds = depth_bounds(data.points, poses);
  data.near = bounds.near;
  data.far = bounds.far;
  attach_events(options, span, {}, warnings, data);
  const fs::path color_map = options.path / "events" / "color_map.npy";
  if (options.color_events && fs::exists(color_map)) {
    const geometry::Intrinsics& camera = data.train.front().camera;
    data.event_color = read_color_map(color_map, camera.height, camera.width);
  }
  const geometry::Intrinsics& size = data.train.front().camera;
  undistort_events(lens_camera_of(model.camera(views.moving.begin()->second.at(0)->camera_id),
                                  size.width, size.height),
                   data);
  return data;
}

}  // namespace jade::data
