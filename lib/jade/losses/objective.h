// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <torch/types.h>
#include <tuple>
#include <vector>

#include "jade/core/fields.h"
#include "jade/core/members.h"
#include "jade/imaging/ssim.h"
#include "jade/losses/event_loss.h"
#include "jade/losses/fixed.h"
#include "jade/losses/terms.h"

namespace jade::losses {

/// Target of the render at mid-exposure, or at RestoredPoses, Eq. (9).
enum class Target { kRouted, kEdi, kEfnet, kMean, kBlurry, kImageFolder, kNone };

constexpr auto words_of(Target) {
  return std::array{Word{"routed", Target::kRouted, "the mix weighted by the allocation"},
                    Word{"edi", Target::kEdi, "EDI alone"},
                    Word{"efnet", Target::kEfnet, "EFNet alone"},
                    Word{"mean", Target::kMean, "the mean of EDI and EFNet"},
                    Word{"blurry", Target::kBlurry, "the blurry frame itself"},
                    Word{"image_folder", Target::kImageFolder, "images of train.target_images"},
                    Word{"none", Target::kNone, "no such term"}};
}

/// Poses of an exposure at which the target, and with it fusion and routing, is evaluated.
enum class RestoredPoses { kMiddle, kThree, kNine };

constexpr auto words_of(RestoredPoses) {
  return std::array{
      Word{"middle", RestoredPoses::kMiddle, "mid-exposure, as printed"},
      Word{"three", RestoredPoses::kThree, "one of start, middle and end, sampled at every step"},
      Word{
          "nine", RestoredPoses::kNine,
          "one of nine at equal steps, sampled at every step; of all poses if exposure.samples - 1 "
          "is no multiple of 8"}};
}

/// Weight of L_edi at the start of a run, as in Eq. (10).
constexpr double kEdiWeight = 1;

/// When to trust restorations, which are wrong where events are missing, noisy or coarse, while the
/// scene combines several exposures; the configuration group `objective.trust`.
struct TrustOptions {
  double agreement = 0.05;
};

template <class V>
void describe(V& v, TrustOptions& o) {
  v.field("agreement", o.agreement,
          "after objective.target_until, L_tgt stays on for views whose L_tgt before its weight is "
          "below this; 0: for none; logged in metrics.jsonl as target_distance",
          Range{0, 10});
}

struct ObjectiveOptions {
  double dssim = 0.3;
  Target target = Target::kEfnet;
  double target_weight = 1.0;
  Steps target_until = Steps::share(20);
  RestoredPoses restored_poses = RestoredPoses::kNine;
  bool blur = true;
  bool edi_supervision = true;
  double edi_weight_final = 0;
  double edi_contrast = 1.3;
  bool simulation = true;
  bool intensity = true;
  Steps warmup = Steps::share(6);
  TrustOptions trust;
  double event_loss_weight = 0.0;
  /// L_sim is active after this step: 7,000 of 25,000, as in the paper (simul_start). No key.
  Steps simulation_start = Steps::share(28);
  int64_t event_pixels = 1024;        ///< number of pixels sampled for L_ev, as in DiET-GS
                                      ///< (sample_pnum). No key
  double event_window_share = 0.125;  ///< length of L_ev's window relative to the exposure. No key
};

template <class V>
void describe(V& v, ObjectiveOptions& o) {
  v.field("dssim", o.dssim, "share λ of SSIM in every reconstruction term (lambda_dssim)",
          Range{0, 1});
  v.field("target", o.target, "target of the middle render, Eq. (9)");
  v.field("target_weight", o.target_weight, "weight of that term (efnet_weight)", Range{0, 1e3});
  v.fixed("target_weight_final", -1);
  v.field("target_until", o.target_until,
          "last step with that term and the routing step, but see trust.agreement; 0: all steps",
          Range{0, 1e9});
  v.field("restored_poses", o.restored_poses,
          "poses of that term, fusion and the routing step; all but middle need a restorer of "
          "version 2 if the target uses EFNet");
  v.field("blur", o.blur, "L_blur: mean of the renders against the blurry frame");
  v.field("edi_supervision", o.edi_supervision, "L_edi in gray and in colour, at sampled poses");
  v.fixed("edi_weight", kEdiWeight);
  v.field("edi_weight_final", o.edi_weight_final,
          "weight of both at the end of the run; linear from 1 at its start; below 0: constant 1",
          Range{-1, 1e3});
  v.field("edi_contrast", o.edi_contrast,
          "factor of both thresholds in R of L_edi and L_sim: above 1 L_edi has steeper edges than "
          "measured, which gains 0.6 dB (docs/engineering/preset.md); 1 as printed",
          Range{0.1, 10});
  v.field("simulation", o.simulation,
          "L_sim: EDI of the simulated blur, after 28 % of the run (simul_start)");
  v.fixed("simulation_start", o.simulation_start);
  v.field("intensity", o.intensity, "L_int: blur under the camera response");
  v.field("warmup", o.warmup,
          "until this step the camera response is the identity and L_int is off", Range{0, 1e9});
  v.group("trust", o.trust, "which restorations stay targets until the end");
  v.field("event_loss_weight", o.event_loss_weight,
          "weight of L_ev, which costs two more renders; 0 turns it off", Range{0, 1e3});
  v.fixed("event_pixels", o.event_pixels);
  v.fixed("event_window", "exposure");
  v.fixed("event_window_share", o.event_window_share);
}

/// Active terms of a step and their inputs; only plan_objective() reads their schedule.
struct ObjectivePlan {
  bool target = false;      ///< L_tgt
  bool blur = false;        ///< L_blur
  bool edi = false;         ///< L_edi, gray and colour
  bool simulation = false;  ///< L_sim
  bool intensity = false;   ///< L_int
  bool event = false;       ///< L_ev
  bool response = false;  ///< ρ is past its warm-up and some term uses it; else it is the identity
  bool agreed_target = false;  ///< L_tgt is limited to pixels or views where scene and target agree
  bool drawn_target = false;   ///< L_tgt is evaluated at a sampled pose, else at mid-exposure

