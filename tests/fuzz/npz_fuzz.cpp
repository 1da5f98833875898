// SPDX-License-Identifier: Apache-2.0
#include <cstdint>

#include "fuzz/input_file.h"
#include "jade/core/error.h"
#include "jade/io/npy.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
  const jade::test::InputFile file(bytes, size);
  try {
    const jade::io::Npz archive(file.path());
    for (const std::string& name : archive.names()) {
      try {
        archive.read(name);
      } catch (const jade::DataError&) {
      }
    }
  } catch (const jade::DataError&) {
  }
  return 0;
}
