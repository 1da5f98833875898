// SPDX-License-Identifier: Apache-2.0
// What the loaders over COLMAP models share, and the loader of sharp images with such a model.
#pragma once

#include <filesystem>

#include "jade/data/dataset.h"
#include "jade/data/warnings.h"
#include "jade/io/colmap.h"

namespace jade::data {

/// The folder of the model: sparse/0, sparse, colmap/sparse/0, or the folder itself; empty if none.
std::filesystem::path find_colmap_model(const std::filesystem::path& folder);

geometry::Pose pose_of(const io::ColmapImage& image);

/// How far, in pixels, the corners of a fisheye lie from where a pinhole of the same focal length
/// has them; infinite where no pinhole sees them.
double fisheye_shift_px(double focal_px, int64_t width, int64_t height);

/// A pinhole for images of width x height. Radial terms are dropped with a warning when they bend
/// the image by less than a pixel. @throws DataError naming the undistorter otherwise.
geometry::Intrinsics camera_of(const io::ColmapCamera& camera, int64_t width, int64_t height,
                               const Warnings& warnings);

/// Points as float32 and colours in [0,1] into `data`; points that coincide with a camera, which
/// would have no direction, are left out.
void set_points(const io::ColmapModel& model, Dataset& data);

/// Images of the model that have a file, in order of name; every eighth is a test view.
Dataset load_colmap(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
