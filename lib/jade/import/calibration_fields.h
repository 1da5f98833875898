// SPDX-License-Identifier: Apache-2.0
// Values in the maps of a calibration file. Private to this folder.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "jade/config/document.h"
#include "jade/geometry/lens.h"

namespace jade::import {

/// A map of the file, and its location for messages.
struct Section {
  const std::filesystem::path& path;
  std::string name;  ///< "cam0", or empty for the file itself
  const config::DocumentNode& node;

  std::string where(const std::string& key) const;
};

/// The value of a key. @throws DataError naming the key if it is missing.
const config::DocumentNode& require(const Section& section, const std::string& key,
                                    const std::string& meaning);

/// @throws DataError naming the key for other text.
double number(const Section& section, const std::string& key, const config::DocumentNode& node);

/// Numbers of a list, of a list of lists, or of a matrix with `data`, in the file's order.
/// @throws DataError naming the key for other values.
std::vector<double> numbers(const Section& section, const std::string& key,
                            const config::DocumentNode& node);

/// So many numbers of a key. @throws DataError naming the key for another count.
std::vector<double> numbers(const Section& section, const std::string& key,
                            const std::string& meaning, size_t count);

/// The text of a key; empty if it is missing or no text.
std::string word(const Section& section, const std::string& key);

/// Letters and digits of a name in lower case: files write camera_matrix, Camera_Matrix and
/// cameraMatrix.
std::string plain(const std::string& name);

/// Refuses a key that looks like a misspelt one of `known`, which the map lacks. Other unknown keys
/// pass: each tool writes some of its own.
/// @param known    plain() names
/// @param matters  whether the value is one that a known key could have
/// @throws DataError naming the key.
void refuse_misspelt(const Section& section, const std::vector<std::string>& known,
                     const std::function<bool(const config::DocumentNode&)>& matters);

/// Lens of four to eight coefficients in the order of OpenCV.
geometry::Lens radial_tangential(const std::vector<double>& k);
/// Lens of the four coefficients of Kannala and Brandt.
geometry::Lens fisheye(const std::vector<double>& k);
/// The lens, or none if it is perspective with coefficients of 0 only.
geometry::Lens checked(const geometry::Lens& lens, const std::vector<double>& k);

}  // namespace jade::import