  bool any_term() const { return target || blur || edi || simulation || intensity || event; }
  /// Whether all renders are needed, because a term reads their mean; also if no term reads any.
  bool all_poses() const { return blur || simulation || intensity || !(target || edi); }

  /// Parts of the plan, of which only the first needs the target.
  ObjectivePlan only_target() const {
    ObjectivePlan part;
    part.target = target;
    part.agreed_target = agreed_target;
    part.drawn_target = drawn_target;
    return part;
  }
  ObjectivePlan without_target() const {
    ObjectivePlan part = *this;
    part.target = part.agreed_target = part.drawn_target = false;
    return part;
  }

  /// For operator==.
  auto members() const {
    const auto all = std::tie(target, blur, edi, simulation, intensity, event, response,
                              agreed_target, drawn_target);
    static_assert(std::tuple_size_v<decltype(all)> == member_count<ObjectivePlan>());
    return all;
  }
  friend bool operator==(const ObjectivePlan& a, const ObjectivePlan& b) {
    return a.members() == b.members();
  }
  friend bool operator!=(const ObjectivePlan& a, const ObjectivePlan& b) { return !(a == b); }
};

/// @param step  counted from 1
ObjectivePlan plan_objective(const ObjectiveOptions& options, int64_t step);

/// An image to which ρ is applied: ρ(image), or Σ_k w_k ρ(image[k]) if it has weights [K], constant
/// and on the image's device or, up to kMostOnCpu of them, on the CPU.
struct ToneInput {
  static constexpr int64_t kMostOnCpu = 40;
  torch::Tensor image, weights;
};

/// The camera response ρ: evaluates all images of a step, at most 5, in one call. Empty: the
/// identity.
using ToneCurve = std::function<std::vector<torch::Tensor>(const std::vector<ToneInput>&)>;

/// R at the poses of L_edi gray, L_edi colour and L_sim, [1,H,W] each.
struct EdiFactors {
  torch::Tensor gray, color, simulation;

