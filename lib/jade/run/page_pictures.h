// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <torch/types.h>
#include <utility>
#include <vector>

namespace jade::run {

/// The pictures of a report, as sources of the page's images. Each is encoded once, on all threads
/// in batches.
class PagePictures {
 public:
  /// Entry of a picture in the page's data: "name", "src", which is its key until put_into(), and
  /// with a true image "note", its PSNR.
  /// @param camera  of the page, whose pictures have different names
  nlohmann::ordered_json add(const std::string& camera, const std::string& name,
                             const torch::Tensor& image, const torch::Tensor& truth = {},
                             const torch::Tensor& mask = {});

  /// Encodes what is not yet encoded.
  void encode();

  /// Encodes, and replaces the keys by the sources.
  /// @param views  with "pictures" from add()
  void put_into(nlohmann::ordered_json& views);

 private:
  std::vector<std::pair<std::string, torch::Tensor>> images_;  ///< to be encoded, by key
  size_t bytes_ = 0;                                           ///< of these
  std::map<std::string, std::string> sources_;                 ///< by key
};

}  // namespace jade::run
