// SPDX-License-Identifier: Apache-2.0
#include "jade/data/dataset.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <set>
#include <sstream>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/data/colmap_scene.h"
#include "jade/data/diet_gs.h"
#include "jade/data/evdeblur.h"
#include "jade/data/event_file.h"
#include "jade/data/frame_times.h"
#include "jade/data/frames.h"
#include "jade/data/masks.h"
#include "jade/data/named_files.h"
#include "jade/data/origin.h"
#include "jade/data/start_points.h"
#include "jade/data/stray_views.h"
#include "jade/data/transforms.h"
#include "jade/data/warnings.h"
#include "jade/imaging/color.h"
#include "jade/io/text.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

void check_folder(const fs::path& folder) {
  if (folder.empty()) throw ConfigError("dataset.path is not set; give the folder of the data set");
  if (fs::is_directory(folder)) return;
  throw DataError(concat(folder.string(),
                         fs::exists(folder) ? ": is a file; " : ": no such folder; ",
                         "give the folder of a data set"));
}

struct NamedFrame {
  const std::string& name;
  torch::Tensor& image;
};

std::vector<NamedFrame> frames_of(Dataset& data) {
  std::vector<NamedFrame> frames;
  for (Exposure& exposure : data.train) frames.push_back({exposure.name, exposure.blurry});
  for (Exposure& exposure : data.held_out) frames.push_back({exposure.name, exposure.blurry});
  for (SharpView& view : data.test) frames.push_back({view.name, view.image});
  return frames;
}

/// Warns of gray frames among coloured ones; black frames may be either.
void warn_of_gray(const std::vector<NamedFrame>& frames, const std::vector<bool>& is_gray,
                  const fs::path& root, const Warnings& warnings) {
  size_t count = 0;
  std::string first;
  for (size_t i = 0; i < frames.size(); ++i) {
    if (!is_gray[i] || !frames[i].image.any().item<bool>()) continue;
    if (count++ == 0) first = frames[i].name;
  }
  if (count == 0) return;
  warnings.add(root.string(), ": expected all frames in colour or all gray, found ", count, " of ",
               frames.size(), " gray (the first is ", first,
               "), which would fade the scene's colours; export them in colour, or set "
               "dataset.color to gray");
}

/// Sets whether the data set is monochrome, and converts it if `color` is gray.
void settle_color(FrameColor color, const Warnings& warnings, Dataset& data) {
  const std::vector<NamedFrame> frames = frames_of(data);
  data.monochrome = color == FrameColor::kGray;
  if (color == FrameColor::kAuto) {
    std::vector<bool> is_gray;
    for (const NamedFrame& frame : frames) is_gray.push_back(imaging::is_gray(frame.image));
    data.monochrome =
        !frames.empty() && std::find(is_gray.begin(), is_gray.end(), false) == is_gray.end();
    if (!data.monochrome) warn_of_gray(frames, is_gray, data.root, warnings);
  }
  if (!data.monochrome) return;
  for (const NamedFrame& frame : frames) frame.image = imaging::as_gray(frame.image);
  if (!data.event_color.defined()) return;
  data.event_color = torch::Tensor();
  warnings.add(data.root.string(),
               ": the frames are gray, so the colour filter of the events (ev_map.npz or "
               "color_map.npy) is not used; dataset.color_events false leaves it unread");
}

/// The names in held_out.txt; empty without the file.
std::vector<std::string> held_out_names(const fs::path& path) {
  std::vector<std::string> names;
  if (!fs::exists(path)) return names;
  std::istringstream lines(io::read_text(path));
  for (std::string line; std::getline(lines, line);) {
    while (!line.empty() && std::isspace(static_cast<unsigned char>(line.back())) != 0) {
      line.pop_back();
    }
    if (!line.empty()) names.push_back(line);
  }
  return names;
}

/// Moves the exposures that the folder names from training to held_out.
void hold_out(const Warnings& warnings, Dataset& data) {
  const fs::path path = data.root / kHeldOutFile;
  std::vector<std::string> respelled;
  for (const std::string& name : held_out_names(path)) {
    std::vector<std::string> names;
    for (const Exposure& exposure : data.train) names.push_back(exposure.name);
    const std::optional<size_t> place = place_of(name, names);
    if (!place) {
      throw DataError(concat(path.string(), ": expected names of training exposures, found '", name,
                             "'; correct or remove the line"));
    }
    if (names[*place] != name) respelled.push_back(name);
    const auto found = data.train.begin() + std::ptrdiff_t(*place);
    data.held_out.push_back(std::move(*found));
    data.train.erase(found);
  }
  tell_respelled(path, respelled, warnings);
  if (!data.held_out.empty() && data.train.empty()) {
    throw DataError(
        concat(path.string(), ": holds out every exposure; leave at least one for training"));
  }
}

