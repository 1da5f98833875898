// SPDX-License-Identifier: Apache-2.0
#include "jade/run/term_monitor.h"

#include <algorithm>
#include <optional>
#include <torch/types.h>

#include "jade/core/error.h"

namespace jade::run {
namespace {

std::vector<std::string> names_of(const std::vector<losses::NamedTerm>& terms) {
  std::vector<std::string> names;
  for (const losses::NamedTerm& term : terms) names.push_back(term.name);
  return names;
}

}  // namespace

TermMonitor::Count& TermMonitor::count_of(const std::vector<losses::NamedTerm>& terms) {
  std::vector<std::string> names = names_of(terms);
  for (Count& count : counts_) {
    if (count.names == names) return count;
  }
  counts_.push_back({std::move(names),
                     torch::zeros({static_cast<int64_t>(terms.size())},
                                  terms[0].value.options().dtype(torch::kInt64)),
                     {}});
  return counts_.back();
}

void TermMonitor::watch(const std::vector<losses::NamedTerm>& terms, int64_t step) {
  if (terms.empty()) return;
  Count& count = count_of(terms);
  std::vector<torch::Tensor> values;
  for (const losses::NamedTerm& term : terms) values.push_back(term.value);
  count.finite_steps.add_(torch::isfinite(torch::stack(values)));
  count.steps.push_back(step);
}

void TermMonitor::check() {
  std::optional<int64_t> first;
  std::string bad;
  for (const Count& count : counts_) {
    const auto finite = count.finite_steps.cpu();
    for (size_t i = 0; i < count.names.size(); ++i) {
      const auto good = static_cast<size_t>(finite[static_cast<int64_t>(i)].item<int64_t>());
      if (good == count.steps.size()) continue;
      // Parameters never recover from NaN, so all values before the first bad one were finite.
      const int64_t step = count.steps[good];
      if (!first || step < *first) bad.clear();
      if (!first || step <= *first) bad += (bad.empty() ? "" : ", ") + count.names[i];
      first = std::min(first.value_or(step), step);
    }
  }
  if (first) {
    throw NumericError(concat(
        "step ", *first, ": NaN or Inf in loss term ", bad,
        "; the last good checkpoint is kept; train again with smaller step sizes (optim.*) and "
        "another --output"));
  }
  counts_.clear();
}

}  // namespace jade::run
