// SPDX-License-Identifier: Apache-2.0
#include "jade/data/evdeblur.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <optional>
#include <sstream>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/median.h"
#include "jade/core/text.h"
#include "jade/data/bayer.h"
#include "jade/data/colmap_scene.h"
#include "jade/data/event_file.h"
#include "jade/data/frame_times.h"
#include "jade/data/frames.h"
#include "jade/data/llff.h"
#include "jade/data/named_files.h"
#include "jade/data/origin.h"
#include "jade/data/start_points.h"
#include "jade/data/stray_views.h"
#include "jade/data/undistorter.h"
#include "jade/data/unused_parts.h"
#include "jade/imaging/image_io.h"
#include "jade/imaging/unread_images.h"
#include "jade/io/npy.h"
#include "jade/io/text.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

constexpr double kMostGain = 1000;

/// Poses by time; of equal times the last wins.
using TimedPoses = std::map<double, geometry::Pose>;

geometry::Trajectory trajectory_of(const TimedPoses& timed) {
  std::vector<double> times;
  std::vector<geometry::Pose> poses;
  for (const auto& [time, pose] : timed) {
    times.push_back(time);
    poses.push_back(pose);
  }
  return geometry::Trajectory(std::move(times), poses);
}

/// Path of timestamps.npz: with the frames, or beside their folder.
fs::path times_file(const fs::path& root, const fs::path& images) {
  for (const fs::path& path : {images / "timestamps.npz", root / "timestamps.npz"}) {
    if (fs::exists(path)) return path;
  }
  throw DataError(concat((images / "timestamps.npz").string(),
                         ": missing; it must hold timestamps_start and timestamps_end, one each a "
                         "frame",
                         find_colmap_model(root).empty()
                             ? "; frames without times or events need a COLMAP model or "
                               "transforms.json instead of poses_bounds.npy"
                             : "; set dataset.kind colmap to read the frames without times or "
                               "events, by the COLMAP model"));
}

/// Median over the rows of the geometric mean of their depth bounds; 0 if it is undefined.
double typical_depth(const std::vector<LlffView>& views) {
  std::vector<double> depths;
  for (const LlffView& view : views) {
    depths.push_back(view.near > 0 && view.far > 0 ? std::sqrt(view.near * view.far) : 0);
  }
  return median_of(std::move(depths));
}

std::vector<geometry::Pose> poses_of(const std::vector<LlffView>& views) {
  std::vector<geometry::Pose> poses;
  for (const LlffView& view : views) poses.push_back(view.camera_from_world);
  return poses;
}

/// Which rows are not far from all others, and may define a path or the size of the scene.
std::vector<bool> are_near(const std::vector<LlffView>& views) {
  const geometry::CameraRegion region = camera_region(poses_of(views), {}, typical_depth(views));
  std::vector<bool> near;
  for (const LlffView& view : views) {
    near.push_back(region.contains(geometry::centre(view.camera_from_world)));
  }
  return near;
}

/// Warns of rows that are left out of a path, which would bend towards them.
void tell_far(const std::string& file, const std::vector<std::string>& rows,
              const Warnings& warnings) {
  if (rows.empty()) return;
  warnings.add(file, ": expected poses near each other or the scene, found ", rows.size(),
               " far from all others: ", listing(rows),
               "; the path is interpolated between the others; correct or remove them");
}

