// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/decoder_output.h"

#include "support/catch.h"

#include <cstdio>
#include <iostream>
#include <sstream>
#include <string>
#include <thread>

namespace jade::imaging {
namespace {

TEST_CASE("decoder output: what a thread prints is collected for it alone", "[imaging]") {
  std::ostringstream shown;
  std::streambuf* const before = std::cerr.rdbuf(shown.rdbuf());
  FILE* const stream = stderr;
  {
    const DecoderOutput output;
    std::thread([] { std::cerr << "of another thread\n"; }).join();
    std::cerr << "one" << '\n' << std::flush;
    std::fprintf(stderr, "number %d", 2);
    const DecoderOutput inner;
    std::cerr << "three";
    CHECK(output.text() == "one\nnumber 2");
    CHECK(inner.text() == "three");
  }
  CHECK(stderr == stream);
  std::cerr << "after";
  CHECK(std::cerr.rdbuf(before) == shown.rdbuf());
  CHECK(shown.str() == "of another thread\nafter");
}

}  // namespace
}  // namespace jade::imaging
