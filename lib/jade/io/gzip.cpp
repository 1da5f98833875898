// SPDX-License-Identifier: Apache-2.0
#include "jade/io/gzip.h"

#include <algorithm>
#include <memory>
#include <zlib.h>

#include "jade/core/error.h"

namespace jade::io {
namespace {

constexpr int kGzipWindow = 15 + 16;
constexpr size_t kPart = 1 << 20;

struct InflateEnd {
  void operator()(z_stream* stream) const { inflateEnd(stream); }
};

}  // namespace

bool is_gzip(std::string_view bytes) { return bytes.substr(0, 2) == "\x1f\x8b"; }

std::string gunzip(std::string_view bytes, const std::string& name, size_t at_most) {
  z_stream stream{};
  if (inflateInit2(&stream, kGzipWindow) != Z_OK) throw DataError("zlib cannot start");
  const std::unique_ptr<z_stream, InflateEnd> end(&stream);
  std::string out;
  int result = Z_OK;
  size_t read = 0;
  while (result != Z_STREAM_END && out.size() < at_most) {
    const size_t before = out.size();
    out.resize(before + std::min(kPart, at_most - before));
    const size_t left = std::min(kPart, bytes.size() - read);
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data() + read));
    stream.avail_in = static_cast<uInt>(left);
    stream.next_out = reinterpret_cast<Bytef*>(out.data() + before);
    stream.avail_out = static_cast<uInt>(out.size() - before);
    result = inflate(&stream, Z_NO_FLUSH);
    read += left - stream.avail_in;
    out.resize(out.size() - stream.avail_out);
    const bool stuck = left == 0 && out.size() == before;
    if ((result != Z_OK && result != Z_STREAM_END && result != Z_BUF_ERROR) || stuck) {
      throw DataError(
          concat(name, ": expected a whole gzip file, found a damaged one; copy it ", "again"));
    }
  }
  return out;
}

std::string gzip(const std::string& content) {
  z_stream stream{};
  if (deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, kGzipWindow, 9,
                   Z_DEFAULT_STRATEGY) != Z_OK) {
    throw DataError("zlib cannot start");
  }
  std::string out(deflateBound(&stream, static_cast<uLong>(content.size())), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(content.data()));
  stream.avail_in = static_cast<uInt>(content.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int result = deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  if (result != Z_STREAM_END) throw DataError(concat("zlib failed (", result, ")"));
  return out;
}

}  // namespace jade::io
