// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <torch/nn/module.h>

namespace jade::train {

/// Calls `visitor(name, tensor)` for each parameter and buffer of a module.
template <class Visitor>
void visit_module(Visitor&& visitor, const torch::nn::Module& module) {
  for (const auto& each : module.named_parameters()) visitor(each.key(), each.value());
  for (const auto& each : module.named_buffers()) visitor(each.key(), each.value());
}

/// A part of a run besides the Gaussians: a module and the optimiser of its parameters. It is used
/// like a pointer to the module.
template <class Module, class Adam>
struct Learned {
  std::shared_ptr<Module> module;  ///< nullptr: the run has no such part
  Adam adam;                       ///< empty: the parameters stay as they are

  explicit operator bool() const { return module != nullptr; }
  Module* operator->() const { return module.get(); }
  Module& operator*() const { return *module; }

  /// Calls `visitor(name, tensor)` for each tensor of the module and of the optimiser.
  template <class Visitor>
  void visit(Visitor&& visitor) const {
    const auto visit_as = [&](const std::string& prefix) {
      return [&visitor, prefix](const std::string& name, const torch::Tensor& tensor) {
        visitor(prefix + name, tensor);
      };
    };
    if (module) visit_module(visit_as("module."), *module);
    adam.visit(visit_as("adam."));
  }
};

}  // namespace jade::train
