// SPDX-License-Identifier: Apache-2.0
// The first byte selects binary or text; the separator kCut splits the three files.
#include <cstdint>
#include <string>

#include "jade/core/error.h"
#include "jade/io/colmap.h"

namespace {

const std::string kCut = "<cut>";

std::string take(std::string& rest) {
  const size_t end = rest.find(kCut);
  std::string part = rest.substr(0, end);
  rest = end == std::string::npos ? "" : rest.substr(end + kCut.size());
  return part;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
  if (size == 0) return 0;
  std::string rest(reinterpret_cast<const char*>(bytes) + 1, size - 1);
  jade::io::ColmapFiles files;
  files.binary = bytes[0] % 2 == 0;
  files.name = "sparse/0";
  files.cameras = take(rest);
  files.images = take(rest);
  files.points = take(rest);
  try {
    jade::io::parse_colmap(files);
  } catch (const jade::DataError&) {
  }
  return 0;
}
