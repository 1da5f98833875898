// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdint>
#include <vector>

#include "fuzz/input_file.h"
#include "jade/core/error.h"
#include "jade/io/hdf5.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
  const jade::test::InputFile file(bytes, size);
  try {
    const jade::io::Hdf5File hdf5(file.path());
    for (const jade::io::Hdf5Dataset& dataset : hdf5.datasets()) {
      try {
        const int64_t count = std::min<int64_t>(hdf5.length(dataset.name), 1 << 20);
        std::vector<int64_t> values(static_cast<size_t>(count));
        hdf5.read(dataset.name, 0, count, values.data());
      } catch (const jade::DataError&) {
      }
    }
  } catch (const jade::DataError&) {
  }
  return 0;
}
