// SPDX-License-Identifier: Apache-2.0
// Writes COLMAP models for tests, from the published description of the format.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "jade/io/colmap.h"

namespace jade::test {

template <class T>
void put(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}

/// The three binary files of a model with PINHOLE cameras (id 1), two observations per image and
/// the given points (xyz), all of colour (10, 20, 30).
inline io::ColmapFiles binary_model(const io::ColmapCamera& camera,
                                    const std::vector<io::ColmapImage>& images,
                                    const std::vector<double>& points) {
  io::ColmapFiles files;
  files.name = "sparse/0";
  put<uint64_t>(files.cameras, 1);
  put<int32_t>(files.cameras, static_cast<int32_t>(camera.id));
  put<int32_t>(files.cameras, camera.model == "PINHOLE" ? 1 : 0);
  put<uint64_t>(files.cameras, static_cast<uint64_t>(camera.width));
  put<uint64_t>(files.cameras, static_cast<uint64_t>(camera.height));
  for (const double parameter : camera.parameters) put(files.cameras, parameter);
  put<uint64_t>(files.images, images.size());
  for (const io::ColmapImage& image : images) {
    put<int32_t>(files.images, static_cast<int32_t>(image.id));
    for (const double value : image.rotation) put(files.images, value);
    for (const double value : image.translation) put(files.images, value);
    put<int32_t>(files.images, static_cast<int32_t>(image.camera_id));
    files.images += image.name;
    files.images += '\0';
    put<uint64_t>(files.images, 2);
    files.images.append(48, '\0');
  }
  put<uint64_t>(files.points, points.size() / 3);
  for (size_t i = 0; i + 2 < points.size(); i += 3) {
    put<uint64_t>(files.points, i);
    for (size_t axis = 0; axis < 3; ++axis) put(files.points, points[i + axis]);
    files.points += "\x0a\x14\x1e";
    put(files.points, 0.5);
    put<uint64_t>(files.points, 1);
    files.points.append(8, '\0');
  }
  return files;
}

/// A model as text files.
inline io::ColmapFiles text_model(const io::ColmapCamera& camera,
                                  const std::vector<io::ColmapImage>& images,
                                  const std::vector<double>& points) {
  std::ostringstream cameras, poses, cloud;
  cameras.precision(17);
  poses.precision(17);
  cloud.precision(17);
  cameras << "# Camera list\n"
          << camera.id << " " << camera.model << " " << camera.width << " " << camera.height;
  for (const double parameter : camera.parameters) cameras << " " << parameter;
  cameras << "\n";
  poses << "# Image list with two lines of data per image\n";
  for (const io::ColmapImage& image : images) {
    poses << image.id;
    for (const double value : image.rotation) poses << " " << value;
    for (const double value : image.translation) poses << " " << value;
    poses << " " << image.camera_id << " " << image.name << "\n\n";
  }
  for (size_t i = 0; i + 2 < points.size(); i += 3) {
    cloud << i << " " << points[i] << " " << points[i + 1] << " " << points[i + 2]
          << " 10 20 30 0.5 1 0\n";
  }
  return {cameras.str(), poses.str(), cloud.str(), false, "sparse/0"};
}

inline void save_model(const std::filesystem::path& folder, const io::ColmapFiles& files) {
  std::filesystem::create_directories(folder);
  const std::string extension = files.binary ? ".bin" : ".txt";
  std::ofstream(folder / ("cameras" + extension), std::ios::binary) << files.cameras;
  std::ofstream(folder / ("images" + extension), std::ios::binary) << files.images;
  std::ofstream(folder / ("points3D" + extension), std::ios::binary) << files.points;
}

}  // namespace jade::test
