// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/data/colmap_scene.h"
#include "jade/data/frame_times.h"
#include "jade/data/frames.h"
#include "jade/data/named_files.h"
#include "jade/data/origin.h"
#include "jade/data/transforms_json.h"
#include "jade/data/undistorter.h"
#include "jade/data/unused_parts.h"
#include "jade/geometry/lens.h"
#include "jade/imaging/image_header.h"
#include "jade/imaging/image_io.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct ListedView {
  std::string given;  ///< 'file_path' as in the file, with slashes
  fs::path path, mask;
  geometry::Pose pose;
  geometry::Intrinsics camera;        ///< 0 if the file does not contain it
  double angle_x = 0, angle_y = 0;    ///< fields of view in radians, used without a focal length
  double beside_x = 0, beside_y = 0;  ///< those stated beside a focal length; 0: none
  double reduction = 1;               ///< camera size / image size, without 'w', 'h'
  geometry::Lens lens;
};

/// With fewer images left of a file that named more, the scene counts as damaged.
constexpr size_t kFewestFrames = 3;

std::string file_path_of(const json& frame, const std::string& where) {
  std::string path = text_of(frame, "file_path", where);
  if (path.empty()) throw DataError(concat(where, ": expected a 'file_path'"));
  return path;
}

/// The mask that a frame names, or an empty path. Images in images_N use masks_N, if that contains
/// the file.
fs::path mask_of(const fs::path& folder, const std::string& image_folder, const json& frame,
                 const std::string& where) {
  const std::string name = text_of(frame, "mask_path", where);
  if (name.empty()) return {};
  if (image_folder.rfind("images_", 0) == 0) {
    const fs::path reduced = folder / ("masks_" + image_folder.substr(7));
    if (fs::path found = file_inside(reduced, slashed(name)); !found.empty()) return found;
  }
  NamedFiles files{folder, {}, {}, {}, {}};
  if (fs::path found = files.find(name); !found.empty()) return found;
  throw DataError(concat(where, ": expected a mask '", name,
                         "' as 'mask_path' says, found no such file; correct or remove the key"));
}

void tell_moved(const fs::path& path, const std::vector<std::string>& moved,
                const Warnings& warnings) {
  if (moved.empty()) return;
  warnings.add(path.string(), ": ", moved.size(), " paths, such as ", moved.front(),
               ", lead nowhere; the files were found by their last parts in ",
               path.parent_path().string());
}

/// "; the file names a.png, the folder has a.PNG: …" for the first name that differs from a file
/// only by case or extension; empty if none does.
std::string near_name(const NamedFiles& files) {
  constexpr size_t kTried = 20;
  for (size_t i = 0; i < std::min(files.missing.size(), kTried); ++i) {
    const std::string& name = files.missing[i];
    const fs::path found = files.image_folder.empty()
                               ? near_image(files.folder, name)
                               : near_image(files.folder / files.image_folder,
                                            fs::path(slashed(name)).filename().string());
    if (found.empty()) continue;
    return concat("; the file names ", name, ", the folder has ", found.string(),
                  ": rename the files as in 'file_path', or the other way round");
  }
  return "";
}

/// Reports missing images. Most scenes lack none; a scene with a few missing images is still
/// usable.
void tell_missing(const fs::path& path, const NamedFiles& files, size_t frames,
                  const Warnings& warnings) {
  const std::vector<std::string>& missing = files.missing;
  if (missing.empty()) return;
  const std::string place =
      files.image_folder.empty() ? "there" : concat("in ", files.image_folder, "/");
  const std::string what =
      concat(path.string(), ": ", missing.size(), " of ", frames,
             " frames name an image that is not ", place, ": ", listing(missing, 3));
  const std::string near = near_name(files);
  const size_t left = frames - missing.size();
  if (left < std::min<size_t>(frames, kFewestFrames) || 2 * left < frames) {
    throw DataError(concat(what, "; expected at least half of them and no fewer than ",
                           kFewestFrames,
                           near.empty() ? "; is the folder of the images complete?" : near));
  }
  warnings.add(what, "; they are left out", near);
}

/// @throws DataError for an image that two frames of a file name.
void check_listed_once(const fs::path& path, const std::vector<ListedView>& views) {
  std::map<fs::path, const ListedView*> known;
  for (const ListedView& view : views) {
    const auto [at, added] = known.emplace(view.path, &view);
    if (added) continue;
    throw DataError(concat(path.string(), ": expected one frame for each image, found ", view.given,
                           " listed twice", view.given == at->second->given ? "" : ", also as ",
                           view.given == at->second->given ? "" : at->second->given,
                           "; remove one of the two"));
  }
}

