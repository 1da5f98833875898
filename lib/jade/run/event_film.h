// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "jade/data/exposure.h"

namespace jade::run {

/// The events of an exposure in equal steps of time, as bytes that pack well.
///
/// A step has a sign per cell of the picture (`cell` pixels wide and high): that of the sum of the
/// polarities there, of a sum of zero that of the last event. For every step, first for −1 and then
/// for +1: how many cells have that sign, and for each of them, row by row, how many cells lie
/// between it and the one before (the first: and the picture's beginning). Each number is 7 bits
/// per byte, the low ones first, the high bit set where more follow.
struct EventFilm {
  int64_t bins = 0;  ///< steps of time
  int64_t columns = 0, rows = 0, cell = 1;
  int64_t events = 0;  ///< of the exposure that lie in the picture
  int64_t marks = 0;   ///< signs in the film
  std::string bytes;
};

/// Bytes of a film before gzip. What would take more gets longer steps, then larger cells.
inline constexpr size_t kFilmBytes = 200'000;

/// The film of an exposure, the finest that `limit` allows, or the coarsest (8 steps, cells of 8
/// pixels). Events outside the picture do not count.
EventFilm event_film(const data::Exposure& exposure, size_t limit = kFilmBytes);

}  // namespace jade::run
