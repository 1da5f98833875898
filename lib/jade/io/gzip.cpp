// SPDX-License-Identifier: Apache-2.0
#include "jade/io/gzip.h"

#include <zlib.h>

#include "jade/core/error.h"

namespace jade::io {

std::string gzip(const std::string& content) {
  z_stream stream{};
  const int gzip_window = 15 + 16;
  if (deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, gzip_window, 9,
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
