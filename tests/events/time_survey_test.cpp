// SPDX-License-Identifier: Apache-2.0
#include "jade/events/time_survey.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>

using namespace jade;
using events::Stretch;
using events::TimeSurvey;

namespace {

TimeSurvey survey_of(const std::vector<double>& times) {
  return {int64_t(times.size()), [&times](int64_t begin, int64_t count, double* out) {
            std::copy_n(times.begin() + begin, count, out);
          }};
}

int64_t position(const std::vector<double>& times, double time) {
  return std::lower_bound(times.begin(), times.end(), time) - times.begin();
}

}  // namespace

TEST_CASE("time survey: finds a span as a search of the whole list does", "[events]") {
  // More than one piece, with runs of equal times across its ends.
  std::vector<double> times;
  for (int64_t i = 0; i < 1200000; ++i) times.push_back(std::floor(double(i) / 7));
  const TimeSurvey survey = survey_of(times);
  CHECK(survey.sorted());
  CHECK(survey.finite());
  CHECK_FALSE(survey.has_fraction());
  CHECK(survey.smallest() == 0);
  CHECK(survey.largest() == times.back());
  for (const auto& [begin, end] : std::vector<std::pair<double, double>>{{-5, 3},
                                                                         {9362, 9363},
                                                                         {0, 1e9},
                                                                         {149796.5, 149797},
                                                                         {171000, 171429},
                                                                         {7, 7},
                                                                         {2e5, 3e5}}) {
    INFO(begin << " to " << end);
    const Stretch found = survey.between(begin, end);
    CHECK(found.begin == position(times, begin));
    CHECK(found.end == position(times, end));
  }
}

TEST_CASE("time survey: stretches are cut to a number of places", "[events]") {
  std::vector<Stretch> stretches{{5, 15}, {20, 24}, {30, 31}};
  shorten(stretches, 12);
  CHECK(stretches[0].size() == 10);
  CHECK(stretches[1].end == 22);
  CHECK(stretches[2].size() == 0);
}

TEST_CASE("time survey: finds the range of times, fractions and order", "[events]") {
  CHECK_FALSE(survey_of({1, 3, 2}).sorted());
  CHECK(survey_of({1, 1, 2}).sorted());
  CHECK(survey_of({1, 1.5}).has_fraction());
  CHECK_FALSE(survey_of({1, std::nan("")}).finite());
  CHECK(survey_of({}).between(0, 10).size() == 0);
}
