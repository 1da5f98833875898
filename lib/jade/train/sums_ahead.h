// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <future>

#include "jade/data/dataset.h"
#include "jade/restore/restored_exposure.h"

namespace jade::train {

/// The exposure with masked pixels of its frame set to black.
data::Exposure masked(const data::Exposure& exposure);

/// Computes restore::sum_events() of a data set's training exposures in order, and those of the
/// next exposures ahead of time on other threads; also looks their restorations up.
class SumsAhead {
 public:
  /// Begins the sums of the first exposures. All arguments must outlive it.
  /// @param policy  std::launch::deferred: computes nothing ahead of time
  /// @param most_device_bytes  Large sums are copied to the restorer's device if those of all
  ///   exposures at one time need less.
  SumsAhead(const data::Dataset& dataset, const restore::RestoreOptions& options,
            const restore::ViewRestorer& restorer, std::launch policy, int64_t most_device_bytes);

  /// Sums of the next exposure. Call it at most once per exposure.
  restore::ExposureSums next();

 private:
  void begin();

  const data::Dataset& dataset_;
  const restore::RestoreOptions& options_;
  const restore::ViewRestorer& restorer_;
  const restore::RestorerMetadata* network_;  ///< null if there is none
  std::launch policy_;
  int64_t most_device_bytes_;
  size_t at_once_ = 1, begun_upto_ = 0;
  // last member: destroyed before the data that it reads
  std::deque<std::future<restore::ExposureSums>> begun_;
};

}  // namespace jade::train