/// Name of the folder, also for "scene/." and "scene/".
std::string folder_name(const fs::path& folder) {
  const fs::path whole = fs::absolute(folder).lexically_normal();
  return whole.has_filename() ? whole.filename().string() : whole.parent_path().filename().string();
}

/// Uses the tolerances of is_seen.
bool same_place(const geometry::Pose& a, const geometry::Pose& b, double near) {
  const auto p = geometry::centre(a), q = geometry::centre(b);
  return geometry::rotation_angle(a, b) <= 1e-3 &&
         std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]) <= 1e-3 * near;
}

std::optional<DatasetKind> found_kind(const fs::path& folder) {
  if (is_evdeblur(folder)) return DatasetKind::kEvDeblur;
  if (is_transforms(folder)) return DatasetKind::kTransforms;
  if (is_diet_gs(folder)) return DatasetKind::kDietGs;
  if (!find_colmap_model(folder).empty()) return DatasetKind::kColmap;
  return std::nullopt;
}

/// Warns of principal points far from the middle of the image: the camera is of images of another
/// size, or they were cropped.
void tell_off_centre(const fs::path& path, const Dataset& data, const Warnings& warnings) {
  constexpr double kMost = 0.2;  // of the side
  const auto is_off = [](double place, int64_t size) {
    return std::abs(place - 0.5 * double(size)) > kMost * double(size);
  };
  const geometry::Intrinsics* first = nullptr;
  size_t count = 0;
  for (const Exposure& exposure : data.train) {
    const geometry::Intrinsics& camera = exposure.camera;
    if (!is_off(camera.cx, camera.width) && !is_off(camera.cy, camera.height)) continue;
    if (count++ == 0) first = &camera;
  }
  if (count == 0) return;
  warnings.add(path.string(), ": expected principal points near the middle of the images, found (",
               first->cx, ", ", first->cy, ") px in ", first->width, "x", first->height, " px for ",
               count, " of ", data.train.size(), " frames; if the images are not cropped, correct ",
               "the principal point or give the image size that was calibrated");
}

}  // namespace

bool is_mid_exposure(const Exposure& exposure, const SharpView& view) {
  if (!view.has_time() || exposure.duration_us() == 0) return false;
  const double away =
      std::abs(double(view.t_us) - 0.5 * (double(exposure.t_start_us) + double(exposure.t_end_us)));
  return away <= double(exposure.duration_us()) / 16;
}

int64_t exposure_of(const Dataset& dataset, const SharpView& view) {
  for (size_t i = 0; i < dataset.train.size(); ++i) {
    if (is_mid_exposure(dataset.train[i], view)) return static_cast<int64_t>(i);
  }
  return -1;
}

std::optional<bool> is_seen(const Dataset& dataset, const SharpView& view) {
  const auto any_exposure = [&](const auto& holds) {
    return std::any_of(dataset.train.begin(), dataset.train.end(), holds);
  };
  if (view.has_time()) {
    return any_exposure([&](const Exposure& exposure) {
      return exposure.t_start_us <= view.t_us && view.t_us <= exposure.t_end_us;
    });
  }
  const bool posed_alike = any_exposure([&](const Exposure& exposure) {
    return std::any_of(exposure.poses.begin(), exposure.poses.end(),
                       [&](const auto& pose) { return same_place(pose, view.pose, dataset.near); });
  });
  if (posed_alike) return true;
  const bool moving =
      any_exposure([](const Exposure& exposure) { return exposure.duration_us() > 0; });
  return moving ? std::nullopt : std::optional<bool>(false);
}

namespace {

/// The flag with which a COLMAP model without images beside it can be read, as of dense/ and
/// distorted/ below `root`, which has the images; empty if it needs none.
std::string image_flag(const fs::path& model, const fs::path& root) {
  const auto images_in = [](const fs::path& folder) {
    try {
      return find_image_folder(folder, "", ImageDepth::kNested);
    } catch (const DataError&) {
      return fs::path();
    }
  };
  if (found_kind(model) != DatasetKind::kColmap || !images_in(model).empty()) return "";
  fs::path images = images_in(root);
  if (images.empty() && fs::is_directory(root / "input")) images = root / "input";  // of 3DGS
  return concat(", and its images with --set dataset.image_folder=",
                images.empty() ? "FOLDER" : images.lexically_relative(model).string());
}

}  // namespace

