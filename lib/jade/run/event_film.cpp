// SPDX-License-Identifier: Apache-2.0
#include "jade/run/event_film.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace jade::run {
namespace {

struct Grid {
  int64_t bins, cell;
};
constexpr std::array<Grid, 6> kGrids{{{32, 1}, {16, 1}, {8, 1}, {8, 2}, {8, 4}, {8, 8}}};

void put_number(std::string& out, int64_t value) {
  for (; value > 127; value >>= 7) out += static_cast<char>(128 | (value & 127));
  out += static_cast<char>(value);
}

/// The signs of one step, accumulated event by event.
class Step {
 public:
  explicit Step(int64_t cells) : sum_(static_cast<size_t>(cells)), last_(sum_.size()) {}

  void add(int64_t cell, int polarity) {
    const auto at = static_cast<size_t>(cell);
    if (last_[at] == 0) touched_.push_back(cell);
    sum_[at] += polarity;
    last_[at] = static_cast<int8_t>(polarity);
  }

  void write(EventFilm& film) {
    std::sort(touched_.begin(), touched_.end());
    for (const int wanted : {-1, 1}) {
      std::vector<int64_t> cells;
      for (const int64_t cell : touched_) {
        const auto at = static_cast<size_t>(cell);
        const int sign = sum_[at] != 0 ? (sum_[at] > 0 ? 1 : -1) : last_[at];
        if (sign == wanted) cells.push_back(cell);
      }
      put_number(film.bytes, static_cast<int64_t>(cells.size()));
      int64_t before = -1;
      for (const int64_t cell : cells) {
        put_number(film.bytes, cell - before - 1);
        before = cell;
      }
    }
    film.marks += static_cast<int64_t>(touched_.size());
    for (const int64_t cell : touched_) {
      sum_[static_cast<size_t>(cell)] = 0;
      last_[static_cast<size_t>(cell)] = 0;
    }
    touched_.clear();
  }

 private:
  std::vector<int32_t> sum_;
  std::vector<int8_t> last_;  ///< 0: no event yet
  std::vector<int64_t> touched_;
};

/// The film, or its beginning if it takes more than `limit` bytes.
EventFilm film_of(const data::Exposure& exposure, const Grid& grid, size_t limit) {
  const auto [bins, cell] = grid;
  const int64_t width = exposure.camera.width, height = exposure.camera.height;
  EventFilm film{bins, (width + cell - 1) / cell, (height + cell - 1) / cell, cell, 0, 0, {}};
  Step step(film.columns * film.rows);
  for (int64_t bin = 0; bin < bins && film.bytes.size() <= limit; ++bin) {
    const auto bound = [&](int64_t k) {
      return exposure.t_start_us + exposure.duration_us() * k / bins;
    };
    const events::EventStream events = exposure.events.slice(bound(bin), bound(bin + 1));
    const auto* x = events.x().data_ptr<float>();
    const auto* y = events.y().data_ptr<float>();
    const auto* polarity = events.polarity().data_ptr<int8_t>();
    for (int64_t i = 0; i < events.size(); ++i) {
      // NaN and places outside fail the comparison.
      if (!(x[i] > -0.5f && y[i] > -0.5f && x[i] < static_cast<float>(width) - 0.5f &&
            y[i] < static_cast<float>(height) - 0.5f)) {
        continue;
      }
      ++film.events;
      step.add(std::lround(y[i]) / cell * film.columns + std::lround(x[i]) / cell, polarity[i]);
    }
    step.write(film);
  }
  return film;
}

}  // namespace

EventFilm event_film(const data::Exposure& exposure, size_t limit) {
  EventFilm film;
  if (exposure.duration_us() <= 0 || exposure.events.empty()) return film;
  for (size_t i = 0; i < kGrids.size(); ++i) {
    const bool coarsest = i + 1 == kGrids.size();
    film = film_of(exposure, kGrids[i], coarsest ? SIZE_MAX : limit);
    if (film.bytes.size() <= limit) break;
  }
  return film;
}

}  // namespace jade::run
