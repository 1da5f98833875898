// SPDX-License-Identifier: Apache-2.0
#include "jade/data/transforms_file.h"

#include <algorithm>
#include <map>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/data/frames.h"
#include "jade/data/named_files.h"
#include "jade/data/transforms_json.h"
#include "jade/imaging/image_header.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

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

/// The frames that have named an image so far.
class Listed {
 public:
  explicit Listed(const fs::path& path) : path_(path) {}

  /// Whether an earlier frame has the same image and all the same values.
  /// @throws DataError for one with other values.
  bool repeats(const json& frame, const ListedView& view) {
    json values = frame;
    values.erase("file_path");
    const auto [at, added] = known_.emplace(view.path, std::pair{view.given, values});
    if (added) return false;
    const auto& [given, before] = at->second;
    if (before != values) {
      throw DataError(concat(path_.string(), ": expected one frame for each image, found ",
                             view.given, " listed twice", view.given == given ? "" : ", also as ",
                             view.given == given ? "" : given,
                             ", with other values; remove one of the two"));
    }
    repeated_.push_back(view.given);
    return true;
  }

  size_t repeated() const { return repeated_.size(); }

  void tell(const Warnings& warnings) const {
    if (repeated_.empty()) return;
    warnings.add(path_.string(), ": ", repeated_.size(),
                 repeated_.size() == 1 ? " frame is" : " frames are",
                 " listed twice: ", listing(repeated_, 3), "; each is used once");
  }

 private:
  const fs::path& path_;
  std::map<fs::path, std::pair<std::string, json>> known_;
  std::vector<std::string> repeated_;
};

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

}  // namespace

bool is_fraction(double place) { return place > 0 && place <= 1; }

TransformsFile read_transforms(const fs::path& path, const std::string& image_folder,
                               const Warnings& warnings) {
  json root = read_transforms_json(path);
  std::vector<ListedView> views;
  NamedFiles files{path.parent_path(), image_folder, {}, {}, {}};
  if (!image_folder.empty()) find_image_folder(path.parent_path(), image_folder);
  size_t contradicting = 0, zero_centres = 0, fractional_centres = 0;
  std::string contradicting_model;
  Listed listed(path);
  for (const json& frame : root["frames"]) {
    const std::string where =
        concat(path.string(), " frame ", views.size() + files.missing.size() + listed.repeated());
    ListedView view;
    view.given = file_path_of(frame, where);
    view.path = files.find_image(view.given);
    if (view.path.empty() || listed.repeats(frame, view)) continue;
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
  listed.tell(warnings);
  tell_contradicting_models(path, contradicting, contradicting_model, warnings);
  tell_zero_centres(path, zero_centres, warnings);
  tell_fractional_centres(path, fractional_centres, warnings);
  tell_moved(path, files.moved, warnings);
  tell_respelled(path, files.respelled, warnings);
  tell_missing(path, files, root["frames"].size(), warnings);
  if (views.empty()) throw DataError(concat(path.string(), ": has no frames"));
  return {path, std::move(root), std::move(views), {files.missing.begin(), files.missing.end()}};
}

std::set<fs::path> named_images(const fs::path& folder, const std::string& image_folder) {
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

}  // namespace jade::data