std::string other_finding(const fs::path& folder) {
  constexpr int kDepth = 2;
  std::set<fs::path> below;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    const std::string name = entry->path().filename().string();
    if (entry.depth() + 1 == kDepth || name[0] == '.') entry.disable_recursion_pending();
    if (name[0] == '.' || !entry->is_directory(ignored) || !found_kind(entry->path())) continue;
    below.insert(entry->path());
    entry.disable_recursion_pending();
  }
  if (!below.empty()) {
    const auto whole = std::find_if(below.begin(), below.end(), [&](const fs::path& found) {
      return image_flag(found, folder).empty();
    });
    const fs::path& one = whole == below.end() ? *below.begin() : *whole;
    return concat("; ", one.string(), " is one",
                  below.size() == 1 ? "" : concat(", like ", below.size() - 1, " more folders"),
                  ": give that folder", image_flag(one, folder));
  }
  for (const char* foreign : {"cameras.xml", "bundle.out", "bundle.rd.out", "model.nvm",
                              "scene.mvs", "reconstruction.json"}) {
    if (fs::is_regular_file(folder / foreign)) {
      return concat("; ", foreign, " is not read: export the cameras from its program for COLMAP");
    }
  }
  return "";
}

namespace {

/// Mean of a frame over the pixels that count.
double brightness(const Exposure& exposure) {
  if (!exposure.mask.defined()) return exposure.blurry.mean().item<double>();
  return exposure.blurry.masked_select(exposure.mask).mean().item<double>();
}

/// Warns of frames that are much darker or brighter than both that are beside them in time, unless
/// the data set says the gain of each frame.
void tell_odd_brightness(const Warnings& warnings, const Dataset& data) {
  constexpr double kDarkest = 0.6;  // relative to both others
  if (data.kind == DatasetKind::kEvDeblur && fs::is_regular_file(data.root / kGainFile)) return;
  std::vector<const Exposure*> frames;
  for (const Exposure& exposure : data.train) frames.push_back(&exposure);
  if (frames.size() < 3) return;
  std::stable_sort(frames.begin(), frames.end(), [](const Exposure* a, const Exposure* b) {
    return a->t_start_us < b->t_start_us;
  });
  std::vector<double> means;
  for (const Exposure* const frame : frames) means.push_back(brightness(*frame));
  std::vector<std::string> odd;
  for (size_t i = 0; i < means.size(); ++i) {
    const size_t a = i > 0 ? i - 1 : 2, b = i + 1 < means.size() ? i + 1 : i - 2;
    const double over_a = means[i] / means[a], over_b = means[i] / means[b];
    const bool dark = std::max(over_a, over_b) < kDarkest;
    const bool bright = std::min(over_a, over_b) > 1 / kDarkest;
    if (dark || bright) {
      odd.push_back(concat(frames[i]->name, " is ", 0.01 * std::round(100 * over_a),
                           " times as bright as ", frames[a]->name));
    }
  }
  if (odd.empty()) return;
  warnings.add(data.root.string(), ": expected frames of one brightness, found ", odd.size(),
               " of ", frames.size(), " unlike those beside them (", listing(odd),
               "); unless gains.optimize is on, set it, or give the frames' gains in gains.csv");
}

}  // namespace

std::vector<fs::path> datasets_around(const fs::path& path) {
  std::vector<fs::path> found;
  for (fs::path at = fs::weakly_canonical(fs::absolute(path));; at = at.parent_path()) {
    try {
      if (found_kind(at)) found.push_back(at);
    } catch (const DataError&) {
      // a file that only looks like one of a data set
    }
    if (at == at.parent_path()) return found;
  }
}

DatasetKind recognise_dataset(const fs::path& folder) {
  check_folder(folder);
  if (const auto kind = found_kind(folder)) return *kind;
  throw DataError(concat(folder.string(),
                         ": is not a known kind of data set; expected poses_bounds.npy "
                         "(EvDeblur), sparse/0 (COLMAP, DiET-GS) or transforms.json in it",
                         other_finding(folder)));
}

DatasetKind kind_of(const DatasetOptions& options) {
  check_folder(options.path);
  return options.kind == DatasetKind::kAuto ? recognise_dataset(options.path) : options.kind;
}

Dataset load_dataset(const DatasetOptions& options, std::vector<std::string>* warnings) {
  const DatasetKind kind = kind_of(options);
  const Warnings sink(warnings);
  Dataset data;
  if (kind == DatasetKind::kEvDeblur) data = load_evdeblur(options, sink);
  if (kind == DatasetKind::kDietGs) data = load_diet_gs(options, sink);
  if (kind == DatasetKind::kColmap) data = load_colmap(options, sink);
  if (kind == DatasetKind::kTransforms) data = load_transforms(options, sink);
  data.kind = kind;
  data.name = folder_name(options.path);
  hold_out(sink, data);
  tell_origin(data);
  mark_strays(data, sink);
  tell_still_cameras(data, sink);
  tell_off_centre(options.path, data, sink);
  check_points(sink, data);
  apply_masks(data);
  tell_odd_brightness(sink, data);
  tell_hot_pixel(data, sink);
  settle_color(options.color, sink, data);
  for (SharpView& view : data.test) view.seen = is_seen(data, view);
  if (data.train.size() == 1) {
    sink.add(options.path.string(), ": has a single training frame; a scene needs several views");
  }
  return data;
}

}  // namespace jade::data
