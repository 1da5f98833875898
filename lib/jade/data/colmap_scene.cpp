// SPDX-License-Identifier: Apache-2.0
#include "jade/data/colmap_scene.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <map>
#include <set>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/data/frame_times.h"
#include "jade/data/frames.h"
#include "jade/data/named_files.h"
#include "jade/data/origin.h"
#include "jade/data/start_points.h"
#include "jade/data/undistorter.h"
#include "jade/data/unused_parts.h"
#include "jade/gaussians/ply.h"
#include "jade/imaging/image_io.h"
#include "jade/io/accents.h"

namespace jade::data {
namespace {

namespace fs = std::filesystem;

/// sparse/0, sparse/1, … in order, if they contain a model.
std::vector<fs::path> numbered_models(const fs::path& sparse) {
  std::vector<fs::path> models;
  if (!fs::is_directory(sparse)) return models;
  for (const auto& entry : fs::directory_iterator(sparse)) {
    const std::string name = entry.path().filename().string();
    const bool numbered = name.size() < 9 && name.find_first_not_of("0123456789") == name.npos;
    std::error_code ignored;  // of links that lead nowhere
    if (numbered && entry.is_directory(ignored) && io::is_colmap_model(entry.path())) {
      models.push_back(entry.path());
    }
  }
  std::sort(models.begin(), models.end(), [](const fs::path& a, const fs::path& b) {
    return std::stol(a.filename().string()) < std::stol(b.filename().string());
  });
  return models;
}

/// The lens coefficients of COLMAP's models, stored after the focal lengths and the principal
/// point.
geometry::Lens lens_of(const std::string& model, const std::vector<double>& parameters,
                       size_t first) {
  using geometry::LensModel;
  geometry::Lens lens;
  const auto fill = [&](LensModel kind, std::initializer_list<double*> coefficients) {
    lens.model = kind;
    for (double* const coefficient : coefficients) *coefficient = parameters.at(first++);
  };
  geometry::Lens& l = lens;
  if (model == "SIMPLE_RADIAL") fill(LensModel::kRadialTangential, {&l.k1});
  if (model == "RADIAL") fill(LensModel::kRadialTangential, {&l.k1, &l.k2});
  if (model == "OPENCV") fill(LensModel::kRadialTangential, {&l.k1, &l.k2, &l.p1, &l.p2});
  if (model == "FULL_OPENCV") {
    fill(LensModel::kRational, {&l.k1, &l.k2, &l.p1, &l.p2, &l.k3, &l.k4, &l.k5, &l.k6});
  }
  if (model == "SIMPLE_FISHEYE" || model == "FISHEYE") fill(LensModel::kFisheye, {});
  if (model == "SIMPLE_RADIAL_FISHEYE") fill(LensModel::kFisheye, {&l.k1});
  if (model == "RADIAL_FISHEYE") fill(LensModel::kFisheye, {&l.k1, &l.k2});
  if (model == "OPENCV_FISHEYE") fill(LensModel::kFisheye, {&l.k1, &l.k2, &l.k3, &l.k4});
  if (model == "FOV") fill(LensModel::kFieldOfView, {&l.k1});
  if (model == "SIMPLE_DIVISION" || model == "DIVISION") fill(LensModel::kDivision, {&l.k1});
  if (model == "EUCM") fill(LensModel::kUnified, {&l.k1, &l.k2});
  if (model == "THIN_PRISM_FISHEYE") {
    fill(LensModel::kPrismFisheye, {&l.k1, &l.k2, &l.p1, &l.p2, &l.k3, &l.k4, &l.s1, &l.s3});
  }
  if (model == "RAD_TAN_THIN_PRISM_FISHEYE") {
    fill(LensModel::kRadialPrismFisheye,
         {&l.k1, &l.k2, &l.k3, &l.k4, &l.k5, &l.k6, &l.p2, &l.p1, &l.s1, &l.s2, &l.s3, &l.s4});
  }
  return lens;
}

/// Whether the model has one focal length.
bool has_one_focal(const std::string& model) {
  return model.rfind("SIMPLE_", 0) == 0 || model == "RADIAL" || model == "RADIAL_FISHEYE";
}

/// The file of an image, whose name may have backslashes, folders that do not exist, or accents in
/// another form.
fs::path image_path(const fs::path& folder, const std::string& name) {
  for (const std::string& whole : {name, slashed(name)}) {
    const fs::path direct = (folder / whole).lexically_normal();
    if (fs::exists(direct)) return direct;
  }
  const fs::path file = folder / fs::path(slashed(name)).filename();
  if (fs::exists(file)) return file;
  for (const fs::path& path : {folder / slashed(name), file}) {
    if (const fs::path respelled = io::respelled(path); !respelled.empty())
      return respelled.lexically_normal();
  }
  return file;
}

/// In lower case and without extension.
std::string bare_name(const fs::path& path) {
  return in_small_letters(fs::path(path).replace_extension().generic_string());
}

/// "; the model names a.JPG, the folder has a.jpg", for the first name that differs only by case or
/// extension from a file that is no other image of the model; empty if none does.
std::string near_name(const fs::path& folder, const std::vector<std::string>& missing,
                      const std::vector<fs::path>& placed) {
  std::map<std::string, fs::path> files;
  for (const fs::path& path : list_images_within(folder)) {
    const fs::path inside = path.lexically_relative(folder);
    if (std::find(placed.begin(), placed.end(), path.lexically_normal()) == placed.end()) {
      files.emplace(bare_name(inside), inside);
    }
  }
  for (const std::string& name : missing) {
    const fs::path inside = slashed(name);
    auto found = files.find(bare_name(inside));
    if (found == files.end()) found = files.find(bare_name(inside.filename()));
    if (found == files.end()) continue;
    const auto kind = [](const fs::path& path) {
      return in_small_letters(path.extension().string());
    };
    return concat("; the model names ", name, ", the folder has ", found->second.string(),
                  kind(inside) == kind(found->second)
                      ? ": rename the files as in the model"
                      : ": write the names of the files into the model's images.txt (colmap "
                        "model_converter --output_type TXT), or run COLMAP on these files");
  }
  return "";
}

/// Warns of images beside those of the model, or in sibling folders, that COLMAP did not register.
void tell_unplaced(const fs::path& folder, const std::vector<fs::path>& placed,
                   const Warnings& warnings) {
  std::set<fs::path> known;
  bool nested = false;
  for (const fs::path& path : placed) {
    known.insert(path.lexically_normal());
    nested = nested || path.parent_path().lexically_normal() != folder.lexically_normal();
  }
  const std::vector<fs::path> images =
      nested ? list_images_within(folder) : imaging::list_images(folder);
  std::vector<std::string> others;
  for (const fs::path& image : images) {
    if (known.count(image.lexically_normal()) == 0) {
      others.push_back(image.lexically_relative(folder).string());
    }
  }
  if (others.empty()) return;
  warnings.add(folder.string(), ": ", others.size(), " of ", images.size(),
               " images have no pose in the model and are left out: ", listing(others, 3),
               "; run COLMAP on all of them if they belong to the scene");
}

/// @throws DataError if two images of the model are one file.
void check_own_files(const std::vector<fs::path>& paths,
                     const std::vector<const io::ColmapImage*>& images) {
  std::map<fs::path, std::string> known;
  for (size_t i = 0; i < paths.size(); ++i) {
    const auto [at, added] = known.emplace(paths[i].lexically_normal(), images[i]->name);
    if (added) continue;
    if (at->second == images[i]->name) {
      throw DataError(concat(paths[i].string(), ": expected one entry of this image in the COLMAP ",
                             "model, found two; remove one, or run COLMAP again"));
    }
    throw DataError(concat(paths[i].string(), ": expected a file for each image of the model, ",
                           "found one for ", at->second, " and ", images[i]->name,
                           "; put the images into the folders that the model names"));
  }
}

/// Whether two models of one folder have the same cameras and poses, up to rounding in text.
bool agree(const io::ColmapModel& a, const io::ColmapModel& b) {
  const auto same = [](double p, double q) {
    return std::abs(p - q) <= 1e-4 * (1 + std::abs(p) + std::abs(q));
  };
  if (a.images.size() != b.images.size() || a.cameras.size() != b.cameras.size()) return false;
  std::map<int64_t, const io::ColmapCamera*> cameras;
  for (const io::ColmapCamera& camera : b.cameras) cameras[camera.id] = &camera;
  for (const io::ColmapCamera& camera : a.cameras) {
    const auto other = cameras.find(camera.id);
    if (other == cameras.end() || other->second->model != camera.model ||
        other->second->width != camera.width || other->second->height != camera.height ||
        !std::equal(camera.parameters.begin(), camera.parameters.end(),
                    other->second->parameters.begin(), other->second->parameters.end(), same))
      return false;
  }
  std::map<std::string, const io::ColmapImage*> images;
  for (const io::ColmapImage& image : b.images) images[image.name] = &image;
  return std::all_of(a.images.begin(), a.images.end(), [&](const io::ColmapImage& image) {
    const auto other = images.find(image.name);
    if (other == images.end()) return false;
    const geometry::Pose p = data::pose_of(image), q = data::pose_of(*other->second);
    return geometry::rotation_angle(p, q) < 1e-3 &&
           std::equal(p.translation.begin(), p.translation.end(), q.translation.begin(), same);
  });
}

/// Warns of a text model beside the binary one that is read, if they differ.
void tell_text_model(const fs::path& folder, const io::ColmapModel& model,
                     const Warnings& warnings) {
  const fs::path cameras = folder / "cameras.txt", images = folder / "images.txt";
  if (!fs::exists(folder / "cameras.bin") || !fs::exists(folder / "images.bin") ||
      !fs::exists(cameras) || !fs::exists(images))
    return;
  const auto differs = [&] {
    try {
      return !agree(model, io::parse_colmap({read_file(cameras), read_file(images), "",
                                             /*binary=*/false, folder.string()}));
    } catch (const DataError&) {
      return true;
    }
  };
  if (!differs()) return;
  warnings.add(folder.string(),
               ": expected one model, found cameras.txt and images.txt that differ ",
               "from the .bin files; the .bin files are read; remove those that are out of date");
}

void tell_unused(const fs::path& root, const fs::path& model, const fs::path& frames,
                 const std::vector<fs::path>& read, const Warnings& warnings) {
  UnusedParts unused = unused_in_any_layout(root, frames, /*names_masks=*/false, read);
  unused.look_for_files(root, {{"events*", "events; frames have no exposure times here"},
                               {"events*/", "events; frames have no exposure times here"},
                               {"timestamps.npz", "times of frames"},
                               {"poses_bounds*.npy", "other poses"},
                               {"train_test_lists*", "a split"},
                               {"split*.json", "a split"},
                               {"depth_params.json", "scales of depth maps"}});
  unused.look_for_files(model, {{"depth_params.json", "scales of depth maps"},
                                {"test.txt", "a split; dataset.split chooses the test views"},
                                {"train.txt", "a split; dataset.split chooses the test views"}});
  unused.warn(root, "colmap", warnings);
}

}  // namespace

fs::path find_colmap_model(const fs::path& folder) {
  for (const char* place : {"sparse", "colmap/sparse"}) {
    fs::path best;
    int64_t most = -1;
    for (const fs::path& model : numbered_models(folder / place)) {
      const int64_t images = io::count_colmap_images(model);
      if (images > most) best = model, most = images;
    }
    if (!best.empty()) return best.lexically_normal();
    if (io::is_colmap_model(folder / place)) return (folder / place).lexically_normal();
  }
  return io::is_colmap_model(folder) ? (folder / ".").lexically_normal() : fs::path();
}

void tell_other_models(const fs::path& model, const Warnings& warnings) {
  const std::vector<fs::path> models = numbered_models(model.parent_path());
  if (std::find(models.begin(), models.end(), model) == models.end()) return;
  std::vector<std::string> others;
  for (const fs::path& each : models) {
    if (each == model) continue;
    others.push_back(concat(each.filename().string(), " with ", io::count_colmap_images(each)));
  }
  if (others.empty()) return;
  warnings.add(model.parent_path().string(), ": holds ", others.size() + 1,
               " reconstructions; the largest is used, ", model.filename().string(), " with ",
               io::count_colmap_images(model), " images; left out: ", listing(others),
               " images; they share no coordinates, so COLMAP has to join them first "
               "(model_merger, or more images between them)");
}

geometry::Pose pose_of(const io::ColmapImage& image) {
  return {geometry::rotation_from_quaternion(image.rotation), image.translation};
}

std::string name_of(const io::ColmapCamera& camera) {
  return concat("COLMAP camera ", camera.id, " (", camera.model, ")");
}

geometry::LensCamera lens_camera_of(const io::ColmapCamera& camera, int64_t width, int64_t height) {
  if (camera.model == "EQUIRECTANGULAR") {
    throw DataError(concat(name_of(camera),
                           ": expected a camera that a pinhole can replace, found one that sees "
                           "all around; cut its pictures into views of up to 90 degrees first"));
  }
  const std::vector<double>& p = camera.parameters;
  const size_t focals = has_one_focal(camera.model) ? 1 : 2;
  geometry::Intrinsics found;
  found.fx = p[0];
  found.fy = p[focals - 1];
  found.cx = p[focals];
  found.cy = p[focals + 1];
  found.width = camera.width;
  found.height = camera.height;
  if (!(found.fx > 0 && found.fy > 0)) {
    throw DataError(concat(name_of(camera), ": expected focal lengths above 0, found ", found.fx,
                           " and ", found.fy, "; calibrate again"));
  }
  return {fit_to_picture(found, width, height, name_of(camera)),
          lens_of(camera.model, p, focals + 2)};
}

geometry::Vector3 recentre(io::ColmapModel& model) {
  std::vector<geometry::Pose> poses;
  for (const io::ColmapImage& image : model.images) poses.push_back(pose_of(image));
  const geometry::Vector3 origin = origin_of(poses, model.points);
  if (geometry::is_zero(origin)) return origin;
  for (size_t i = 0; i < poses.size(); ++i) {
    model.images[i].translation = geometry::with_origin(poses[i], origin).translation;
  }
  model.points = with_origin(model.points, origin);
  return origin;
}

void read_ply_points(const fs::path& path, const geometry::Vector3& origin,
                     const Warnings& warnings, io::ColmapModel& model) {
  gaussians::PointCloud cloud = gaussians::read_point_cloud(path);
  drop_absurd_points(path.string(), warnings, cloud.points, cloud.colors);
  const geometry::Vector3 &from = cloud.origin, &to = origin;
  model.points = with_origin(cloud.points, {to[0] - from[0], to[1] - from[1], to[2] - from[2]});
  model.point_colors = (cloud.colors.clamp(0, 1) * 255).round().to(torch::kUInt8);
}

void find_points(const fs::path& folder, const Warnings& warnings, io::ColmapModel& model) {
  const auto lacks_points = [&] { return !model.points.defined() || model.points.size(0) == 0; };
  if (!lacks_points()) {
    drop_absurd_points(folder.string(), warnings, model.points, model.point_colors);
    return;
  }
  const fs::path path = folder / "points3D.ply";
  if (fs::is_regular_file(path)) read_ply_points(path, {0, 0, 0}, warnings, model);
  if (!lacks_points()) return;
  warnings.add(
      folder.string(),
      ": expected points in points3D.bin, .txt or .ply, found none; the scene starts without "
      "them (init.kind); copy the file from the model, or run COLMAP again");
}

void set_points(const io::ColmapModel& model, Dataset& data) {
  if (!model.points.defined() || model.points.size(0) == 0) return;
  std::vector<double> centres;
  for (const Exposure& exposure : data.train) {
    for (const double value : geometry::centre(exposure.poses[geometry::kMidPose])) {
      centres.push_back(value);
    }
  }
  const torch::Tensor cameras = torch::tensor(centres, torch::kFloat64).reshape({-1, 3});
  torch::Tensor keep = torch::ones({model.points.size(0)}, torch::kBool);
  for (int64_t i = 0; i < cameras.size(0); ++i) {
    keep &= (model.points - cameras[i]).abs().amax(1) > 1e-6;
  }
  data.points = model.points.index({keep}).to(torch::kFloat32);
  data.point_colors = model.point_colors.index({keep}).to(torch::kFloat32) / 255;
}

Dataset load_colmap(const DatasetOptions& options, const Warnings& warnings) {
  const fs::path folder = find_colmap_model(options.path);
  if (folder.empty()) {
    throw DataError(concat(options.path.string(),
                           ": expected a COLMAP model (sparse/0 with cameras and images, .bin or "
                           ".txt), found none"));
  }
  tell_other_models(folder, warnings);
  io::ColmapModel model = io::read_colmap(folder);
  if (model.images.empty()) {
    throw DataError(concat(folder.string(),
                           ": expected images with poses, found none; copy the model again or "
                           "rerun COLMAP"));
  }
  tell_text_model(folder, model, warnings);
  find_points(folder, warnings, model);
  const geometry::Vector3 origin = recentre(model);
  std::sort(model.images.begin(), model.images.end(),
            [](const io::ColmapImage& a, const io::ColmapImage& b) { return a.name < b.name; });
  const fs::path image_folder =
      find_image_folder(options.path, options.image_folder, ImageDepth::kNested);
  std::vector<fs::path> paths;
  std::vector<const io::ColmapImage*> views;
  std::vector<std::string> missing, respelled;
  for (const io::ColmapImage& image : model.images) {
    const fs::path path = image_path(image_folder, image.name);
    if (!fs::exists(path)) {
      missing.push_back(image.name);
      continue;
    }
    if (image.name.find(path.filename().string()) == std::string::npos)
      respelled.push_back(image.name);
    paths.push_back(path);
    views.push_back(&image);
  }
  if (paths.empty()) {
    const std::string near = near_name(image_folder, missing, paths);
    throw DataError(concat(image_folder.string(), ": holds none of the ", model.images.size(),
                           " images of ", folder.string(), ", such as ", missing.front(),
                           near.empty() ? "; set dataset.image_folder" : near));
  }
  if (!missing.empty()) {
    warnings.add(image_folder.string(), ": images of the model without a file: ", listing(missing),
                 near_name(image_folder, missing, paths));
  }
  tell_respelled(folder, respelled, warnings);
  check_own_files(paths, views);
  const std::vector<Frame> frames =
      read_frames(paths, MaskSources(options), warnings, FrameSizes::kAny);
  tell_unplaced(image_folder, paths, warnings);
  tell_unused(options.path, folder, image_folder, paths, warnings);
  const Split split =
      split_by_position(frames.size(), position_rule(options, warnings), folder.string());

  Dataset data;
  data.root = options.path;
  data.origin = origin;
  data.split = split.rule;
  std::vector<geometry::Pose> poses;
  Undistorter undistorter;
  std::string scaled;
  for (size_t i = 0; i < frames.size(); ++i) {
    const geometry::Pose pose = pose_of(*views[i]);
    const io::ColmapCamera& listed = model.camera(views[i]->camera_id);
    torch::Tensor image = frames[i].image, mask = frames[i].mask;
    if (scaled.empty()) {
      scaled = scale_note({1, 1, 0, 0, listed.width, listed.height}, image.size(2), image.size(1),
                          name_of(listed));
    }
    const geometry::Intrinsics camera = undistorter.undistort(
        lens_camera_of(listed, image.size(2), image.size(1)), name_of(listed), image, mask);
    poses.push_back(pose);
    if (split.is_test[i]) {
      data.test.push_back({frames[i].name, image, pose, camera, SharpView::kNoTime});
      data.test.back().mask = mask;
    } else {
      Exposure exposure;
      exposure.name = frames[i].name;
      exposure.blurry = image;
      exposure.poses.fill(pose);
      exposure.camera = camera;
      exposure.mask = mask;
      data.train.push_back(std::move(exposure));
    }
  }
  if (!scaled.empty()) data.notes.push_back(scaled);
  undistorter.tell(warnings, data.notes);
  data.undistorted = undistorter.has_undistorted();
  set_points(model, data);
  const DepthBounds bounds = depth_bounds(data.points, poses);
  data.near = bounds.near;
  data.far = bounds.far;
  return data;
}

}  // namespace jade::data
