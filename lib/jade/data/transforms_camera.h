// SPDX-License-Identifier: Apache-2.0
// The cameras of a transforms.json for the images as they are.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "jade/data/transforms_file.h"
#include "jade/data/warnings.h"
#include "jade/geometry/lens.h"

namespace jade::data {

/// The camera as listed; its size is that of its image if the file does not contain it.
geometry::Intrinsics sized_camera(const ListedView& view, int64_t width, int64_t height);

/// The camera for an image of width x height, with what the file leaves out.
geometry::LensCamera fit_camera(const ListedView& view, int64_t width, int64_t height);

/// Warns of cameras whose numbers contradict each other, or lie where only crops have them.
class DoubtfulCameras {
 public:
  void look(const ListedView& view, const geometry::Intrinsics& fitted, int64_t width,
            int64_t height);
  void tell(const std::filesystem::path& path, const Warnings& warnings) const;

 private:
  size_t differing_ = 0, beside_ = 0;
  std::string example_, centre_;
};

}  // namespace jade::data
