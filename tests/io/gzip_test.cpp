// SPDX-License-Identifier: Apache-2.0
#include "jade/io/gzip.h"

#include "support/catch.h"

#include <zlib.h>

using namespace jade;

namespace {

std::string unpacked(const std::string& packed, size_t size) {
  std::string out(size + 1, '\0');
  z_stream stream{};
  inflateInit2(&stream, 15 + 16);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int result = inflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  inflateEnd(&stream);
  CHECK(result == Z_STREAM_END);
  return out;
}

}  // namespace

TEST_CASE("gzip: what goes in comes out, whatever its length", "[io]") {
  for (const size_t size : {0, 1, 1000, 300000}) {
    std::string bytes;
    for (size_t k = 0; k < size; ++k) bytes += static_cast<char>(k * k % 251);
    const std::string packed = io::gzip(bytes);
    CHECK(packed.substr(0, 2) == "\x1f\x8b");
    CHECK(unpacked(packed, size) == bytes);
  }
  CHECK(io::gzip(std::string(100000, 'a')).size() < 1000);
}
