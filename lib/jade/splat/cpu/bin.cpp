// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/cpu/bin.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#include "jade/core/error.h"
#include "jade/splat/cpu/tile_box.h"

namespace jade::splat::cpu {

namespace {

template <class T>
using KeyOf = std::conditional_t<sizeof(T) == 4, uint32_t, uint64_t>;

/// The box travels along, as looking it up in the order of depth would miss the cache.
template <class T>
struct Entry {
  KeyOf<T> key;
  int32_t index;
  TileBox box;
};

/// Least significant digit first, 11 bits at a time: stable, so equal depths keep the index order.
template <class T>
void sort_by_key(std::vector<Entry<T>>& entries) {
  constexpr int kBits = 11, kBuckets = 1 << kBits;
  constexpr int kPasses = (8 * sizeof(KeyOf<T>) + kBits - 1) / kBits;
  std::vector<std::array<int64_t, kBuckets>> counts(kPasses);
  for (auto& pass : counts) pass.fill(0);
  for (const Entry<T>& entry : entries) {
    for (int pass = 0; pass < kPasses; ++pass) {
      ++counts[pass][(entry.key >> (pass * kBits)) & (kBuckets - 1)];
    }
  }
  std::vector<Entry<T>> other(entries);
  const int64_t size = static_cast<int64_t>(entries.size());
  for (int pass = 0; pass < kPasses; ++pass) {
    auto& count = counts[pass];
    if (size == 0 || count[(entries[0].key >> (pass * kBits)) & (kBuckets - 1)] == size) continue;
    int64_t sum = 0;
    for (int64_t& c : count) sum += std::exchange(c, sum);
    for (const Entry<T>& entry : entries) {
      other[count[(entry.key >> (pass * kBits)) & (kBuckets - 1)]++] = entry;
    }
    entries.swap(other);
  }
}

template <class T>
bool is_visible(const Splat<T>& splat) {
  return splat.x0 < splat.x1;
}

}  // namespace

template <class T>
int64_t assign_slots(Splat<T>* splats, int64_t count, const TileGrid& grid) {
  int64_t total = 0;
  for (int64_t i = 0; i < count; ++i) {
    if (!is_visible(splats[i])) continue;
    splats[i].slot = static_cast<uint32_t>(total);
    total += TileBox(splats[i], grid.shift).count();
    if (total > std::numeric_limits<uint32_t>::max()) {
      throw DeviceError(concat("one view has more than 4294967295 (Gaussian, tile) pairs among ",
                               count, " Gaussians: render fewer or smaller ones"));
    }
  }
  return total;
}

template <class T>
void fill_lists(const Splat<T>* splats, int64_t count, const TileGrid& grid, int64_t* offsets,
                int32_t* list) {
  std::vector<Entry<T>> order;
  order.reserve(static_cast<size_t>(count));
  std::vector<int64_t> next(static_cast<size_t>(grid.tiles()) + 1, 0);
  for (int64_t i = 0; i < count; ++i) {
    if (!is_visible(splats[i])) continue;
    const TileBox box(splats[i], grid.shift);
    KeyOf<T> key;  // depths are positive, so their bits sort as they do
    std::memcpy(&key, &splats[i].depth, sizeof(T));
    order.push_back({key, static_cast<int32_t>(i), box});
    for (int y = box.y0; y <= box.y1; ++y) {
      for (int x = box.x0; x <= box.x1; ++x) ++next[int64_t{y} * grid.columns + x];
    }
  }
  int64_t sum = 0;
  for (int64_t t = 0; t <= grid.tiles(); ++t) {
    offsets[t] = sum;
    sum += std::exchange(next[t], sum);
  }
  sort_by_key(order);
  for (const Entry<T>& entry : order) {
    const TileBox& box = entry.box;
    for (int y = box.y0; y <= box.y1; ++y) {
      for (int x = box.x0; x <= box.x1; ++x) {
        list[next[int64_t{y} * grid.columns + x]++] = entry.index;
      }
    }
  }
}

template int64_t assign_slots(Splat<float>*, int64_t, const TileGrid&);
template int64_t assign_slots(Splat<double>*, int64_t, const TileGrid&);
template void fill_lists(const Splat<float>*, int64_t, const TileGrid&, int64_t*, int32_t*);
template void fill_lists(const Splat<double>*, int64_t, const TileGrid&, int64_t*, int32_t*);

}  // namespace jade::splat::cpu