/// Warns of a camera model without a lens that has lens coefficients.
void tell_contradicting_models(const fs::path& path, size_t count, const std::string& model,
                               const Warnings& warnings) {
  if (count == 0) return;
  warnings.add(path.string(), ": ", count, " frames have camera_model ", model,
               ", which has no distortion, and coefficients (k1, k2, p1, p2, …) that are not 0; ",
               "they are undistorted as OPENCV, as nerfstudio does; if the images are undistorted "
               "already, remove the coefficients");
}

/// True if the frame, or else the file, gives 0 for this key.
bool gives_zero(const json& root, const json& frame, const char* key) {
  const json& object = frame.contains(key) ? frame : root;
  return object.contains(key) && object[key] == 0;
}

void tell_zero_centres(const fs::path& path, size_t count, const Warnings& warnings) {
  if (count == 0) return;
  warnings.add(path.string(), ": ", count, " frames have a principal point (cx, cy) with a 0, ",
               "which is a corner of the image; its middle is used instead");
}

bool is_fraction(double place) { return place > 0 && place <= 1; }

void tell_fractional_centres(const fs::path& path, size_t count, const Warnings& warnings) {
  if (count == 0) return;
  warnings.add(path.string(), ": expected a principal point (cx, cy) in px, found values up to 1 ",
               "in ", count, " frames; they are read as fractions of the image size; write px");
}

/// ", found 'fov'" for the keys that may mean a focal length; else ", found none of them".
std::string like_focal_lengths(const json& root, const json& frame) {
  std::vector<std::string> found;
  for (const json* object : {&root, &frame}) {
    for (const auto& [key, value] : object->items()) {
      for (const char* part : {"fov", "focal", "intrinsic", "angle", "fx", "fl"}) {
        if (key.find(part) == std::string::npos) continue;
        found.push_back("'" + key + "'");
        break;
      }
    }
  }
  return ", found " + (found.empty() ? "none of them" : listing(found));
}

/// A file and the views whose images are there.
struct TransformsFile {
  fs::path path;
  json root;
  std::vector<ListedView> views;
  std::set<std::string> missing;  ///< 'file_path' of frames without an image
};

/// Sets the size of the camera of an image in another folder, if the file does not contain it: that
/// of the image at the named place, else the image's size times the N of images_N.
void set_size_before_reduction(const fs::path& folder, const std::string& image_folder,
                               ListedView& view) {
  NamedFiles files{folder, {}, {}, {}, {}};
  const auto whole = imaging::read_image_header(files.find(view.given));
  const auto reduced = imaging::read_image_header(view.path);
  if (whole && reduced && whole->width > 0) {
    view.reduction = double(whole->width) / double(reduced->width);
    return;
  }
  view.reduction = folder_scale(folder / image_folder);
}

