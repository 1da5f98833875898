// SPDX-License-Identifier: Apache-2.0
// How well events explain the change from each frame to the next.
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/events/event_stream.h"
#include "jade/events/thresholds.h"

namespace jade::data {

/// The number of events that some pixels had until a time. Each event counts gradually from the one
/// before it at its pixel, for at most 20 ms: the change that it reports happened on the way.
class PixelCurves {
 public:
  /// @param events  at whole pixels
  /// @param pixels  [P] int64, row · width + column
  PixelCurves(const events::EventStream& events, const events::ImageSize& size,
              const torch::Tensor& pixels);

  /// Positive and negative events until each time, [2,P,K] float64; the times in any order.
  torch::Tensor until(const std::vector<double>& times_us) const;

 private:
  struct Step {
    int64_t pixel;
    double begin_us, end_us;
    bool positive;
  };
  std::vector<Step> steps_;
  int64_t pixels_;
};

/// A fit of the contrast thresholds.
struct ConsistencyFit {
  bool solved = false;              ///< false where too few pixels speak, or of one polarity only
  events::Thresholds thresholds;    ///< means over the pixels
  events::Thresholds spread{0, 0};  ///< standard deviation from pixel to pixel
  events::Thresholds standard_error{1e9,
                                    1e9};  ///< of the means, from leaving out parts of the image
  int64_t pixels = 0;                      ///< that spoke
  double noise = 0;        ///< deviation of a change that noise of the frames does not explain, log
  double frame_noise = 0;  ///< deviation of a pixel of a frame, in units of white
  double unexplained = 1;  ///< share of the squared changes that is left
  /// Minus twice the logarithm of the likelihood of a change, apart from a constant: comparable
  /// between fits of the same frames with other exposures.
  double loss = 0;
  std::vector<double> part_losses;  ///< of eight bands of the image
  /// By how much the logarithm of each frame exceeds what the frame before it and the events make
  /// of it, in the median of the pixels, and its standard error: the camera's or the light's doing.
  /// [V−1], 0 ± infinity where nothing tells.
  std::vector<double> steps, step_errors;
};

struct ConsistencyOptions {
  int64_t pixels = 8000;  ///< at most, evenly chosen among those with events
  int rounds = 30;
  double log_offset = 0;  ///< ε of the sensor's log(I + ε)
};

/// Frames, in order, and the events of their pixels. With E(t) = Θ⁺P(t) − Θ⁻N(t), the events of a
/// pixel until t, and o the sensor's offset, the change from one frame to the next is
///     log(B₂ + o) − log(B₁ + o) = m = log mean₂ exp E − log mean₁ exp E,
/// where the means are over the exposures (trapezoid rule). Dark noisy pixels have no logarithm, so
/// what is fitted is linear in the frames: B₂ exp(−m/2) − B₁ exp(m/2), in units of the brightness
/// that m and the means of 3x3 pixels predict. Noise ν of the frames then adds to its variance
/// alone, and is estimated with the rest.
///
/// Every pixel has thresholds of its own: over a span of P and N events a deviation δ of them adds
/// δ⁺P − δ⁻N, which after some dozens of events drowns what the frames tell and pulls a fit of one
/// pair of thresholds for all pixels far down. So the pixels' thresholds are random effects about
/// the mean that is sought (a non-linear mixed model: M. Lindstrom, D. Bates, Biometrics 1990),
/// whose spread and noise are estimated with it (EM); changes that do not fit count less (Huber).
/// A change of all pixels alike is the camera's (exposure, gain) or the light's, and no fault of
/// the thresholds: the median of each pair of frames is taken out.
class EventConsistency {
 public:
  /// @param frames       [3,H,W] or [1,H,W], at least two of one size
  /// @param is_neighbour whether frames i and i+1 may be compared, one fewer than frames
  /// @param span         that the events are taken from
  EventConsistency(const std::vector<torch::Tensor>& frames, const std::vector<bool>& is_neighbour,
                   const events::EventStream& events, const events::TimeWindow& span,
                   const ConsistencyOptions& options = {});

  /// The fit with these exposures, one for each frame. @throws Interrupted.
  ConsistencyFit fit(const std::vector<events::TimeWindow>& exposures) const;

 private:
  ConsistencyOptions options_;
  torch::Tensor pixels_;         ///< [P]
  torch::Tensor gray_, smooth_;  ///< [P,V] of the frames, and of their means over 3x3 pixels
  torch::Tensor neighbour_;      ///< [V−1] bool
  PixelCurves curves_;
};

}  // namespace jade::data
