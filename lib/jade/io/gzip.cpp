// SPDX-License-Identifier: Apache-2.0
#include "jade/io/gzip.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>
#include <zlib.h>

#include "jade/core/error.h"

namespace jade::io {
namespace {

constexpr int kGzipWindow = 15 + 16;
constexpr size_t kPart = 1 << 20;

/// Bytes that one thread deflates at a time.
constexpr size_t kBlock = size_t{256} << 10;
/// How far deflate refers back.
constexpr size_t kWindow = size_t{32} << 10;

struct InflateEnd {
  void operator()(z_stream* stream) const { inflateEnd(stream); }
};

struct DeflateEnd {
  void operator()(z_stream* stream) const { deflateEnd(stream); }
};

/// Deflates a block of `content` that refers to the bytes before it, so that all blocks in a row
/// are one stream. All but the last end at a whole byte.
std::string deflated(const std::string& content, size_t begin, bool is_last) {
  const auto* const bytes = reinterpret_cast<const Bytef*>(content.data());
  const size_t size = std::min(kBlock, content.size() - begin), before = std::min(begin, kWindow);
  z_stream stream{};
  if (deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, -MAX_WBITS, MAX_MEM_LEVEL,
                   Z_DEFAULT_STRATEGY) != Z_OK) {
    throw DataError("zlib cannot start");
  }
  const std::unique_ptr<z_stream, DeflateEnd> end(&stream);
  if (before > 0) deflateSetDictionary(&stream, bytes + begin - before, static_cast<uInt>(before));
  constexpr size_t kMarker = 16;  // at most, of the end of a block
  std::string out(deflateBound(&stream, static_cast<uLong>(size)) + kMarker, '\0');
  stream.next_in = const_cast<Bytef*>(bytes + begin);
  stream.avail_in = static_cast<uInt>(size);
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int result = deflate(&stream, is_last ? Z_FINISH : Z_SYNC_FLUSH);
  if (result != (is_last ? Z_STREAM_END : Z_OK) || stream.avail_out == 0) {
    throw DataError(concat("zlib failed (", result, ")"));
  }
  out.resize(stream.total_out);
  return out;
}

void put_little_endian(std::string& out, uint64_t value) {
  for (int shift = 0; shift < 32; shift += 8) out += static_cast<char>(value >> shift & 255);
}

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

GzipOrPlainFile::GzipOrPlainFile(const std::filesystem::path& path) : path_(path) {
  std::error_code error;
  const gzFile file =
      std::filesystem::is_directory(path, error) ? nullptr : gzopen(path.c_str(), "rb");
  if (file == nullptr)
    throw DataError(concat(path.string(), ": no such file, or it cannot be read"));
  file_ = std::shared_ptr<void>(file, [](void* open) { gzclose(static_cast<gzFile>(open)); });
  gzbuffer(file, static_cast<unsigned>(kPart));
}

size_t GzipOrPlainFile::read(char* out, size_t size) {
  const auto file = static_cast<gzFile>(file_.get());
  const int count = gzread(file, out, static_cast<unsigned>(size));
  int error = Z_OK;
  if (count < 0 || static_cast<size_t>(count) < size) gzerror(file, &error);
  if (error == Z_OK || error == Z_STREAM_END) return static_cast<size_t>(count);
  if (error == Z_ERRNO)
    throw DataError(concat(path_.string(), ": the file cannot be read to its end"));
  throw DataError(
      concat(path_.string(), ": expected a whole gzip file, found a damaged one; copy it again"));
}

std::string gzip(const std::string& content) {
  const size_t count = std::max<size_t>(1, (content.size() + kBlock - 1) / kBlock);
  std::vector<std::string> blocks(count);
  at::parallel_for(0, int64_t(count), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      blocks[size_t(i)] = deflated(content, size_t(i) * kBlock, size_t(i) + 1 == count);
    }
  });
  std::string out("\x1f\x8b\x08\0\0\0\0\0\0\x03", 10);  // deflate, no name and time, Unix
  for (const std::string& block : blocks) out += block;
  const auto* const bytes = reinterpret_cast<const Bytef*>(content.data());
  put_little_endian(out, crc32_z(0, bytes, content.size()));
  put_little_endian(out, content.size());
  return out;
}

}  // namespace jade::io