geometry::Trajectory read_dense(const fs::path& root, events::TimeUnit unit,
                                const geometry::Vector3& origin, const Warnings& warnings) {
  const fs::path pose_file = root / "all_poses_bounds.npy";
  const fs::path time_file = root / "all_timestamps.npy";
  if (!fs::exists(pose_file) && !fs::exists(time_file)) return {};
  if (fs::exists(pose_file) != fs::exists(time_file)) {
    const fs::path& missing = fs::exists(pose_file) ? time_file : pose_file;
    throw DataError(concat(missing.string(),
                           ": missing; a dense trajectory needs "
                           "all_poses_bounds.npy and all_timestamps.npy, or "
                           "remove the other one"));
  }
  const std::vector<LlffView> views = read_llff(pose_file);
  const std::vector<int64_t> times =
      events::times_us(io::read_npy(time_file), unit, time_file.string());
  if (views.size() != times.size()) {
    throw DataError(concat(time_file.string(), ": ", times.size(), " times for ", views.size(),
                           " poses in all_poses_bounds.npy; export both again"));
  }
  if (views.empty()) throw DataError(concat(pose_file.string(), ": holds no pose"));
  TimedPoses timed;
  const std::vector<bool> near = are_near(views);
  std::vector<std::string> far;
  for (size_t i = 0; i < views.size(); ++i) {
    if (near[i]) {
      timed[double(times[i])] = geometry::with_origin(views[i].camera_from_world, origin);
    } else {
      far.push_back(concat("row ", i, " (", times[i], " us)"));
    }
  }
  tell_far(pose_file.string(), far, warnings);
  if (!std::is_sorted(times.begin(), times.end())) {
    warnings.add(time_file.string(), ": times are not in order; poses were sorted by time");
  }
  if (timed.size() + far.size() != times.size()) {
    warnings.add(time_file.string(), ": ", times.size() - far.size() - timed.size(),
                 " times occur more than once; the last pose of each was kept");
  }
  return trajectory_of(timed);
}

struct Sources {
  fs::path images;
  std::vector<fs::path> image_files;
  fs::path time_path;
  std::vector<FrameTime> times;
  events::TimeUnit time_unit;
  std::string times_note;       ///< note about their unit, or empty
  std::vector<LlffView> views;  ///< relative to `origin`
  geometry::Vector3 origin{};   ///< in the files' coordinates
};

/// Warns if rows of times and poses are in the order of names sorted as text.
void warn_of_order(const Sources& s, const Warnings& warnings) {
  if (std::is_sorted(s.image_files.begin(), s.image_files.end())) return;
  warnings.add(
      s.images.string(),
      ": names are not padded with zeros; frames go by their numbers (2 before 10), and so "
      "must the rows of timestamps.npz and poses_bounds.npy");
}

/// Moves the origin near the frames' poses if they are far from that of their files.
void recentre(Sources& s) {
  s.origin = origin_of(poses_of(s.views), {}, typical_depth(s.views));
  if (geometry::is_zero(s.origin)) return;
  for (LlffView& view : s.views) {
    view.camera_from_world = geometry::with_origin(view.camera_from_world, s.origin);
  }
}

Sources read_sources(const DatasetOptions& options, const Warnings& warnings) {
  Sources s;
  s.images = find_image_folder(options.path, options.image_folder);
  s.image_files = imaging::list_images(s.images);
  s.time_path = times_file(options.path, s.images);
  FrameTimes times = read_frame_times(s.time_path, options.time_unit);
  s.times_note = milliseconds_note(times, options.time_unit, s.time_path);
  s.times = std::move(times.frames);
  s.time_unit = times.unit;
  const fs::path pose_path = options.path / "poses_bounds.npy";
  if (!fs::exists(pose_path)) {
    throw DataError(concat(pose_path.string(),
                           ": missing; it must hold one LLFF row of 17 numbers "
                           "a frame"));
  }
  s.views = read_llff(pose_path);
  if (s.image_files.empty())
    throw DataError(
        concat(s.images.string(), ": holds no images", imaging::unread_images(s.images)));
  if (s.times.size() != s.image_files.size() || s.views.size() != s.image_files.size()) {
    throw DataError(concat(options.path.string(), ": ", s.image_files.size(), " images in ",
                           s.images.filename().string(), "/, ", s.times.size(),
                           " times in timestamps.npz and ", s.views.size(),
                           " poses in poses_bounds.npy; there must be one of each per frame"));
  }
  warn_of_order(s, warnings);
  std::vector<std::string> names;
  for (const fs::path& file : s.image_files) names.push_back(file.filename().string());
  check_apart(s.times, names, s.time_path.string(), warnings);
  recentre(s);
  return s;
}

