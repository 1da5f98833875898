// SPDX-License-Identifier: Apache-2.0
// Which frames of a transforms layout train and which test.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "jade/data/dataset.h"
#include "jade/data/transforms_file.h"
#include "jade/data/warnings.h"

namespace jade::data {

/// The views to load and what they are for.
struct TransformsListing {
  std::vector<ListedView> views;
  std::vector<bool> is_test;
  std::string rule;            ///< the rule of the split, in words
  TransformsFile main;         ///< the main file without its views
  std::set<std::string> keys;  ///< with a value other than the default, from all files that are
                               ///< read
};

/// transforms.json, or transforms_train.json with the test views of transforms_test.json or, if
/// that is missing, of transforms_val.json.
/// @throws DataError if no training frame is left, and as read_transforms().
TransformsListing listing_of(const DatasetOptions& options, const Warnings& warnings);

}  // namespace jade::data
