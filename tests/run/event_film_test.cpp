// SPDX-License-Identifier: Apache-2.0
#include "jade/run/event_film.h"

#include "support/catch.h"

#include <cmath>
#include <random>

using namespace jade;

namespace {

data::Exposure exposure_of(const std::vector<float>& x, const std::vector<float>& y,
                           const std::vector<int64_t>& t_us, const std::vector<int8_t>& polarity) {
  data::Exposure exposure;
  exposure.camera.width = 20;
  exposure.camera.height = 10;
  exposure.t_start_us = 1000;
  exposure.t_end_us = 1000 + 3200;
  exposure.events = events::EventStream::from_lists(x, y, t_us, polarity);
  return exposure;
}

/// The film read again as its header describes it: [bins][columns*rows] of −1, 0 and 1.
std::vector<std::vector<int>> signs_of(const run::EventFilm& film) {
  size_t at = 0;
  const auto number = [&] {
    int64_t value = 0;
    for (int shift = 0;; shift += 7) {
      const auto byte = static_cast<uint8_t>(film.bytes.at(at++));
      value |= int64_t{byte & 127} << shift;
      if (byte < 128) return value;
    }
  };
  std::vector<std::vector<int>> bins;
  for (int64_t bin = 0; bin < film.bins; ++bin) {
    std::vector<int> signs(static_cast<size_t>(film.columns * film.rows));
    for (const int sign : {-1, 1}) {
      size_t cell = 0;
      for (int64_t left = number(); left > 0; --left) {
        cell += static_cast<size_t>(number());
        signs.at(cell++) = sign;
      }
    }
    bins.push_back(signs);
  }
  CHECK(at == film.bytes.size());
  return bins;
}

}  // namespace

TEST_CASE("event_film: a sign per pixel and step, of the sum and else of the last", "[run]") {
  // Steps of 100 µs. Pixel 19,9 in step 0; pixel 3,2 thrice in step 31; pixel 4,2 plus, then minus.
  const auto exposure =
      exposure_of({19.2f, 3.f, 3.4f, 2.6f, 4, 4, 8}, {9.3f, 2, 2, 2, 2, 2, 2},
                  {1000, 4100, 4101, 4102, 4103, 4104, 4200}, {-1, 1, -1, 1, 1, -1, 1});
  const run::EventFilm film = run::event_film(exposure);
  CHECK(film.bins == 32);
  CHECK(film.columns == 20);
  CHECK(film.rows == 10);
  CHECK(film.cell == 1);
  CHECK(film.events == 6);  // the last one is at the end, which is not in the exposure
  CHECK(film.marks == 3);
  const auto signs = signs_of(film);
  CHECK(signs[0][9 * 20 + 19] == -1);
  CHECK(signs[31][2 * 20 + 3] == 1);
  CHECK(signs[31][2 * 20 + 4] == -1);
  CHECK(signs[31][2 * 20 + 8] == 0);
  CHECK(signs[30] == std::vector<int>(200));
}

TEST_CASE("event_film: events beside the picture and without a place do not count", "[run]") {
  const auto exposure =
      exposure_of({-0.6f, 19.5f, NAN, 5, 19, 19.4f}, {3, 3, 3, 9.6f, -0.7f, -0.4f},
                  {2000, 2000, 2000, 2000, 2000, 2000}, {1, 1, 1, 1, 1, 1});
  const run::EventFilm film = run::event_film(exposure);
  CHECK(film.events == 1);
  CHECK(signs_of(film)[10][19] == 1);
  CHECK(run::event_film(exposure_of({}, {}, {}, {})).marks == 0);
  data::Exposure sharp = exposure;
  sharp.t_end_us = sharp.t_start_us;
  CHECK(run::event_film(sharp).marks == 0);
}

TEST_CASE("event_film: longer steps and larger cells keep it below the limit", "[run]") {
  std::mt19937 random(1);
  std::vector<float> x, y;
  std::vector<int64_t> t_us;
  std::vector<int8_t> polarity;
  for (int64_t t = 1000; t < 4200; ++t) {
    x.push_back(static_cast<float>(random() % 20));
    y.push_back(static_cast<float>(random() % 10));
    t_us.push_back(t);
    polarity.push_back(random() % 2 ? 1 : -1);
  }
  const auto exposure = exposure_of(x, y, t_us, polarity);
  size_t before = run::event_film(exposure).bytes.size();
  CHECK(before > 2000);
  for (const auto& [limit, bins, cell] : {std::tuple(size_t{2200}, 16, 1),
                                          {size_t{1800}, 8, 1},
                                          {size_t{600}, 8, 2},
                                          {size_t{200}, 8, 4},
                                          {size_t{1}, 8, 8}}) {
    const run::EventFilm film = run::event_film(exposure, limit);
    CHECK(film.bins == bins);
    CHECK(film.cell == cell);
    CHECK(film.events == 3200);
    CHECK(film.bytes.size() < before);
    CHECK(film.columns == (20 + cell - 1) / cell);
    CHECK(film.rows == (10 + cell - 1) / cell);
    before = film.bytes.size();
    CHECK(signs_of(film).size() == static_cast<size_t>(bins));
  }
}