/// How much larger the images are than the size for which poses_bounds.npy was made, which is
/// noted.
/// @throws DataError if the two sizes have another shape.
double resized_by(const Sources& s, const events::ImageSize& image, const Warnings& warnings,
                  std::vector<std::string>& notes) {
  constexpr double kCropped = 0.02;  // a few rows or columns
  const double scale = folder_scale(s.images);
  const double width = s.views.front().width / scale, height = s.views.front().height / scale;
  const double right = double(image.width), bottom = double(image.height);
  if (std::abs(width - right) <= 1 && std::abs(height - bottom) <= 1) return 1;
  const std::string what = concat("poses_bounds.npy: made for images of ", width, "x", height,
                                  " while these are ", image.width, "x", image.height);
  if (!(width > 0 && height > 0)) {
    warnings.add(what, "; the focal length is used as it is");
    return 1;
  }
  const double ratio = std::sqrt(right * bottom / (width * height));
  if (std::abs(ratio * width - right) <= 1 && std::abs(ratio * height - bottom) <= 1) {
    notes.push_back(concat(what, "; the focal length is scaled by ", ratio));
    return ratio;
  }
  if (std::abs(width - right) <= kCropped * width &&
      std::abs(height - bottom) <= kCropped * height) {
    warnings.add(what, "; the focal length is used as it is");
    return 1;
  }
  throw DataError(concat((s.images.parent_path() / "poses_bounds.npy").string(), ": expected the ",
                         "size of the images or a scaled one, found ", width, "x", height,
                         " for images of ", image.width, "x", image.height,
                         width == bottom && height == right
                             ? "; exchange height and width in its fifth column"
                             : "; export the poses again for these images"));
}

geometry::Intrinsics camera_of(const Sources& s, const torch::Tensor& image,
                               const Warnings& warnings, std::vector<std::string>& notes) {
  const int64_t height = image.size(1);
  const int64_t width = image.size(2);
  const double scale = folder_scale(s.images);
  const LlffView& view = s.views.front();
  if (!(view.focal_px > 0)) {
    throw DataError(concat(s.images.parent_path().string(), "/poses_bounds.npy: focal length ",
                           view.focal_px, " px; write it as the fifth number of the third line"));
  }
  const auto other = std::find_if(s.views.begin(), s.views.end(), [&](const LlffView& each) {
    return std::abs(each.width - view.width) > 1 || std::abs(each.height - view.height) > 1;
  });
  if (other != s.views.end()) {
    warnings.add((s.images.parent_path() / "poses_bounds.npy").string(),
                 ": expected one image size in all rows, found ", view.width, "x", view.height,
                 " in row 0 and ", other->width, "x", other->height, " in row ",
                 other - s.views.begin(), "; size and focal length of row 0 are used for all ",
                 "frames; export the poses again");
  }
  for (size_t i = 1; i < s.views.size() && other == s.views.end(); ++i) {
    if (std::abs(s.views[i].focal_px - view.focal_px) > 1e-6 * view.focal_px) {
      warnings.add("poses_bounds.npy: focal lengths differ (", view.focal_px, " and ",
                   s.views[i].focal_px, " px); the first is used for all frames");
      break;
    }
  }
  const double resized = resized_by(s, {height, width}, warnings, notes);
  const auto camera = geometry::Intrinsics::centred(view.focal_px / scale * resized, width, height);
  check_plausible(camera, concat(s.images.parent_path().string(), "/poses_bounds.npy"));
  return camera;
}

