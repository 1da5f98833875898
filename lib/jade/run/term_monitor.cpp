// SPDX-License-Identifier: Apache-2.0
#include "jade/run/term_monitor.h"

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

void TermMonitor::start(const std::vector<losses::NamedTerm>& terms, int64_t step) {
  names_ = names_of(terms);
  finite_steps_ = torch::zeros({static_cast<int64_t>(terms.size())},
                               terms[0].value.options().dtype(torch::kInt64));
  first_step_ = step;
  steps_ = 0;
}

void TermMonitor::watch(const std::vector<losses::NamedTerm>& terms, int64_t step) {
  if (terms.empty()) return;
  if (names_of(terms) != names_) {
    check();
    start(terms, step);
  }
  std::vector<torch::Tensor> values;
  for (const losses::NamedTerm& term : terms) values.push_back(term.value);
  finite_steps_.add_(torch::isfinite(torch::stack(values)));
  ++steps_;
}

void TermMonitor::check() {
  if (names_.empty() || steps_ == 0) return;
  const auto finite = finite_steps_.cpu();
  int64_t first = steps_;
  std::string bad;
  for (size_t i = 0; i < names_.size(); ++i) {
    const int64_t count = finite[static_cast<int64_t>(i)].item<int64_t>();
    if (count == steps_) continue;
    // Parameters never recover from NaN, so all values before the first bad one were finite.
    if (count < first) bad.clear();
    if (count <= first) bad += (bad.empty() ? "" : ", ") + names_[i];
    first = std::min(first, count);
  }
  if (!bad.empty()) {
    throw NumericError(concat(
        "step ", first_step_ + first, ": NaN or Inf in loss term ", bad,
        "; the last good checkpoint is kept: try smaller step sizes (optim.*) and --resume"));
  }
}

}  // namespace jade::run
