// SPDX-License-Identifier: Apache-2.0
#include <cstdint>
#include <cstdlib>

#include "fuzz/input_file.h"
#include "jade/core/error.h"
#include "jade/recording/evt.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
  const jade::test::InputFile file(bytes, size);
  try {
    jade::recording::EvtDecoder decoder(file.path());
    jade::recording::EvtEvents events;
    while (decoder.next(100, events)) {
      if (events.size() > 131) std::abort();
    }
  } catch (const jade::DataError&) {
  }
  return 0;
}
