// SPDX-License-Identifier: Apache-2.0
// Visits every tensor of a struct by name, for checkpoints, gradients and the captured step
// (step_graph.h): a tensor that it missed would be lost, or keep the values of the captured step.
// Therefore each struct lists all its members; a list that is incomplete or contains a type that
// cannot be visited does not compile.
#pragma once

#include <string>
#include <torch/types.h>
#include <type_traits>

#include "jade/core/members.h"
#include "jade/losses/objective.h"
#include "jade/restore/restorations.h"
#include "jade/splat/render.h"

namespace jade::train {

/// A member of a struct with its name.
template <class T>
struct Member {
  std::string name;
  T& value;
};
template <class T>
Member(const char*, T&) -> Member<T>;
template <class T>
Member(std::string, T&) -> Member<T>;

template <class Visitor, class T>
void visit_tensors(Visitor& visitor, const Member<T>& member);

/// Calls `visitor(name, tensor)` for each tensor among all members of `Struct`.
template <class Struct, class Visitor, class... Ts>
void visit_members(Visitor& visitor, const Member<Ts>&... members) {
  static_assert(sizeof...(Ts) == member_count<Struct>(), "name each member of the struct once");
  (visit_tensors(visitor, members), ...);
}

/// Visits one member: the tensor itself, the tensors of a known struct, or none.
template <class Visitor, class T>
void visit_tensors(Visitor& visitor, const Member<T>& member) {
  using Type = std::remove_const_t<T>;
  T& value = member.value;
  const auto inner = [&](const char* name) { return member.name + "." + name; };
  if constexpr (std::is_same_v<Type, torch::Tensor>) {
    visitor(member.name, value);
  } else if constexpr (std::is_same_v<Type, losses::EdiFactors>) {
    visit_members<Type>(visitor, Member{inner("gray"), value.gray},
                        Member{inner("color"), value.color},
                        Member{inner("simulation"), value.simulation});
  } else if constexpr (std::is_same_v<Type, restore::Restorations>) {
    visit_members<Type>(visitor, Member{inner("edi"), value.edi},
                        Member{inner("efnet"), value.efnet});
  } else if constexpr (std::is_same_v<Type, splat::CameraBatch>) {
    visit_members<Type>(visitor, Member{inner("camera_from_world"), value.camera_from_world},
                        Member{inner("intrinsics"), value.intrinsics},
                        Member{inner("width"), value.width}, Member{inner("height"), value.height});
  } else if constexpr (std::is_same_v<Type, splat::Gaussians>) {
    visit_members<Type>(
        visitor, Member{inner("means"), value.means}, Member{inner("rotations"), value.rotations},
        Member{inner("log_scales"), value.log_scales},
        Member{inner("logit_opacities"), value.logit_opacities}, Member{inner("sh"), value.sh});
  } else if constexpr (std::is_same_v<Type, splat::ScreenStatistics>) {
    visit_members<Type>(visitor, Member{inner("gradient_norm"), value.gradient_norm},
                        Member{inner("visible_count"), value.visible_count},
                        Member{inner("max_radius_px"), value.max_radius_px});
  } else if constexpr (std::is_class_v<Type> && !std::is_same_v<Type, std::string>) {
    const auto outer = [&](const std::string& name, auto& tensor) {
      visitor(inner(name.c_str()), tensor);
    };
    value.visit(outer);
  } else {
    static_assert(std::is_arithmetic_v<Type> || std::is_same_v<Type, std::string>,
                  "say here which tensors a member of this type has");
  }
}

}  // namespace jade::train
