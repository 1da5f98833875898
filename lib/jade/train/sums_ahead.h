// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <future>

#include "jade/data/dataset.h"
#include "jade/restore/restored_exposure.h"

namespace jade::train {

/// Computes restore::sum_events() of a data set's training exposures in order, and those of the
/// next exposures ahead of time on other threads.
class SumsAhead {
 public:
  /// All arguments must outlive it.
  /// @param network  as in sum_events()
  /// @param policy   std::launch::deferred: computes nothing ahead of time
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
  // last member: destroyed before the data that it reads
  std::deque<std::future<restore::ExposureSums>> begun_;
};

}  // namespace jade::train
