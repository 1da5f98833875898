// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/cpu/bin.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <memory>
#include <type_traits>
#include <utility>

#include "jade/core/error.h"
#include "jade/splat/cpu/tile_box.h"

namespace jade::splat::cpu {

namespace {

/// Depths are positive, so their bits sort like the numbers.
template <class T>
using KeyOf = std::conditional_t<sizeof(T) == 4, uint32_t, uint64_t>;

template <class T>
struct Entry {
  KeyOf<T> key;
  int32_t index;
};

constexpr int kMaxDigitBits = 9;  // about as many buckets as a tile has entries, a few hundred

template <class T>
bool is_visible(const Splat<T>& splat) {
  return splat.x0 < splat.x1;
}

/// Sorts by the digit of `bits` bits at `shift`, stably.
template <class E>
void sort_by_digit(const E* from, E* to, int64_t size, int shift, int bits) {
  std::array<uint32_t, 1 << kMaxDigitBits> next;
  const uint32_t mask = (1u << bits) - 1;
  std::fill_n(next.begin(), mask + 1, 0u);
  for (int64_t i = 0; i < size; ++i) ++next[(from[i].key >> shift) & mask];
  uint32_t sum = 0;
  for (uint32_t digit = 0; digit <= mask; ++digit) sum += std::exchange(next[digit], sum);
  for (int64_t i = 0; i < size; ++i) to[next[(from[i].key >> shift) & mask]++] = from[i];
}

}  // namespace

template <class T>
void count_instances(const Splat<T>* splats, int64_t begin, int64_t end, const TileGrid& grid,
                     uint32_t* counts) {
  std::fill_n(counts, grid.tiles(), 0u);
  for (int64_t i = begin; i < end; ++i) {
    if (!is_visible(splats[i])) continue;
    const TileBox box(splats[i], grid.shift);
    for (int y = box.y0; y <= box.y1; ++y) {
      for (int x = box.x0; x <= box.x1; ++x) ++counts[int64_t{y} * grid.columns + x];
    }
  }
}

int64_t assign_positions(uint32_t* counts, int64_t parts, int64_t tiles, int64_t* offsets,
                         uint32_t* slots) {
  std::fill_n(offsets, tiles + 1, int64_t{0});
  int64_t total = 0;
  for (int64_t part = 0; part < parts; ++part) {
    const uint32_t* const count = counts + part * tiles;
    int64_t sum = 0;
    for (int64_t t = 0; t < tiles; ++t) {
      offsets[t] += count[t];
      sum += count[t];
    }
    slots[part] = static_cast<uint32_t>(total);
    total += sum;
  }
  if (total > std::numeric_limits<uint32_t>::max()) {
    throw DeviceError(
        "one view has more than 4294967295 (Gaussian, tile) pairs: render fewer Gaussians or "
        "smaller ones");
  }
  int64_t sum = 0;
  for (int64_t t = 0; t <= tiles; ++t) sum += std::exchange(offsets[t], sum);
  const std::unique_ptr<uint32_t[]> next(new uint32_t[static_cast<size_t>(tiles)]);
  std::copy_n(offsets, tiles, next.get());
  for (int64_t part = 0; part < parts; ++part) {
    uint32_t* const count = counts + part * tiles;
    for (int64_t t = 0; t < tiles; ++t) next[t] += std::exchange(count[t], next[t]);
  }
  return total;
}

template <class T>
void place_instances(Splat<T>* splats, int64_t begin, int64_t end, const TileGrid& grid,
                     uint32_t slot, uint32_t* next, int32_t* list) {
  for (int64_t i = begin; i < end; ++i) {
    if (!is_visible(splats[i])) continue;
    const TileBox box(splats[i], grid.shift);
    splats[i].slot = slot;
    slot += static_cast<uint32_t>(box.count());
    for (int y = box.y0; y <= box.y1; ++y) {
      for (int x = box.x0; x <= box.x1; ++x) {
        list[next[int64_t{y} * grid.columns + x]++] = static_cast<int32_t>(i);
      }
    }
  }
}

template <class T>
void sort_by_depth(const Splat<T>* splats, int32_t* list, int64_t size) {
  if (size < 2) return;
  const std::unique_ptr<Entry<T>[]> both(new Entry<T>[static_cast<size_t>(2 * size)]);
  Entry<T>* from = both.get();
  Entry<T>* to = from + size;
  KeyOf<T> differing = 0;
  for (int64_t i = 0; i < size; ++i) {
    std::memcpy(&from[i].key, &splats[list[i]].depth, sizeof(T));
    from[i].index = list[i];
    differing |= from[i].key ^ from[0].key;
  }
  int width = 0;  // only bits up to the highest differing one matter
  for (; differing != 0; differing >>= 1) ++width;
  const int passes = (width + kMaxDigitBits - 1) / kMaxDigitBits;
  for (int pass = 0; pass < passes; ++pass) {
    const int first = width * pass / passes;
    sort_by_digit(from, to, size, first, width * (pass + 1) / passes - first);
    std::swap(from, to);
  }
  for (int64_t i = 0; i < size; ++i) list[i] = from[i].index;
}

template void count_instances(const Splat<float>*, int64_t, int64_t, const TileGrid&, uint32_t*);
template void count_instances(const Splat<double>*, int64_t, int64_t, const TileGrid&, uint32_t*);
template void place_instances(Splat<float>*, int64_t, int64_t, const TileGrid&, uint32_t, uint32_t*,
                              int32_t*);
template void place_instances(Splat<double>*, int64_t, int64_t, const TileGrid&, uint32_t,
                              uint32_t*, int32_t*);
template void sort_by_depth(const Splat<float>*, int32_t*, int64_t);
template void sort_by_depth(const Splat<double>*, int32_t*, int64_t);

}  // namespace jade::splat::cpu
