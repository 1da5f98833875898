// SPDX-License-Identifier: Apache-2.0
// Processes blocks of values: cells, knots and results each in a plain loop over small arrays,
// which the compiler vectorises; only the sums over the cells are scalar. Nothing is fused, so all
// machines give the same bits. Compiled once per instruction set by jade_add_isa_sources().
#pragma once

#include "jade/response/lookup_band.h"

namespace jade::response {
namespace JADE_ISA {

constexpr int kBlock = 256;

/// The cells of up to kBlock values and the table values at both of their ends.
template <class T>
struct CellBlock {
  int32_t index[kBlock];
  T fraction[kBlock], lower[kBlock], upper[kBlock];
};

template <class T>
JADE_HD void find_cells(const T* __restrict image, const T* __restrict table, int count,
                        CellBlock<T>& cells) {
  for (int i = 0; i < count; ++i) {
    const Cell<T> cell = cell_of(image[i]);
    cells.index[i] = cell.index;
    cells.fraction[i] = cell.fraction;
  }
  for (int i = 0; i < count; ++i) {
    cells.lower[i] = table[cells.index[i]];
    cells.upper[i] = table[cells.index[i] + 1];
  }
}

/// Calls work(first value, count, cells) for each block.
template <class T, class Work>
JADE_HD void for_blocks(const LookupRun<T>& run, const Work& work) {
  CellBlock<T> cells;
  for (int64_t begin = 0; begin < run.count; begin += kBlock) {
    const int count = static_cast<int>(run.count - begin < kBlock ? run.count - begin : kBlock);
    find_cells(run.image + begin, run.table, count, cells);
    work(begin, count, cells);
  }
}

template <class T>
JADE_HD T value_of(const CellBlock<T>& cells, int i) {
  return interpolate(Cell<T>{cells.index[i], cells.fraction[i]}, cells.lower[i], cells.upper[i]);
}

template <class T>
void values(const LookupRun<T>& run, T* out) {
  for_blocks(run, [&](int64_t begin, int count, const CellBlock<T>& cells) {
    T* __restrict to = out + begin;
    for (int i = 0; i < count; ++i) to[i] = value_of(cells, i);
  });
}

template <class T>
void add_values(const LookupRun<T>& run, T* out) {
  for_blocks(run, [&](int64_t begin, int count, const CellBlock<T>& cells) {
    T* __restrict to = out + begin;
    for (int i = 0; i < count; ++i) to[i] += run.weight * value_of(cells, i);
  });
}

template <class T>
void gradients(const LookupRun<T>& run, const T* gradient, T* of_image, double* of_cells) {
  for_blocks(run, [&](int64_t begin, int count, const CellBlock<T>& cells) {
    T g[kBlock];
    for (int i = 0; i < count; ++i) g[i] = gradient[begin + i] * run.weight;
    if (of_image != nullptr) {
      T* __restrict to = of_image + begin;
      for (int i = 0; i < count; ++i) to[i] = gradient_of_x(g[i], cells.lower[i], cells.upper[i]);
    }
    if (of_cells == nullptr) return;
    double sums[2 * kBlock];
    for (int i = 0; i < count; ++i) {
      sums[2 * i] = static_cast<double>(g[i]);
      sums[2 * i + 1] =
          static_cast<double>(gradient_of_upper(Cell<T>{cells.index[i], cells.fraction[i]}, g[i]));
    }
    for (int i = 0; i < count; ++i) {
      double* const to = of_cells + 2 * cells.index[i];
      to[0] += sums[2 * i];
      to[1] += sums[2 * i + 1];
    }
  });
}

const LookupKernelSet kLookupKernels = {{values<float>, add_values<float>, gradients<float>},
                                        {values<double>, add_values<double>, gradients<double>}};

}  // namespace JADE_ISA
}  // namespace jade::response
