// SPDX-License-Identifier: Apache-2.0
// Measures how well events explain the change from each frame to the next.
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/events/event_stream.h"
#include "jade/events/thresholds.h"

namespace jade::data {

/// Number of events at each of some pixels before a time. Each event is spread linearly over the
/// time since the previous event at its pixel, at most 20 ms: the change that it reports happened
/// during that time.
class PixelCurves {
 public:
  /// @param events  at whole-pixel coordinates
  /// @param pixels  [P] int64, row · width + column
  PixelCurves(const events::EventStream& events, const events::ImageSize& size,
              const torch::Tensor& pixels);

  /// Positive and negative events before each time, [2,P,K] float64; the times may be in any order.
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

/// Result of a fit of the contrast thresholds.
struct ConsistencyFit {
  bool solved = false;              ///< false if too few pixels are usable, or all events have one
                                    ///< polarity
  events::Thresholds thresholds;    ///< means over the pixels
  events::Thresholds spread{0, 0};  ///< standard deviation from pixel to pixel
  events::Thresholds standard_error{1e9,
                                    1e9};  ///< of the means, by jackknife over parts of the image
  int64_t pixels = 0;                      ///< number of usable pixels
  double noise = 0;        ///< standard deviation of a change beyond the frames' noise, log
                           ///< intensity
  double frame_noise = 0;  ///< standard deviation of a frame's pixel, in units of white
  double unexplained = 1;  ///< unexplained share of the squared changes
  /// Minus twice the log-likelihood of a change, up to a constant: comparable between fits of the
  /// same frames with other exposures.
  double loss = 0;
  std::vector<double> part_losses;  ///< loss of each of eight bands of the image
  /// Change of the log intensity from each frame to the next that the events do not explain, median
  /// over the pixels, with its standard error: caused by the camera or the light. [V−1]; 0 ±
  /// infinity if it cannot be estimated.
  std::vector<double> steps, step_errors;
};

struct ConsistencyOptions {
  int64_t pixels = 8000;  ///< at most this many pixels, evenly chosen among those with events
  int rounds = 12;        ///< the thresholds change by less than 0.2 % in further ones
  double log_offset = 0;  ///< ε of the sensor's log(I + ε)
};

/// Frames, in order, and the events of their pixels. With E(t) = Θ⁺P(t) − Θ⁻N(t), where P and N
/// count the events of a pixel before t, and o the sensor's offset, the change from one frame to
/// the next is
///     log(B₂ + o) − log(B₁ + o) = m = log mean₂ exp E − log mean₁ exp E.
/// The means are over the exposures (trapezoid rule). Dark noisy pixels have no logarithm, so the
/// fit uses a residual that is linear in the frames: B₂ exp(−m/2) − B₁ exp(m/2), relative to the
/// brightness predicted by m and the means of 3x3 pixels. The frames' noise ν then affects only the
/// residual's variance, and is estimated with the other parameters.
///
/// Every pixel has its own thresholds: over P and N events a deviation δ of them adds δ⁺P − δ⁻N,
/// which after some dozens of events exceeds the frames' information and strongly biases a fit of
/// one pair of thresholds for all pixels towards low values. Therefore the pixels' thresholds are
/// random effects about the mean (a non-linear mixed model: M. Lindstrom, D. Bates, Biometrics
/// 1990), whose spread and noise are estimated with it (EM). Outliers have less weight (Huber). A
/// change that all pixels share is caused by the camera (exposure, gain) or the light, not by the
/// thresholds: the median of each pair of frames is subtracted.
class EventConsistency {
 public:
  /// @param frames       [3,H,W] or [1,H,W], at least two, all of one size
  /// @param is_neighbour whether frames i and i+1 may be compared, one fewer than frames
  /// @param span         time span of the events to use
  EventConsistency(const std::vector<torch::Tensor>& frames, const std::vector<bool>& is_neighbour,
                   const events::EventStream& events, const events::TimeWindow& span,
                   const ConsistencyOptions& options = {});

  /// Fits with these exposures, one per frame. @throws Interrupted.
  ConsistencyFit fit(const std::vector<events::TimeWindow>& exposures) const;

 private:
  ConsistencyOptions options_;
  torch::Tensor pixels_;         ///< [P]
  torch::Tensor gray_, smooth_;  ///< [P,V]: the frames, and their means over 3x3 pixels
  torch::Tensor neighbour_;      ///< [V−1] bool
  PixelCurves curves_;
};

}  // namespace jade::data