/// Warns if exposures lie beyond the ends of the trajectory, where poses stay constant.
void check_covered(const geometry::Trajectory& path, const FrameTime& time, const std::string& name,
                   const Warnings& warnings) {
  const double missing =
      std::max({path.begin_us() - double(time.start_us), double(time.end_us) - path.end_us(), 0.0});
  if (missing == 0) return;
  const double length = double(time.end_us - time.start_us);
  if (missing >= 0.5 * length) {
    throw DataError(concat("exposure ", name, " [", time.start_us, ", ", time.end_us,
                           "] us lies outside the trajectory of all_timestamps.npy [",
                           path.begin_us(), ", ", path.end_us(),
                           "] us; its poses are missing, or dataset.time_unit is wrong"));
  }
  warnings.add("exposure ", name, ": the trajectory ends ", missing,
               " us short of it; poses are constant there");
}

/// Checks that the frames' own poses and the trajectory belong to one camera.
void check_agreement(const geometry::Trajectory& path, const Sources& s, const Warnings& warnings) {
  double span = 0;
  const auto first = geometry::centre(path.at(path.begin_us()));
  for (const double time : path.times_us()) {
    const auto c = geometry::centre(path.at(time));
    span = std::max(span, std::hypot(c[0] - first[0], c[1] - first[1], c[2] - first[2]));
  }
  for (size_t i = 0; i < s.views.size(); ++i) {
    const double mid = 0.5 * (double(s.times[i].start_us) + double(s.times[i].end_us));
    const geometry::Pose expected = path.at(mid);
    const auto a = geometry::centre(expected);
    const auto b = geometry::centre(s.views[i].camera_from_world);
    const double distance = std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
    const double angle = geometry::rotation_angle(expected, s.views[i].camera_from_world);
    if (distance <= 0.05 * span + 1e-9 && angle <= 0.05) continue;
    warnings.add("poses_bounds.npy: row ", i, " is ", distance, " units and ", angle,
                 " rad away from all_poses_bounds.npy at its time; the two may be of different "
                 "coordinates or times");
    return;
  }
}

/// A path through the poses of the frames, each at its mid-exposure, extended to cover the first
/// and last exposure. Poses far from all others are left out.
geometry::Trajectory path_through_frames(const Sources& s, const Warnings& warnings) {
  TimedPoses timed;
  std::vector<std::string> far;
  const std::vector<bool> near = are_near(s.views);
  double first = INFINITY;
  double last = -INFINITY;
  for (size_t i = 0; i < s.views.size(); ++i) {
    const FrameTime& time = s.times[i];
    const double mid = 0.5 * (double(time.start_us) + double(time.end_us));
    if (near[i]) timed[mid] = s.views[i].camera_from_world;
    if (!near[i]) far.push_back(s.image_files[i].stem().string());
    first = std::min(first, double(time.start_us));
    last = std::max(last, double(time.end_us));
  }
  tell_far("poses_bounds.npy", far, warnings);
  return trajectory_of(timed).spanning(first, last);
}

geometry::Trajectory choose_path(const DatasetOptions& options, const Sources& s, Dataset& data,
                                 const Warnings& warnings) {
  data.trajectory = read_dense(options.path, s.time_unit, s.origin, warnings);
  if (!data.trajectory.empty()) {
    check_agreement(data.trajectory, s, warnings);
    return data.trajectory;
  }
  warnings.add(options.path.string(),
               ": no dense trajectory (all_poses_bounds.npy and "
               "all_timestamps.npy); the nine poses of each exposure are "
               "interpolated between the poses of the frames");
  return path_through_frames(s, warnings);
}

void add_frames(const Sources& s, std::vector<Frame> frames, const Split& split,
                const geometry::Trajectory& path, const Warnings& warnings, Dataset& data) {
  const geometry::Intrinsics camera = camera_of(s, frames.front().image, warnings, data.notes);
  for (size_t i = 0; i < frames.size(); ++i) {
    const FrameTime& time = s.times[i];
    if (split.is_test[i]) {
      data.test.push_back(
          {frames[i].name, frames[i].image, s.views[i].camera_from_world, camera, time.mid_us()});
      data.test.back().mask = frames[i].mask;
      continue;
    }
    check_covered(path, time, frames[i].name, warnings);
    Exposure exposure;
    exposure.name = frames[i].name;
    exposure.blurry = frames[i].image;
    exposure.mask = frames[i].mask;
    exposure.t_start_us = time.start_us;
    exposure.t_end_us = time.end_us;
    exposure.poses = path.exposure_poses(time.start_us, time.end_us);
    exposure.camera = camera;
    data.train.push_back(std::move(exposure));
  }
  std::stable_sort(data.train.begin(), data.train.end(), [](const Exposure& a, const Exposure& b) {
    return a.t_start_us < b.t_start_us;
  });
}

