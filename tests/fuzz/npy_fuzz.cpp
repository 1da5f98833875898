// SPDX-License-Identifier: Apache-2.0
#include <cstdint>

#include "jade/core/error.h"
#include "jade/io/npy.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
  try {
    jade::io::parse_npy(bytes, size, "input.npy");
  } catch (const jade::DataError&) {
  }
  return 0;
}
