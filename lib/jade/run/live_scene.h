// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <torch/types.h>
#include <vector>

#include "jade/data/exposure.h"
#include "jade/run/frame_memory.h"
#include "jade/run/view_pictures.h"
#include "jade/serve/render_queue.h"
#include "jade/splat/render.h"

namespace jade::run {

/// Renders a scene for the live page from any pose, and provides the pictures of the data set's
/// cameras. Use on one thread.
class LiveScene {
 public:
  /// @param dataset    must outlive this; cameras may move between calls
  /// @param gaussians  the current ones, without gradient; used immediately, so they need not be
  ///   copies
  /// @param draw       render_options() of the run
  LiveScene(const data::Dataset& dataset, const splat::RenderOptions& draw,
            GaussianSource gaussians);

  /// Makes `pictures` the layers of a camera: "train.3", "test.0".
  void add(const std::string& camera, std::vector<ViewPicture> pictures);

  /// Renders a viewer's request. On a GPU the copy to the host may still run on return.
  /// @throws ConfigError for an unknown picture or camera; errors of rendering.
  serve::Rendered draw(const serve::Wanted& wanted, int64_t step) const;

  /// Texts of page::live_page().
  struct PageText {
    std::vector<std::string> facts;
    std::string config;     ///< text of config.yaml; may be empty
    std::string server_id;  ///< serve::Board::id()
    bool pausable = false;
    bool moving = false;      ///< cameras move as poses are learned
    std::string report = {};  ///< path of the future report; empty if there will be none
    std::string scores = {};  ///< text of a finished run's eval.json; may be empty
  };
  std::string page_data(const PageText& text) const;

 private:
  torch::Tensor truth_at(const std::string& camera) const;
  torch::Tensor truth_mask_at(const std::string& camera) const;
  serve::Rendered picture(const serve::Wanted& wanted) const;
  serve::Rendered frame(const serve::Wanted& wanted, const splat::Gaussians& gaussians) const;
  nlohmann::ordered_json cameras(const std::string& name) const;

  const data::Dataset& dataset_;
  splat::RenderOptions draw_;
  GaussianSource gaussians_;
  std::shared_ptr<FrameMemory> memory_ = std::make_shared<FrameMemory>();
  std::map<std::string, std::vector<ViewPicture>> pictures_;
};

}  // namespace jade::run