void set_bounds(const Sources& s, Dataset& data) {
  data.near = INFINITY;
  data.far = 0;
  const std::vector<bool> near = are_near(s.views);
  for (size_t i = 0; i < s.views.size(); ++i) {
    if (!near[i]) continue;
    data.near = std::min(data.near, s.views[i].near);
    data.far = std::max(data.far, s.views[i].far);
  }
  if (data.near > 0 && data.far > data.near) return;
  throw DataError(concat((data.root / "poses_bounds.npy").string(), ": depth bounds ", data.near,
                         " to ", data.far, "; expected 0 < near < far in the last two columns"));
}

/// Reads the points from structure from motion.
void read_points(const fs::path& path, const Warnings& warnings, Dataset& data) {
  if (!fs::exists(path)) return;
  const io::Npz file(path);
  torch::Tensor points = file.read("points"), colors = file.read("colors");
  const bool shaped = points.dim() == 2 && points.size(1) == 3 && points.sizes() == colors.sizes();
  if (!shaped || !points.is_floating_point() || colors.scalar_type() != torch::kUInt8) {
    throw DataError(concat(path.string(),
                           ": expected points [P,3] of a floating type and colors [P,3] uint8, "
                           "found other shapes or types; remove the file or write it again"));
  }
  drop_absurd_points(path.string(), warnings, points, colors);
  if (points.size(0) == 0) return;
  data.points = (geometry::is_zero(data.origin) ? points : with_origin(points, data.origin))
                    .to(torch::kFloat32);
  data.point_colors = colors.to(torch::kFloat32) / 255;
}

/// Reads lines "name,gain", the first of which may be a header: the brightness of each frame
/// relative to the scene.
void read_gains(const fs::path& path, const Warnings& warnings, Dataset& data) {
  if (!fs::exists(path)) return;
  std::map<std::string, double> gains;
  std::istringstream text(io::read_text(path));
  int64_t number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const auto comma = line.rfind(',');
    double gain = 0;
    if (comma != std::string::npos) {
      char* end = nullptr;
      gain = std::strtod(line.c_str() + comma + 1, &end);
      if (number == 1 && end == line.c_str() + comma + 1) continue;
      if (number == 1) {
        warnings.add(path.string(), ": expected the first line \"name,gain\", found '", line,
                     "'; it is read as the gain of a frame");
      }
    }
    if (!(gain > 0 && gain < kMostGain)) {
      throw DataError(concat(path.string(), ":", number,
                             ": expected \"name,gain\" with a gain between 0 and ", kMostGain,
                             ", found '", line, "'; correct the line or remove the file"));
    }
    if (!gains.emplace(line.substr(0, comma), gain).second) {
      throw DataError(concat(path.string(), ":", number, ": expected one gain per frame, found '",
                             line.substr(0, comma), "' again; remove one of the lines"));
    }
  }
  std::vector<std::string> without, respelled;
  const auto set = [&](auto& frame) {
    std::vector<std::string> names;
    for (const auto& [name, gain] : gains) names.push_back(name);
    const std::optional<size_t> place = place_of(frame.name, names);
    if (!place) {
      without.push_back(frame.name);
      return;
    }
    const auto found = gains.find(names[*place]);
    if (found->first != frame.name) respelled.push_back(found->first);
    frame.gain = found->second;
    gains.erase(found);
  };
  for (Exposure& exposure : data.train) set(exposure);
  for (SharpView& view : data.test) set(view);
  tell_respelled(path, respelled, warnings);
  if (!without.empty() && gains.empty()) {
    warnings.add(path.string(), ": expected a gain for each frame, found none for ",
                 listing(without, 3), ", which get a gain of 1; add their lines");
  }
  if (gains.empty()) return;
  throw DataError(concat(path.string(), ": expected names of frames, found '", gains.begin()->first,
                         "'; correct the line or remove the file"));
}

