// SPDX-License-Identifier: Apache-2.0
#include <cstdint>

#include "jade/core/error.h"
#include "jade/data/llff.h"
#include "jade/io/npy.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
  try {
    jade::data::parse_llff(jade::io::parse_npy(bytes, size, "poses_bounds.npy"),
                           "poses_bounds.npy");
  } catch (const jade::DataError&) {
  }
  return 0;
}