TransformsFile read_transforms(const fs::path& path, const std::string& image_folder,
                               const Warnings& warnings) {
  json root = read_transforms_json(path);
  std::vector<ListedView> views;
  NamedFiles files{path.parent_path(), image_folder, {}, {}, {}};
  if (!image_folder.empty()) find_image_folder(path.parent_path(), image_folder);
  size_t contradicting = 0, zero_centres = 0, fractional_centres = 0;
  std::string contradicting_model;
  for (const json& frame : root["frames"]) {
    const std::string where = concat(path.string(), " frame ", views.size() + files.missing.size());
    ListedView view;
    view.given = file_path_of(frame, where);
    view.path = files.find_image(view.given);
    if (view.path.empty()) continue;
    view.mask = mask_of(path.parent_path(), image_folder, frame, where);
    view.camera = camera_of_frame(root, frame, where);
    if (gives_zero(root, frame, "cx") || gives_zero(root, frame, "cy")) ++zero_centres;
    if (is_fraction(view.camera.cx) || is_fraction(view.camera.cy)) ++fractional_centres;
    view.lens = lens_of_frame(root, frame, where);
    const std::string model = camera_model_of(root, frame);
    const bool is_pinhole = model == "PINHOLE" || model == "SIMPLE_PINHOLE";
    if (is_pinhole && view.lens.model == geometry::LensModel::kRadialTangential) {
      ++contradicting;
      contradicting_model = model;
    }
    if (!frame.contains("transform_matrix")) {
      throw DataError(concat(where, ": expected a 'transform_matrix'"));
    }
    view.pose = pose_of_matrix(frame["transform_matrix"], where);
    if (view.camera.fx == 0) view.angle_x = angle_of(root, frame, 'x', where);
    if (view.camera.fy == 0) view.angle_y = angle_of(root, frame, 'y', where);
    if (view.camera.fx > 0) view.beside_x = angle_beside_focal(root, frame, 'x');
    if (view.camera.fy > 0) view.beside_y = angle_beside_focal(root, frame, 'y');
    if (view.camera.fx + view.camera.fy + view.angle_x + view.angle_y == 0) {
      throw DataError(concat(where, ": expected 'fl_x', 'camera_angle_x' or 'x_fov'",
                             like_focal_lengths(root, frame),
                             "; add the focal length in px or the field of view in radians"));
    }
    if (!image_folder.empty() && (view.camera.width == 0 || view.camera.height == 0)) {
      set_size_before_reduction(path.parent_path(), image_folder, view);
    }
    views.push_back(std::move(view));
  }
  check_listed_once(path, views);
  tell_contradicting_models(path, contradicting, contradicting_model, warnings);
  tell_zero_centres(path, zero_centres, warnings);
  tell_fractional_centres(path, fractional_centres, warnings);
  tell_moved(path, files.moved, warnings);
  tell_respelled(path, files.respelled, warnings);
  tell_missing(path, files, root["frames"].size(), warnings);
  if (views.empty()) throw DataError(concat(path.string(), ": has no frames"));
  return {path, std::move(root), std::move(views), {files.missing.begin(), files.missing.end()}};
}

double focal_of(double angle, int64_t size) { return 0.5 * double(size) / std::tan(0.5 * angle); }

/// The camera as listed; its size is that of its image if the file does not contain it.
geometry::Intrinsics sized_camera(const ListedView& view, int64_t width, int64_t height) {
  geometry::Intrinsics camera = view.camera;
  if (camera.width > 0 && camera.height > 0) return camera;
  camera.width = std::llround(double(width) * view.reduction);
  camera.height = std::llround(double(height) * view.reduction);
  return camera;
}

geometry::LensCamera fit_camera(const ListedView& view, int64_t width, int64_t height) {
  geometry::Intrinsics camera = sized_camera(view, width, height);
  if (view.angle_x > 0) camera.fx = focal_of(view.angle_x, camera.width);
  if (view.angle_y > 0) camera.fy = focal_of(view.angle_y, camera.height);
  // Assume square pixels if only one of the two is known.
  if (camera.fx == 0) camera.fx = camera.fy;
  if (camera.fy == 0) camera.fy = camera.fx;
  if (camera.cx == 0) camera.cx = 0.5 * double(camera.width);
  if (camera.cy == 0) camera.cy = 0.5 * double(camera.height);
  if (is_fraction(camera.cx)) camera.cx *= double(camera.width);
  if (is_fraction(camera.cy)) camera.cy *= double(camera.height);
  return {fit_to_picture(camera, width, height, view.path.string()), view.lens};
}

/// Warns of cameras whose numbers contradict each other, or lie where only crops have them.
class DoubtfulCameras {
 public:
  void look(const ListedView& view, const geometry::Intrinsics& fitted, int64_t width,
            int64_t height) {
    const geometry::Intrinsics camera = sized_camera(view, width, height);
    const auto compare = [&](const char* axis, double angle, double focal, int64_t size) {
      constexpr double kMost = 0.03;
      if (angle == 0 || focal == 0) return false;
      const double other = focal_of(angle, size);
      if (std::abs(other - focal) <= kMost * focal) return false;
      if (differing_++ == 0) {
        example_ = concat("fl_", axis, " ", focal, " and camera_angle_", axis, " ", angle,
                          ", which is ", std::round(10 * other) / 10, " px for ", size, " px");
      }
      return true;
    };
    if (!compare("x", view.beside_x, camera.fx, camera.width))
      compare("y", view.beside_y, camera.fy, camera.height);
    const auto near_border = [](double place, int64_t size) {
      constexpr double kMargin = 0.1;
      return place < kMargin * double(size) || place > (1 - kMargin) * double(size);
    };
    if (!near_border(fitted.cx, fitted.width) && !near_border(fitted.cy, fitted.height)) return;
    if (beside_++ == 0) {
      centre_ = concat("(", fitted.cx, ", ", fitted.cy, ") in ", fitted.width, "x", fitted.height);
    }
  }
  void tell(const fs::path& path, const Warnings& warnings) const {
    if (differing_ > 0) {
      warnings.add(path.string(), ": expected one focal length, found ", example_, " (", differing_,
                   " frames); fl_x is used; correct or remove the wrong one");
    }
    if (beside_ > 0) {
      warnings.add(path.string(), ": expected a principal point (cx, cy) near the middle, found ",
                   centre_, " px (", beside_,
                   " frames), as only crops have; if it counts from the ",
                   "middle of the image, add half of the image size");
    }
  }

