// SPDX-License-Identifier: Apache-2.0
// The update of learned poses over plain pointers: Adam by rows, and the removal of the gauge. A
// step has about a thousand numbers, so on a GPU only the number of launches matters.
#pragma once

#include <cstdint>

namespace jade::train {

/// One Adam step (RowAdam) of the rows with an accumulated gradient: seen > 0. The others keep
/// their bits.
struct RowStep {
  double* value = nullptr;
  double* first = nullptr;
  double* second = nullptr;
  double* gradient = nullptr;  ///< reset to 0, like `seen`
  double* steps = nullptr;     ///< [rows]
  int64_t* seen = nullptr;     ///< [rows]
  int64_t rows = 0;
  int64_t row = 0;  ///< numbers per row
  double lr = 0;
  double eps = 0;
};

/// Adds a step's gradient to the accumulated one, and counts one more for `row`.
struct RowGradient {
  const double* of = nullptr;  ///< [size], gradient of the step
  double* gradient = nullptr;  ///< [size]
  int64_t* seen = nullptr;     ///< [rows]
  const int64_t* row = nullptr;
  int64_t size = 0;
};

/// twists −= Σ_w write_w ⟨read_w, twists⟩ (PoseGauge).
struct GaugeStep {
  const double* read = nullptr;   ///< [ways, size]
  const double* write = nullptr;  ///< [ways, size]
  double* twists = nullptr;       ///< [size]
  double* along = nullptr;        ///< [ways], overwritten
  int64_t ways = 0;
  int64_t size = 0;
};

namespace cpu {
void accumulate(const RowGradient& step);
void update_rows(const RowStep& step);
void remove_gauge(const GaugeStep& step);
}  // namespace cpu

namespace cuda {
/// Run on the current stream of the current device; do not wait. @throws DeviceError.
void accumulate(const RowGradient& step);
void update_rows(const RowStep& step);
void remove_gauge(const GaugeStep& step);
}  // namespace cuda

}  // namespace jade::train
