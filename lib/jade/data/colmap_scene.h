// SPDX-License-Identifier: Apache-2.0
// Shared parts of the loaders of COLMAP models, and the loader of sharp images with such a model.
#pragma once

#include <filesystem>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"
#include "jade/geometry/lens.h"
#include "jade/io/colmap.h"

namespace jade::data {

/// The folder of the model: the numbered folder in sparse or colmap/sparse with the most images;
/// else sparse, or the folder itself; empty if there is none.
std::filesystem::path find_colmap_model(const std::filesystem::path& folder);

/// Warns about reconstructions beside `model`, which are not used.
void tell_other_models(const std::filesystem::path& model, const Warnings& warnings);

geometry::Pose pose_of(const io::ColmapImage& image);

/// "COLMAP camera 1 (OPENCV)", for messages.
std::string name_of(const io::ColmapCamera& camera);

/// The camera with its lens, for images of width x height.
/// @throws DataError for an unknown camera model, one that no pinhole can replace
///   (EQUIRECTANGULAR), and focal lengths that are not positive.
geometry::LensCamera lens_camera_of(const io::ColmapCamera& camera, int64_t width, int64_t height);

/// Moves a model that is far from the origin of its coordinates to an origin near it, in double.
/// @return the new origin in the model's coordinates; zero if nothing was moved
geometry::Vector3 recentre(io::ColmapModel& model);

/// Reads the points of a .ply file into the model, relative to `origin` in the file's coordinates.
/// Warns as drop_absurd_points(). @throws DataError naming the file for damaged content.
void read_ply_points(const std::filesystem::path& path, const geometry::Vector3& origin,
                     const Warnings& warnings, io::ColmapModel& model);

/// Fills a model that has no points from points3D.ply in its folder, as trainers of splats write
/// it; warns if there is no such file.
void find_points(const std::filesystem::path& folder, const Warnings& warnings,
                 io::ColmapModel& model);

/// Copies points (float32) and colours in [0,1] into `data`; omits points that coincide with a
/// camera, because they have no direction.
void set_points(const io::ColmapModel& model, Dataset& data);

/// Loads the images of the model that have a file, sorted by name; every eighth is a test view.
Dataset load_colmap(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