 private:
  size_t differing_ = 0, beside_ = 0;
  std::string example_, centre_;
};

/// A normalised path, so that equal ones compare equal.
std::string plain_name(const std::string& name) {
  return fs::path(slashed(name)).lexically_normal().string();
}

/// The frames listed in train_filenames and similar keys; no value if the file has no such list.
/// @throws DataError for names that no frame has.
std::set<std::string> named_frames(const TransformsFile& file, const char* key) {
  std::set<std::string> names, known;
  if (!file.root.contains(key)) return names;
  const auto wrong = [&](const std::string& found) {
    return DataError(concat(file.path.string(), ": expected '", key,
                            "' to list values of 'file_path', found ", found,
                            "; correct or remove it"));
  };
  if (!file.root[key].is_array()) throw wrong("no list");
  for (const ListedView& view : file.views) known.insert(plain_name(view.given));
  for (const std::string& name : file.missing) known.insert(plain_name(name));
  for (const json& name : file.root[key]) {
    if (!name.is_string()) throw wrong("something else");
    names.insert(plain_name(name.get<std::string>()));
    if (known.count(plain_name(name.get<std::string>())) == 0) {
      throw wrong("'" + name.get<std::string>() + "', which no frame has");
    }
  }
  return names;
}

/// The views to load and what they are for.
struct Listing {
  std::vector<ListedView> views;
  std::vector<bool> is_test;
  std::string rule;            ///< the rule of the split, in words
  TransformsFile main;         ///< the main file without its views
  std::set<std::string> keys;  ///< with a value other than the default, from all files that are
                               ///< read
};

void check_both_left(const Listing& listing) {
  if (std::count(listing.is_test.begin(), listing.is_test.end(), false) > 0) return;
  throw DataError(concat(listing.main.path.string(),
                         ": expected frames for training, found test views only; correct the "
                         "lists of the split or set dataset.split"));
}

/// Splits by train_filenames, val_filenames and test_filenames (nerfstudio). Test views are those
/// of test_filenames, or of val_filenames if there are none.
void split_by_names(TransformsFile file, const Warnings& warnings, Listing& listing) {
  const auto train = named_frames(file, "train_filenames"),
             val = named_frames(file, "val_filenames"),
             named = named_frames(file, "test_filenames");
  const char* const key = named.empty() ? "val_filenames" : "test_filenames";
  const auto& test = named.empty() ? val : named;
  int64_t unused = 0, both = 0;
  for (ListedView& view : file.views) {
    const std::string name = plain_name(view.given);
    const bool tests = test.count(name) != 0;
    const bool trains =
        train.empty() ? val.count(name) == 0 && named.count(name) == 0 : train.count(name) != 0;
    if (tests && trains) ++both;
    if (!tests && !trains) {
      ++unused;
      continue;
    }
    listing.views.push_back(std::move(view));
    listing.is_test.push_back(tests);
  }
  if (both > 0) {
    warnings.add(file.path.string(), ": ", both, " frames are in train_filenames and in ", key,
                 "; they are test views only");
  }
  if (unused > 0) {
    warnings.add(file.path.string(), ": ", unused, " of ", file.views.size(),
                 " frames are neither for training nor in ", key, " and are left out");
  }
  listing.rule =
      concat(std::count(listing.is_test.begin(), listing.is_test.end(), true), " named by ", key);
}

bool names_split(const json& root) {
  return root.contains("train_filenames") || root.contains("val_filenames") ||
         root.contains("test_filenames");
}

