// SPDX-License-Identifier: Apache-2.0
#include "jade/run/live_scene.h"

#include <algorithm>
#include <c10/core/Event.h>
#include <c10/core/impl/VirtualGuardImpl.h>
#include <cmath>
#include <memory>
#include <utility>

#include "jade/core/error.h"
#include "jade/eval/metrics.h"
#include "jade/run/page_scene.h"
#include "jade/train/view.h"

namespace jade::run {
namespace {

using Json = nlohmann::ordered_json;

/// Number of Gaussians that the page samples to find the pivot of rotations.
constexpr int64_t kSample = 2000;

/// A GPU renders at screen resolution, up to twice the trained one; a CPU at the trained one.
constexpr double kGpuScale = 2;

/// Bytes of all films of a live page before compression.
constexpr size_t kAllFilmBytes = 12'000'000;

/// Near is bright, on a logarithmic scale as in the report's page; black where nothing is.
torch::Tensor depth_picture(const splat::RenderOutput& render) {
  const torch::Tensor depth = render.depth[0], solid = render.alpha[0] > 0.5;
  const torch::Tensor far = depth.masked_fill(~solid, 0).max().clamp_min(1e-6);
  const torch::Tensor near = torch::where(solid, depth, far).min();
  const torch::Tensor range = (far / near).log().clamp_min(1e-6);
  return ((far / depth.clamp_min(1e-6)).log() / range).clamp(0, 1).masked_fill(~solid, 0);
}

/// On the CPU, or being copied there.
serve::Rendered rendered_of(const torch::Tensor& image, FrameMemory& memory) {
  serve::Rendered rendered;
  if (!image.is_cuda()) {
    // Copy: training continues to write to the original.
    rendered.image = image.to(torch::kFloat32).contiguous().clone();
    return rendered;
  }
  rendered.image = memory.lend(image.sizes(), /*pinned=*/true);
  rendered.image.copy_(image.to(torch::kFloat32), /*non_blocking=*/true);
  const auto ready = std::make_shared<c10::Event>(image.device().type());
  ready->record(c10::impl::VirtualGuardImpl(image.device().type()).getStream(image.device()));
  rendered.finish = [ready] { ready->synchronize(); };
  return rendered;
}

/// Runs on the requesting thread, on demand; empty without a true image of the same size.
std::function<double()> judge(const torch::Tensor& image, const torch::Tensor& truth,
                              const torch::Tensor& mask) {
  if (!truth.defined() || truth.sizes() != image.sizes()) return {};
  return [image, truth, mask] {
    const torch::NoGradGuard no_grad;
    return eval::psnr(image, truth, mask);
  };
}

/// Flat x, y, z of a sample of the opaque half.
Json sample_of(const splat::Gaussians& gaussians) {
  const torch::NoGradGuard no_grad;
  Json numbers = Json::array();
  if (gaussians.size() == 0) return numbers;
  const auto opacities = gaussians.logit_opacities.flatten();
  const auto opaque = (opacities >= opacities.median()).nonzero().flatten();
  auto means = gaussians.means.index_select(0, opaque).to(torch::kCPU);
  const int64_t step = std::max<int64_t>(1, means.size(0) / kSample);
  means = means.slice(0, 0, means.size(0), step).to(torch::kFloat64).contiguous();
  const double* values = means.const_data_ptr<double>();
  for (int64_t i = 0; i < means.numel(); ++i) {
    numbers.push_back(std::round(1e4 * values[i]) / 1e4);
  }
  return numbers;
}

}  // namespace

LiveScene::LiveScene(const data::Dataset& dataset, const splat::RenderOptions& draw,
                     GaussianSource gaussians)
    : dataset_(dataset), draw_(draw), gaussians_(std::move(gaussians)) {}

void LiveScene::add(const std::string& camera, std::vector<ViewPicture> pictures) {
  pictures_[camera] = std::move(pictures);
}

torch::Tensor LiveScene::truth_at(const std::string& camera) const {
  const std::optional<CameraOfPage> found = camera_of_page(dataset_, camera);
  if (!found) return {};
  return found->exposure ? truth_of(dataset_, static_cast<int64_t>(found->index))
                         : dataset_.test[found->index].image;
}

torch::Tensor LiveScene::truth_mask_at(const std::string& camera) const {
  const std::optional<CameraOfPage> found = camera_of_page(dataset_, camera);
  if (!found) return {};
  return found->exposure ? truth_mask_of(dataset_, static_cast<int64_t>(found->index))
                         : dataset_.test[found->index].mask;
}

serve::Rendered LiveScene::picture(const serve::Wanted& wanted) const {
  const auto view = pictures_.find(wanted.view);
  if (view == pictures_.end()) throw ConfigError(concat("no camera ", wanted.view));
  const auto picture =
      std::find_if(view->second.begin(), view->second.end(),
                   [&](const ViewPicture& each) { return each.name == wanted.picture; });
  if (picture == view->second.end()) throw ConfigError(concat("no picture ", wanted.picture));
  serve::Rendered rendered = rendered_of(picture->make(), *memory_);
  if (picture->judged) {
    rendered.psnr = judge(rendered.image, truth_at(wanted.view), truth_mask_at(wanted.view));
  }
  return rendered;
}

serve::Rendered LiveScene::frame(const serve::Wanted& wanted,
                                 const splat::Gaussians& gaussians) const {
  splat::RenderOptions options = draw_;
  options.depth = wanted.kind == serve::Wanted::Kind::kDepth;
  const auto camera = train::camera_batch({wanted.pose}, wanted.camera, gaussians.means.device());
  const splat::RenderOutput render = splat::render(gaussians, camera, options);
  if (options.depth) return rendered_of(depth_picture(render), *memory_);
  serve::Rendered rendered = rendered_of(render.color[0].clamp(0, 1), *memory_);
  rendered.psnr = judge(rendered.image, truth_at(wanted.view), truth_mask_at(wanted.view));
  return rendered;
}

Json LiveScene::cameras(const std::string& name) const {
  const std::optional<CameraOfPage> found = camera_of_page(dataset_, name);
  if (!found) throw ConfigError(concat("no camera ", name));
  if (!found->exposure) return page_poses({dataset_.test[found->index].pose});
  const auto& poses = dataset_.train[found->index].poses;
  return page_poses({poses.begin(), poses.end()});
}

serve::Rendered LiveScene::draw(const serve::Wanted& wanted, int64_t step) const {
  const torch::NoGradGuard no_grad;
  const splat::Gaussians gaussians = gaussians_();
  serve::Rendered rendered;
  switch (wanted.kind) {
    case serve::Wanted::Kind::kPicture:
      rendered = picture(wanted);
      break;
    case serve::Wanted::Kind::kCamera:
      rendered.json = Json{{"poses", cameras(wanted.view)}}.dump();
      break;
    case serve::Wanted::Kind::kColor:
    case serve::Wanted::Kind::kDepth:
      rendered = frame(wanted, gaussians);
  }
  rendered.step = step;
  rendered.gaussians = gaussians.size();
  return rendered;
}

namespace {

Json scores_of(const LiveScene::PageText& text) {
  if (text.scores.empty()) return nullptr;
  Json scores = Json::parse(text.scores, nullptr, /*allow_exceptions=*/false);
  return scores.is_discarded() ? Json(nullptr) : scores;
}

}  // namespace

std::string LiveScene::page_data(const PageText& text) const {
  const splat::Gaussians gaussians = gaussians_();
  Json data{{"title", dataset_.name},
            {"facts", text.facts},
            {"headline", nullptr},
            {"evaluation", scores_of(text)},
            {"config", text.config},
            {"metrics", Json::array()},
            {"allocation", {{"views", Json::array()}}},
            {"views", Json::array()},
            {"tests", Json::array()}};
  for (const auto& [camera, pictures] : pictures_) {
    Json names = Json::array();
    for (const ViewPicture& each : pictures) names.push_back({{"name", each.name}});
    Json view{{"name", camera}, {"camera", camera}, {"seen", nullptr}, {"pictures", names}};
    const CameraOfPage of = camera_of_page(dataset_, camera).value();
    if (of.exposure) {
      view["events"] = page_film(dataset_.train[of.index],
                                 std::min(kFilmBytes, kAllFilmBytes / dataset_.train.size()));
    }
    data[of.exposure ? "views" : "tests"].push_back(std::move(view));
  }
  data["scene"] = page_scene(dataset_, draw_);
  data["live"] = {{"id", text.server_id},
                  {"scale", gaussians.means.is_cuda() ? kGpuScale : 1.0},
                  {"pausable", text.pausable},
                  {"moving", text.moving},
                  {"report", text.report},
                  {"sample", sample_of(gaussians)},
                  {"pixels", serve::Wanted::kMostPixels}};
  return data.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace jade::run
