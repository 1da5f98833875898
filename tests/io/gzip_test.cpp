// SPDX-License-Identifier: Apache-2.0
#include "jade/io/gzip.h"

#include "support/catch.h"

#include <ATen/Parallel.h>
#include <zlib.h>

#include "jade/core/error.h"
#include "support/naming.h"
#include "support/temp_dir.h"

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
  for (const size_t size : {0, 1, 1000, 262143, 262144, 262145, 786432, 1000000}) {
    std::string bytes;
    for (size_t k = 0; k < size; ++k) bytes += static_cast<char>(k * k % 251);
    const std::string packed = io::gzip(bytes);
    CHECK(packed.substr(0, 2) == "\x1f\x8b");
    CHECK(unpacked(packed, size) == bytes);
    CHECK(io::is_gzip(packed));
    CHECK(io::gunzip(packed, "a") == bytes);
    CHECK(io::gunzip(packed, "a", 10) == bytes.substr(0, 10));
  }
  const std::string long_one = io::gzip(std::string(5'000'000, 'b'));
  CHECK(io::gunzip(long_one, "a").size() == 5'000'000);
  CHECK_THROWS_AS(io::gunzip(long_one.substr(0, long_one.size() - 1), "a"), DataError);
  CHECK_THROWS_AS(io::gunzip("no gzip at all", "a"), DataError);
  CHECK_FALSE(io::is_gzip(""));
  CHECK(io::gzip(std::string(100000, 'a')).size() < 1000);
}

TEST_CASE("gzip: a plain and a compressed file are read in pieces, a damaged one is named",
          "[io]") {
  const test::TempDir dir;
  std::string bytes;
  for (size_t k = 0; k < 3000000; ++k) bytes += static_cast<char>(k * k % 251);
  const std::string packed = io::gzip(bytes);
  const auto whole = [](const std::filesystem::path& path) {
    io::GzipOrPlainFile file(path);
    std::string out, piece(1000000, '\0');
    while (const size_t count = file.read(piece.data(), piece.size())) out.append(piece, 0, count);
    return out;
  };
  CHECK(whole(dir.write("plain.txt", bytes)) == bytes);
  CHECK(whole(dir.write("packed.gz", packed)) == bytes);
  CHECK(whole(dir.write("empty.txt", "")).empty());
  CHECK_THROWS_WITH(whole(dir.write("cut.gz", packed.substr(0, packed.size() / 2))),
                    test::naming("cut.gz", "damaged"));
  std::string spoilt = packed;
  spoilt[packed.size() / 2] ^= 0x55;
  CHECK_THROWS_WITH(whole(dir.write("spoilt.gz", spoilt)), test::naming("spoilt.gz", "damaged"));
  CHECK_THROWS_AS(io::GzipOrPlainFile(dir / "missing"), DataError);
}

TEST_CASE("gzip: blocks refer to those before, and threads do not change the result", "[io]") {
  std::string bytes;
  uint32_t random = 1;
  for (size_t k = 0; k < 20000; ++k) {
    random = random * 1664525 + 1013904223;
    bytes += static_cast<char>(random >> 24);
  }
  std::string many;
  for (int k = 0; k < 60; ++k) many += bytes;
  const std::string packed = io::gzip(many);
  CHECK(packed.size() < 2 * bytes.size());
  const int threads = at::get_num_threads();
  at::set_num_threads(threads == 1 ? 2 : 1);
  CHECK(io::gzip(many) == packed);
  at::set_num_threads(threads);
}
