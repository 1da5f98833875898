// SPDX-License-Identifier: Apache-2.0
#include "jade/io/hdf5_chunks.h"

#include <ATen/Parallel.h>
#include <algorithm>
#include <atomic>
#include <cstring>
#include <memory>
#include <optional>
#include <vector>
#include <zlib.h>

#include "jade/io/hdf5_types.h"

namespace jade::io {
namespace {

using Stored = std::vector<uint8_t>;

/// Most inflated bytes of the chunks that are in memory at a time.
constexpr int64_t kBatchBytes = int64_t{32} << 20;

/// How the chunks of a data set are stored. Sizes in bytes.
struct Layout {
  hsize_t chunk_length = 0;  ///< in values
  size_t item_size = 0;
  bool shuffled = false;

  size_t chunk_size() const { return static_cast<size_t>(chunk_length) * item_size; }
};

bool is_number(hid_t type) {
  const H5T_class_t kind = H5Tget_class(type);
  return kind == H5T_INTEGER || kind == H5T_FLOAT;
}

/// Sets the filters, which must be deflate or shuffle and deflate.
bool find_filters(hid_t properties, Layout& layout) {
  std::vector<H5Z_filter_t> filters;
  unsigned shuffled_size = 0;
  for (int i = 0; i < H5Pget_nfilters(properties); ++i) {
    size_t count = 1;
    unsigned value = 0;
    filters.push_back(H5Pget_filter2(properties, static_cast<unsigned>(i), nullptr, &count, &value,
                                     0, nullptr, nullptr));
    if (filters.back() == H5Z_FILTER_SHUFFLE) shuffled_size = value;
  }
  layout.shuffled = filters.size() == 2;
  return filters == std::vector<H5Z_filter_t>{H5Z_FILTER_DEFLATE} ||
         (filters == std::vector<H5Z_filter_t>{H5Z_FILTER_SHUFFLE, H5Z_FILTER_DEFLATE} &&
          shuffled_size == layout.item_size);
}

/// The layout, unless H5Dread must read it.
std::optional<Layout> layout_of(hid_t dataset, hid_t stored, hid_t type) {
  const Hdf5Id space(H5Dget_space(dataset)), properties(H5Dget_create_plist(dataset));
  Layout layout;
  layout.item_size = H5Tget_size(stored);
  if (!is_number(stored) || !is_number(type) || layout.item_size > H5Tget_size(type) ||
      H5Sget_simple_extent_ndims(space) != 1 || H5Pget_layout(properties) != H5D_CHUNKED ||
      H5Pget_chunk(properties, 1, &layout.chunk_length) != 1 || layout.chunk_length == 0 ||
      layout.chunk_length > static_cast<hsize_t>(kBatchBytes) / layout.item_size ||
      !find_filters(properties, layout)) {
    return std::nullopt;
  }
  return layout;
}

/// The chunk at value `begin` as it is stored; empty if it cannot be read or skips a filter.
Stored stored_chunk(hid_t dataset, const Layout& layout, hsize_t begin) {
  hsize_t size = 0;
  if (H5Dget_chunk_storage_size(dataset, &begin, &size) < 0) return {};
  if (size > compressBound(static_cast<uLong>(layout.chunk_size()))) return {};
  Stored bytes(static_cast<size_t>(size));
  uint32_t skipped = 0;
  const bool read = H5Dread_chunk(dataset, H5P_DEFAULT, &begin, &skipped, bytes.data()) >= 0;
  return read && skipped == 0 ? bytes : Stored();
}

/// Inflates a chunk into `buffer`, of its size; false if it is damaged.
bool inflate_chunk(const Stored& stored, size_t size, uint8_t* buffer) {
  auto inflated = static_cast<uLongf>(size);
  return !stored.empty() &&
         uncompress(buffer, &inflated, stored.data(), static_cast<uLong>(stored.size())) == Z_OK &&
         inflated == size;
}

/// Copies values [begin, end) of an inflated chunk to `out`. A shuffled chunk has the first bytes
/// of all values, then their second bytes, and so on.
void copy_values(const Layout& layout, const uint8_t* chunk, size_t begin, size_t end,
                 uint8_t* out) {
  if (!layout.shuffled) {
    std::memcpy(out, chunk + begin * layout.item_size, (end - begin) * layout.item_size);
    return;
  }
  for (size_t byte = 0; byte < layout.item_size; ++byte) {
    const uint8_t* const from = chunk + byte * layout.chunk_length;
    uint8_t* to = out + byte;
    for (size_t i = begin; i < end; ++i, to += layout.item_size) *to = from[i];
  }
}

}  // namespace

bool read_deflated(hid_t dataset, int64_t begin, int64_t count, hid_t type, void* out) {
  const Hdf5Id stored(H5Dget_type(dataset));
  const std::optional<Layout> layout = layout_of(dataset, stored, type);
  if (!layout) return false;
  const auto length = static_cast<int64_t>(layout->chunk_length);
  const int64_t first = begin / length, end = (begin + count - 1) / length + 1;
  if (end - first < 3) return false;
  const int64_t batch = std::max<int64_t>(1, kBatchBytes / int64_t(layout->chunk_size()));
  std::atomic<bool> good{true};
  for (int64_t from = first; from < end && good; from += batch) {
    std::vector<Stored> chunks(static_cast<size_t>(std::min(batch, end - from)));
    for (size_t i = 0; i < chunks.size(); ++i) {
      const auto chunk = static_cast<hsize_t>(from) + i;
      chunks[i] = stored_chunk(dataset, *layout, chunk * layout->chunk_length);
    }
    at::parallel_for(0, int64_t(chunks.size()), 1, [&](int64_t task, int64_t last) {
      const std::unique_ptr<uint8_t[]> chunk(new uint8_t[layout->chunk_size()]);
      for (; task < last && good; ++task) {
        const int64_t start = (from + task) * length;
        const int64_t low = std::max(start, begin), high = std::min(start + length, begin + count);
        if (inflate_chunk(chunks[size_t(task)], layout->chunk_size(), chunk.get())) {
          copy_values(*layout, chunk.get(), size_t(low - start), size_t(high - start),
                      static_cast<uint8_t*>(out) + size_t(low - begin) * layout->item_size);
        } else {
          good = false;
        }
      }
    });
  }
  return good &&
         H5Tconvert(stored, type, static_cast<size_t>(count), out, nullptr, H5P_DEFAULT) >= 0;
}

}  // namespace jade::io
