// SPDX-License-Identifier: Apache-2.0
#include "support/stub_restorer.h"

#include <torch/script.h>

namespace jade::test {

const char* const kStubMetadata =
    R"({"format": "jade-restorer", "format_version": 1, "kind": "efnet",
  "name": "probe", "width": 1, "parameters": 0, "input": "scer", "normalization": "max_abs",
  "channel_order": "rgb", "padding_multiple": 4, "minimum_size": 8, "uses_mask": true,
  "dtype": "float32", "weights_sha256": "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855", "source": "test"})";

std::filesystem::path save_restorer(const std::filesystem::path& path, const std::string& body,
                                    const std::string& metadata, const std::string& inputs) {
  torch::jit::Module module("probe");
  module.define("def forward(self, " + inputs + "):\n" + body);
  module.save(path.string(), {{"jade_efnet.json", metadata}});
  return path;
}

const char* const kAnyTimeMetadata =
    R"({"format": "jade-restorer", "format_version": 2, "kind": "efnet",
  "name": "anytime", "width": 1, "parameters": 0, "input": "counts", "windows": 4,
  "normalization": "inside", "any_time": true, "channel_order": "rgb", "padding_multiple": 4,
  "minimum_size": 8, "uses_mask": false, "dtype": "float32",
  "weights_sha256": "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855", "source": "test"})";

std::filesystem::path save_any_time_restorer(const std::filesystem::path& path,
                                             const std::string& body, const std::string& metadata) {
  return save_restorer(path, body, metadata, "image, counts, time");
}

}  // namespace jade::test
