// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/folders.h"

#include <map>
#include <string>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"

namespace jade::eval {

namespace fs = std::filesystem;

Evaluation compare_folders(const fs::path& renders, const fs::path& truth, const Lpips& lpips) {
  std::map<std::string, fs::path> by_name;
  for (const fs::path& path : imaging::list_images(renders)) by_name[path.stem().string()] = path;
  std::vector<Scores> scores;
  for (const fs::path& path : imaging::list_images(truth)) {
    const auto found = by_name.find(path.stem().string());
    if (found == by_name.end()) {
      throw DataError(concat(renders.string(), ": expected an image named ", path.stem().string(),
                             " as in ", truth.string(), ", found none"));
    }
    const auto image = imaging::read_image(found->second), reference = imaging::read_image(path);
    if (image.sizes() != reference.sizes()) {
      throw DataError(concat(found->second.string(), ": expected ", reference.size(2), "x",
                             reference.size(1), " as ", path.string(), ", found ", image.size(2),
                             "x", image.size(1)));
    }
    scores.push_back(score(path.stem().string(), image, reference, &lpips));
  }
  if (scores.empty()) throw DataError(concat(truth.string(), ": expected images, found none"));
  return evaluation_of(std::move(scores));
}

}  // namespace jade::eval
