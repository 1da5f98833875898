// SPDX-License-Identifier: Apache-2.0
#include "jade/io/zstd.h"

#include <algorithm>
#include <memory>
#include <zstd.h>

#include "jade/core/error.h"

namespace jade::io {
namespace {

constexpr size_t kPart = 1 << 20;

struct FreeContext {
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

}  // namespace

std::string zstd(std::string_view content) {
  std::string out(ZSTD_compressBound(content.size()), '\0');
  const size_t size =
      ZSTD_compress(out.data(), out.size(), content.data(), content.size(), ZSTD_CLEVEL_DEFAULT);
  if (ZSTD_isError(size)) throw DataError(concat("zstd failed: ", ZSTD_getErrorName(size)));
  out.resize(size);
  return out;
}

std::string unzstd(std::string_view bytes, size_t size, const std::string& name) {
  const std::unique_ptr<ZSTD_DCtx, FreeContext> context(ZSTD_createDCtx());
  if (!context) throw DataError("zstd cannot start");
  ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
  std::string out;
  size_t left = 1;
  while (left != 0) {
    const size_t before = out.size();
    // One byte more than expected reveals content that is too long.
    out.resize(before + std::min(kPart, size + 1 - before));
    ZSTD_outBuffer part{out.data() + before, out.size() - before, 0};
    const size_t read_before = in.pos;
    left = ZSTD_decompressStream(context.get(), &part, &in);
    out.resize(before + part.pos);
    const bool stuck = part.pos == 0 && in.pos == read_before && left != 0;
    if (ZSTD_isError(left) || stuck || out.size() > size) break;
  }
  if (left == 0 && out.size() == size) return out;
  throw DataError(concat(name, ": expected a whole Zstandard stream of ", size,
                         " bytes, found a damaged one; copy the file again"));
}

}  // namespace jade::io
