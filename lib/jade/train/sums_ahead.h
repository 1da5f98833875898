// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <future>

#include "jade/data/dataset.h"
#include "jade/restore/restored_exposure.h"

namespace jade::train {

/// restore::sum_events() of a data set's training exposures, one after the other; those that come
/// next are summed on threads of their own meanwhile.
class SumsAhead {
 public:
  /// All that is given must outlive it.
  /// @param network  as sum_events() takes it
  /// @param policy   std::launch::deferred: nothing is summed before it is asked for
  SumsAhead(const data::Dataset& dataset, const restore::RestoreOptions& options,
            const restore::RestorerMetadata* network, std::launch policy);

  /// Sums of the next exposure. Call it at most once per exposure.
  restore::ExposureSums next();

 private:
  void begin();

  const data::Dataset& dataset_;
  const restore::RestoreOptions& options_;
  const restore::RestorerMetadata* network_;
  std::launch policy_;
  size_t at_once_ = 1, begun_upto_ = 0;
  std::deque<std::future<restore::ExposureSums>> begun_;  // last: ends before what it reads
};

}  // namespace jade::train
