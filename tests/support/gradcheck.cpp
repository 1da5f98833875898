// SPDX-License-Identifier: Apache-2.0
#include "support/gradcheck.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/core/random.h"

namespace jade::test {

GradcheckReport gradcheck(const std::function<torch::Tensor(const std::vector<torch::Tensor>&)>& fn,
                          const std::vector<torch::Tensor>& inputs,
                          const std::vector<std::string>& names, const GradcheckOptions& options) {
  std::vector<torch::Tensor> leaves;
  for (size_t i = 0; i < inputs.size(); ++i) {
    check_dtype(inputs[i], names[i], torch::kFloat64);
    leaves.push_back(
        inputs[i].detach().clone().contiguous().set_requires_grad(inputs[i].requires_grad()));
  }
  const torch::Tensor output = fn(leaves);
  auto generator = make_generator(options.seed, "gradcheck cotangent");
  const torch::Tensor cotangent = torch::randn(output.sizes(), generator, output.options());
  (output * cotangent).sum().backward();

  const auto evaluate = [&] {
    const torch::NoGradGuard no_grad;
    return (fn(leaves) * cotangent).sum().item<double>();
  };
  GradcheckReport report;
  for (size_t i = 0; i < leaves.size(); ++i) {
    if (!leaves[i].requires_grad()) continue;
    const torch::Tensor grad =
        leaves[i].grad().defined() ? leaves[i].grad().contiguous() : torch::zeros_like(leaves[i]);
    double* const value = leaves[i].data_ptr<double>();
    const int64_t count = leaves[i].numel();
    const int64_t checked = std::min(count, options.max_elements);
    for (int64_t k = 0; k < checked; ++k) {
      const int64_t element = k * count / checked;
      const double original = value[element];
      value[element] = original + options.step;
      const double above = evaluate();
      value[element] = original - options.step;
      const double below = evaluate();
      value[element] = original;
      const double numeric = (above - below) / (2 * options.step);
      const double analytic = grad.data_ptr<double>()[element];
      const double excess =
          std::abs(analytic - numeric) / (options.absolute + options.relative * std::abs(numeric));
      ++report.checked;
      if (!(excess <= report.worst_excess)) {  // NaN counts as worst
        report.worst_excess = std::isnan(excess) ? INFINITY : excess;
        report.message = concat(names[i], "[", element, "]: analytic ", analytic, ", numeric ",
                                numeric, ", ", excess, " times the tolerance");
      }
    }
  }
  report.passed = report.worst_excess <= 1;
  return report;
}

}  // namespace jade::test
