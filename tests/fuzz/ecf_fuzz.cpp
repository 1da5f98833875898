// SPDX-License-Identifier: Apache-2.0
#include <cstdint>
#include <vector>

#include "jade/io/ecf.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
  std::vector<jade::io::EcfEvent> events;
  jade::io::decode_ecf(bytes, size, events);
  return 0;
}