/// Takes the test views from a file of their own; views of `main` that are not among them are for
/// training.
void split_by_files(TransformsFile file, const fs::path& test_path, const std::string& image_folder,
                    bool wants_test, const Warnings& warnings, Listing& listing) {
  std::set<fs::path> tests;
  std::vector<ListedView> test_views;
  if (!test_path.empty() && wants_test) {
    TransformsFile test = read_transforms(test_path, image_folder, warnings);
    for (const ListedView& view : test.views) tests.insert(view.path);
    add_keys(test.root, listing.keys);
    test_views = std::move(test.views);
  }
  int64_t both = 0;
  for (ListedView& view : file.views) {
    if (tests.count(view.path) != 0) {
      ++both;
      continue;
    }
    listing.views.push_back(std::move(view));
  }
  if (both > 0) {
    warnings.add(file.path.string(), ": ", both, " of its frames are in ",
                 test_path.filename().string(), " too; they are test views only");
  }
  listing.is_test.assign(listing.views.size(), false);
  for (ListedView& view : test_views) listing.views.push_back(std::move(view));
  listing.is_test.resize(listing.views.size(), true);
  listing.rule = test_path.empty() ? "no file of test views" : test_path.filename().string();
}

/// transforms.json, or transforms_train.json with the test views of transforms_test.json or, if
/// that is missing, of transforms_val.json.
Listing listing_of(const DatasetOptions& options, const Warnings& warnings) {
  const fs::path single = options.path / "transforms.json",
                 train = options.path / "transforms_train.json";
  fs::path test;
  for (const char* name : {"transforms_val.json", "transforms_test.json"}) {
    if (fs::exists(options.path / name)) test = options.path / name;
  }
  const bool pair = fs::exists(train);
  const bool automatic = options.split == SplitKind::kAuto;
  if (pair && fs::exists(single)) {
    warnings.add(single.string(), ": is not read; ", train.filename().string(), " is");
  }
  TransformsFile file = read_transforms(pair ? train : single, options.image_folder, warnings);
  Listing listing;
  listing.main = {file.path, file.root, {}, {}};
  add_keys(file.root, listing.keys);
  if (pair || (automatic && !test.empty())) {
    if (options.split == SplitKind::kLast || options.split == SplitKind::kEvery) {
      warnings.add(options.path.string(), ": dataset.split ", word_of(options.split),
                   " has no effect; transforms_train.json and transforms_test.json are the split");
    }
    split_by_files(std::move(file), test, options.image_folder, options.split != SplitKind::kNone,
                   warnings, listing);
    check_both_left(listing);
    return listing;
  }
  std::sort(file.views.begin(), file.views.end(),
            [](const ListedView& a, const ListedView& b) { return a.path < b.path; });
  if (automatic && names_split(file.root)) {
    split_by_names(std::move(file), warnings, listing);
    check_both_left(listing);
    return listing;
  }
  if (names_split(file.root)) {
    warnings.add(single.string(), ": names the frames of its split (train_filenames and others); ",
                 "dataset.split ", word_of(options.split), " is used instead");
  }
  Split split = split_by_position(
      file.views.size(), {options.split, options.test_last, options.test_every}, single.string());
  listing.views = std::move(file.views);
  listing.is_test = std::move(split.is_test);
  listing.rule = split.rule;
  return listing;
}

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
  read_ply_points(path, data.origin, model);
  set_points(model, data);
}

/// The images that any of a folder's files names; in `image_folder`, unless that is empty.
std::set<fs::path> named_images(const fs::path& folder, const std::string& image_folder = "") {
  std::set<fs::path> images;
  for (const char* name : {"transforms.json", "transforms_train.json", "transforms_val.json",
                           "transforms_test.json"}) {
    if (!fs::exists(folder / name)) continue;
    NamedFiles files{folder, image_folder, {}, {}, {}};
    const json root = read_transforms_json(folder / name);
    for (const json& frame : root["frames"]) {
      const fs::path found = files.find_image(file_path_of(frame, (folder / name).string()));
      if (!found.empty()) images.insert(fs::weakly_canonical(fs::absolute(found)));
    }
  }
  return images;
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

void tell_unused(const fs::path& root, const Listing& found, const Warnings& warnings) {
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
  Listing listing = listing_of(options, warnings);
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
  read_points(listing.main, data, warnings);
  tell_unnamed(options.path, options.image_folder, paths, warnings);
  tell_unused(options.path, listing, warnings);
  const DepthBounds bounds = depth_bounds(data.points, poses);
  data.near = bounds.near;
  data.far = bounds.far;
  return data;
}

}  // namespace jade::data
