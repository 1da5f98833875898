// SPDX-License-Identifier: Apache-2.0
// Shared parts of the loaders of COLMAP models, and the loader of sharp images with such a model.
#pragma once

#include <filesystem>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"
#include "jade/geometry/lens.h"
#include "jade/io/colmap.h"

namespace jade::data {

/// The folder of the model: of the numbered ones in sparse or colmap/sparse that with the most
/// images; else sparse, or the folder itself; empty if there is none.
std::filesystem::path find_colmap_model(const std::filesystem::path& folder);

/// Warns of the reconstructions beside `model`, which are left out.
void tell_other_models(const std::filesystem::path& model, const Warnings& warnings);

geometry::Pose pose_of(const io::ColmapImage& image);

/// "COLMAP camera 1 (OPENCV)", for messages.
std::string name_of(const io::ColmapCamera& camera);

/// The camera with its lens, for images of width x height.
/// @throws DataError for a camera of another shape, one that no pinhole can replace
///   (EQUIRECTANGULAR), and focal lengths that are not positive.
geometry::LensCamera lens_camera_of(const io::ColmapCamera& camera, int64_t width, int64_t height);

/// Moves a model that lies far from the origin of its coordinates to one of its own, in double.
/// @return that origin, of the model's coordinates; zero where nothing was moved
geometry::Vector3 recentre(io::ColmapModel& model);

/// Reads the points of a .ply into the model, about `origin` of the file's coordinates.
/// @throws DataError naming the file for damaged content and points that are not finite.
void read_ply_points(const std::filesystem::path& path, const geometry::Vector3& origin,
                     io::ColmapModel& model);

/// Gives a model without points those of points3D.ply in its folder, as trainers of splats leave
/// them; a warning where there are none.
void find_points(const std::filesystem::path& folder, const Warnings& warnings,
                 io::ColmapModel& model);

/// Points as float32 and colours in [0,1] into `data`; points that coincide with a camera, which
/// would have no direction, are left out.
void set_points(const io::ColmapModel& model, Dataset& data);

/// Images of the model that have a file, in order of name; every eighth is a test view.
Dataset load_colmap(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