/// Warns of LLFF's own files and other files of event recordings that are not used.
void tell_unused(const fs::path& root, const fs::path& frames, const Warnings& warnings) {
  UnusedParts unused = unused_in_any_layout(root, frames);
  unused.look_for_files(root, {{"poses_bounds_*.npy", "other poses"},
                               {"hold=*", "a split; dataset.split chooses the test views"},
                               {"transforms*.json", "other poses"},
                               {"intrinsics*", "a camera; that of poses_bounds.npy is used"},
                               {"calib*", "a camera; that of poses_bounds.npy is used"},
                               {"K1.txt", "a camera; that of poses_bounds.npy is used"},
                               {"events_*.h5", "another stream of events"}});
  unused.warn(root, "evdeblur", warnings);
}

}  // namespace

namespace {

/// Whether a folder, or one in it, has the times of frames.
bool has_times(const fs::path& folder) {
  if (fs::exists(folder / "timestamps.npz")) return true;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    if (fs::exists(entry->path() / "timestamps.npz", ignored)) return true;
  }
  return false;
}

}  // namespace

bool is_evdeblur(const fs::path& folder) {
  if (fs::exists(folder / "poses_bounds.npy")) {
    // Scenes of Deblur-NeRF have neither times nor events, but a COLMAP model.
    DatasetOptions options;
    options.path = folder;
    return has_times(folder) || !find_event_file(options).empty() ||
           fs::exists(folder / "all_timestamps.npy") || find_colmap_model(folder).empty();
  }
  for (const char* images : {"images_1", "images"}) {
    if (fs::exists(folder / images / "timestamps.npz")) return true;
  }
  return false;
}

Dataset load_evdeblur(const DatasetOptions& options, const Warnings& warnings) {
  const Sources s = read_sources(options, warnings);
  // An import without sharp frames holds out exposures instead.
  const bool holds_out =
      options.split == SplitKind::kAuto && fs::exists(options.path / kHeldOutFile);
  const Split split =
      split_frames(s.times, {options.split, options.test_last, options.test_every, ""},
                   s.time_path.string(), holds_out ? Warnings(nullptr) : warnings);
  tell_unused(options.path, s.images, warnings);
  Dataset data;
  data.root = options.path;
  data.origin = s.origin;
  data.split = split.rule;
  if (!s.times_note.empty()) data.notes.push_back(s.times_note);
  set_bounds(s, data);
  const geometry::Trajectory path = choose_path(options, s, data, warnings);
  add_frames(s, read_frames(s.image_files, MaskSources(options), warnings), split, path, warnings,
             data);

  EventSpan span{data.train.front().t_start_us, data.train.front().t_end_us};
  for (const Exposure& exposure : data.train) {
    span.end_us = std::max(span.end_us, exposure.t_end_us);
  }
  EventSpan keep;
  if (!data.trajectory.empty()) {
    keep = {static_cast<int64_t>(data.trajectory.begin_us()),
            static_cast<int64_t>(data.trajectory.end_us())};
  }
  attach_events(options, span, keep, warnings, data);
  read_points(options.path / "points.npz", warnings, data);
  read_gains(options.path / kGainFile, warnings, data);
  const fs::path color_map = options.path / "ev_map.npz";
  if (options.color_events && fs::exists(color_map)) {
    const geometry::Intrinsics& camera = data.train.front().camera;
    data.event_color = read_event_color_map(color_map, camera.height, camera.width, warnings);
  }
  return data;
}

}  // namespace jade::data
