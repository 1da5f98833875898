// SPDX-License-Identifier: Apache-2.0
#include "jade/core/check.h"

namespace jade {
namespace {

std::string join(const std::vector<int64_t>& sizes) {
  std::ostringstream out;
  out << '[';
  for (size_t i = 0; i < sizes.size(); ++i) {
    out << (i ? ", " : "") << (sizes[i] < 0 ? std::string("any") : std::to_string(sizes[i]));
  }
  out << ']';
  return out.str();
}

}  // namespace

std::string shape_string(const torch::Tensor& tensor) {
  return tensor.defined() ? join(tensor.sizes().vec()) : "undefined";
}

void check_shape(const torch::Tensor& tensor, const std::string& name,
                 const std::vector<int64_t>& shape) {
  bool fits = tensor.defined() && tensor.dim() == static_cast<int64_t>(shape.size());
  for (size_t i = 0; fits && i < shape.size(); ++i) {
    fits = shape[i] < 0 || tensor.size(static_cast<int64_t>(i)) == shape[i];
  }
  if (!fits) {
    throw ContractError(
        concat(name, ": expected shape ", join(shape), ", found ", shape_string(tensor)));
  }
}

void check_dtype(const torch::Tensor& tensor, const std::string& name, torch::ScalarType dtype) {
  if (tensor.scalar_type() != dtype) {
    throw ContractError(concat(name, ": expected dtype ", dtype, ", found ", tensor.scalar_type()));
  }
}

void check_same_device(const torch::Tensor& a, const std::string& name_a, const torch::Tensor& b,
                       const std::string& name_b) {
  if (a.device() != b.device()) {
    throw ContractError(
        concat(name_a, " is on ", a.device(), " but ", name_b, " is on ", b.device()));
  }
}

}  // namespace jade
