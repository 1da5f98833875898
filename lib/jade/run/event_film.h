// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "jade/data/exposure.h"

namespace jade::run {

/// The events of an exposure in equal time steps, encoded as bytes that compress well.
///
/// A step has one sign per cell of the picture (`cell` pixels wide and high): that of the sum of
/// its polarities or, if that is zero, of the last event. For every step, first for −1 and then for
/// +1: the number of cells with that sign, then for each of them, row by row, the number of cells
/// between it and the previous one (the first: and the picture's beginning). Each number has 7 bits
/// per byte, lowest first, with the high bit set if more follow.
struct EventFilm {
  int64_t bins = 0;  ///< steps of time
  int64_t columns = 0, rows = 0, cell = 1;
  int64_t events = 0;  ///< of the exposure inside the picture
  int64_t marks = 0;   ///< signs in the film
  std::string bytes;
};

/// Bytes of a film before gzip. Larger films get longer steps, then larger cells.
inline constexpr size_t kFilmBytes = 200'000;

/// The film of an exposure, the finest that `limit` allows, or the coarsest (8 steps, cells of 8
/// pixels). Ignores events outside the picture.
EventFilm event_film(const data::Exposure& exposure, size_t limit = kFilmBytes);

}  // namespace jade::run