  /// @param three  [3,1,H,W]
  static EdiFactors of(const torch::Tensor& three) { return {three[0], three[1], three[2]}; }
};

struct ObjectiveInputs {
  /// [K,3,H,W], Î_k, or [M,3,H,W], only those of poses_read(); differentiable
  torch::Tensor renders;
  int64_t samples = 9;         ///< K, odd; the middle one is mid-exposure
  torch::Tensor weights;       ///< [K] weights in the mean render, of sum 1; undefined: 1/K each
  imaging::SsimTarget blurry;  ///< [3,H,W], B; its window means may be undefined
  /// [3] int64 on the renders' device: the poses of L_edi gray, L_edi colour and L_sim; [4] with
  /// that of L_tgt, which a plan with drawn_target needs.
  torch::Tensor pose_draws;
  EdiFactors edi_factors;  ///< at these poses; needed for L_edi and L_sim only
  /// [1,H,W], 0 at excluded pixels, where renders, blurry frame and target are black and ρ(black)
  /// is excluded too; undefined: all pixels count.
  torch::Tensor mask;
  /// [2] weights of L_tgt and L_edi at this step, on the device; undefined: those of the options,
  /// which must then be constant.
  torch::Tensor term_weights;
  std::optional<Fixed> target;      ///< [3,H,W], at the pose of L_tgt; needed for it only
  std::optional<EventPair> events;  ///< needed for L_ev only
  ToneCurve tone;                   ///< ρ; ignored if the plan does not use it
};

struct NamedTerm {
  std::string name;      ///< "target", "blur", "edi_gray", "edi_color", "simulation", "intensity",
                         ///< "event"; "target_distance", the value that trust.agreement compares
                         ///< with its bound
  torch::Tensor value;   ///< scalar with its weight applied
  bool in_total = true;  ///< a part of L_scene; else for logging only
};

/// Contains active terms only: a disabled one is absent, not multiplied by zero.
struct Objective {
  torch::Tensor total;  ///< scalar; undefined if no term is active
  std::vector<NamedTerm> terms;
};

/// Whether the weights of L_tgt or L_edi change during a run.
bool weights_fall(const ObjectiveOptions& options);

/// The weights of L_tgt and L_edi at `step` (counted from 1) of `steps`.
std::array<double, 2> term_weights(const ObjectiveOptions& options, int64_t step, int64_t steps);

/// The pose at which L_tgt is evaluated, [1] int64 on the device of `pose_draws`: the sampled one
/// or mid-exposure.
torch::Tensor target_pose(const ObjectivePlan& plan, const torch::Tensor& pose_draws,
                          int64_t samples);

/// The images that the terms of a plan read: renders, their mean and picks, in one operation.
struct Views {
  torch::Tensor all;  ///< [K,3,H,W]
  torch::Tensor mean, target, edi_gray, edi_color,
      simulation;  ///< [3,H,W]; undefined: not rendered
};

/// @throws ContractError if the inputs are not those of the plan
Views pick_views(const ObjectiveInputs& inputs, const ObjectivePlan& plan);

/// L_scene = L_tgt + L_blur + L_edi + L_sim + L_int (+ L_ev), Eq. (10): the terms of the plan with
/// their weights. Does not wait for the device.
/// @param views  pick_views() of a plan that contains this one: the parts of a plan share them, as
///   roots of one graph, so call torch::autograd::backward() for all parts at once
Objective objective(const Views& views, const ObjectiveInputs& inputs, const ObjectivePlan& plan,
                    const ObjectiveOptions& options);
Objective objective(const ObjectiveInputs& inputs, const ObjectivePlan& plan,
                    const ObjectiveOptions& options);

/// The poses that the terms read, [M] int64 on the device of `pose_draws`: that of the target if it
/// is active, then those of L_edi gray and colour. A pose that no term reads has no gradient, so
/// rendering it costs time and dilutes the mean screen gradients of densification. Undefined: all
/// poses.
/// @param pose_draws  as in ObjectiveInputs
/// @param samples     K
/// @throws ContractError if the plan needs a sampled pose that is missing
torch::Tensor poses_read(const ObjectivePlan& plan, const torch::Tensor& pose_draws,
                         int64_t samples = 9);

}  // namespace jade::losses
