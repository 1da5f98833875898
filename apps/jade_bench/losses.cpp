// SPDX-License-Identifier: Apache-2.0
#include "losses.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>
#include <torch/types.h>

#include "jade/core/random.h"
#include "jade/geometry/trajectory.h"
#include "jade/imaging/color.h"
#include "jade/losses/objective.h"
#include "jade/losses/poses.h"
#include "jade/losses/route.h"
#include "jade/losses/terms.h"
#include "jade/response/camera_response.h"
#include "jade/restore/restorations.h"
#include "jade/router/router.h"
#include "jade/train/options.h"

namespace jade::bench {
namespace {

constexpr double kDssim = 0.3;
constexpr int64_t kEventPixels = 1024;
/// A step at which every term is active.
constexpr int64_t kStep = 8001;

/// Images as in a training step. Leaves are the tensors to differentiate by.
struct Images {
  torch::Tensor renders;              ///< [9,3,H,W], leaf
  torch::Tensor image, other, alpha;  ///< [3,H,W], [3,H,W], [1,H,W], leaves
  torch::Tensor blurry, factors, counts, pixels, measured, draws;
  imaging::SsimTarget blurry_moments;
  restore::Restorations restorations;
  router::Router router{make_generator(0, "router")};
  response::CameraResponse response;

  Images(int64_t height, int64_t width, torch::Device device) {
    at::Generator generator = make_generator(0, "losses benchmark");
    const auto draw = [&](at::IntArrayRef shape) { return at::rand(shape, generator).to(device); };
    const auto leaf = [&](at::IntArrayRef shape) { return draw(shape).set_requires_grad(true); };
    renders = leaf({geometry::kExposurePoses, 3, height, width});
    image = leaf({3, height, width});
    other = leaf({3, height, width});
    alpha = leaf({1, height, width});
    blurry = draw({3, height, width});
    blurry_moments = imaging::ssim_target(blurry);
    factors = draw({geometry::kExposurePoses, 1, height, width}) + 0.5;
    counts = (6 * draw({height, width}) - 3).round();
    pixels = at::randperm(height * width, generator, torch::kInt64)
                 .narrow(0, 0, std::min(kEventPixels, height * width))
                 .to(device);
    measured = torch::cat({blurry, draw({2, height, width})}).unsqueeze(0);
    draws = torch::tensor({1, 6, 2}, torch::kInt64).to(device);
    restorations.edi = draw({3, height, width});
    restorations.efnet = draw({3, height, width});
    router->to(device);
    response->to(device);
  }

  torch::Tensor toned(const torch::Tensor& x) const {
    const torch::Tensor table = response::CameraResponse(response)->table();
    return response::CameraResponseImpl::apply_all({{x, {}}}, table)[0];
  }

  losses::Objective objective() const {
    losses::ObjectiveInputs inputs;
    inputs.renders = renders;
    inputs.blurry = blurry_moments;
    inputs.pose_draws = draws;
    inputs.edi_factors = losses::EdiFactors::of(factors.index_select(0, inputs.pose_draws));
    inputs.target.emplace(restorations.edi);
    const torch::Tensor table = response::CameraResponse(response)->table();
    inputs.tone = [table](const std::vector<losses::ToneInput>& asked) {
      std::vector<response::ResponseInput> images;
      for (const losses::ToneInput& each : asked) images.push_back({each.image, each.weights});
      return response::CameraResponseImpl::apply_all(images, table);
    };
    const losses::ObjectiveOptions options = train::printed_options().objective;
    return losses::objective(inputs, losses::plan_objective(options, kStep), options);
  }
};

struct Term {
  const char* name;
  std::function<torch::Tensor(const Images&)> value;
};

torch::Tensor rec_of(const imaging::L1SsimPair& pair) {
  return imaging::l1_ssim(pair.a, pair.c, kDssim);
}

std::vector<Term> terms() {
  using losses::Fixed;
  return {
      {"rec", [](const Images& in) { return imaging::l1_ssim(in.image, in.blurry, kDssim); }},
      {"target",
       [](const Images& in) { return losses::target_loss(in.image, Fixed(in.blurry), kDssim); }},
      {"blur",
       [](const Images& in) { return rec_of(losses::blur_pair(in.image, in.blurry_moments)); }},
      {"edi_gray",
       [](const Images& in) {
         return rec_of(losses::edi_gray_pair(in.image, in.other, in.factors[0]));
       }},
      {"edi_color",
       [](const Images& in) {
         return rec_of(losses::edi_color_pair(in.image, in.blurry, in.factors[0]));
       }},
      {"simulation",
       [](const Images& in) {
         return rec_of(losses::simulation_pair(in.image, in.other, in.factors[0]));
       }},
      {"intensity",
       [](const Images& in) { return rec_of(losses::intensity_pair(in.image, in.other)); }},
      {"pairs",  // the images of L_tgt, L_blur, L_edi in colour and L_int, in one pass
       [](const Images& in) {
         return imaging::l1_ssim_sum({{losses::target_pairs(in.image, Fixed(in.blurry)), 1, {}},
                                      {{{in.image, in.blurry_moments}}, 1, {}},
                                      {{{in.image, {in.blurry, {}, {}}}}, 1, {}},
                                      {{{in.image, {in.other, {}, {}}}}, 1, {}}},
                                     kDssim)
             .total;
       }},
      {"gray", [](const Images& in) { return imaging::gray(in.image).sum(); }},
      {"views",
       [](const Images& in) {
         const losses::PoseViews views = losses::pose_views(in.renders, in.draws, {}, 4);
         return views.mean.sum() + views.picks[0].sum() + views.picks[1].sum();
       }},
      {"response", [](const Images& in) { return in.toned(in.image).sum(); }},
      {"event",
       [](const Images& in) {
         losses::EventPair pair;
         pair.renders = torch::stack({in.image, in.other});
         pair.counts = in.counts;
         pair.pixels = in.pixels;
         return losses::event_loss(pair);
       }},
      {"route",
       [](const Images& in) {
         return losses::route_loss(in.alpha, in.restorations, Fixed(in.image), in.factors[0],
                                   in.blurry, {})
             .total;
       }},
      {"router",
       [](const Images& in) { return router::Router(in.router)->logits(in.measured).sum(); }},
      {"objective", [](const Images& in) { return in.objective().total; }}};
}

/// @throws ConfigError for a name that no term has.
void check_term(const std::string& name) {
  std::string known;
  for (const Term& term : terms()) {
    if (name == term.name) return;
    known += (known.empty() ? "" : ", ") + std::string(term.name);
  }
  throw ConfigError(concat("--term: expected one of ", known, "; found '", name, "'"));
}

nlohmann::json measure(const Term& term, int64_t height, int64_t width, const Repeats& repeats,
                       torch::Device device) {
  const Images images(height, width, device);
  const auto forward = [&] {
    const torch::NoGradGuard no_grad;
    term.value(images);
  };
  const Times alone = time(forward, repeats, device);
  reset_peak(device);
  const Times both = time([&] { term.value(images).backward(); }, repeats, device);
  return {{"name", term.name},
          {"device", device.str()},
          {"views", std::string(term.name) == "objective" ? geometry::kExposurePoses : 1},
          {"width", width},
          {"height", height},
          {"forward_ms", to_json(alone)},
          {"forward_backward_ms", to_json(both)},
          {"peak_mib", std::round(peak_mib(device) * 10) / 10}};
}

}  // namespace

CLI::App* LossesBench::add_to(CLI::App& cli) {
  CLI::App* const command = cli.add_subcommand(
      "losses",
      "Every loss term and the router, at 346x260 and 600x400; objective is all of Eq. (10)");
  command->fallthrough();
  command->add_option("--term", names, "Only these terms")->type_name("LIST")->delimiter(',');
  repeats.add_to(*command);
  return command;
}

ExitCode LossesBench::run(const apps::Program& program) const {
  torch::Device device = program.device();
  if (device.is_cuda() && !device.has_index()) device.set_index(0);
  for (const std::string& name : names) check_term(name);
  nlohmann::json rows = nlohmann::json::array();
  const int64_t sizes[][2] = {{260, 346}, {400, 600}};
  for (const auto& [height, width] : sizes) {
    for (const Term& term : terms()) {
      const bool named = std::find(names.begin(), names.end(), term.name) != names.end();
      if (!names.empty() && !named) continue;
      rows.push_back(measure(term, height, width, repeats, device));
      if (program.json()) continue;
      std::printf("%-11s %4dx%-4d %9.3f ms forward %9.3f ms forward+backward\n", term.name,
                  static_cast<int>(width), static_cast<int>(height),
                  rows.back()["forward_ms"]["median"].get<double>(),
                  rows.back()["forward_backward_ms"]["median"].get<double>());
      std::fflush(stdout);
    }
  }
  if (program.json()) std::cout << nlohmann::json{{"workloads", rows}}.dump(2) << '\n';
  return ExitCode::kOk;
}

}  // namespace jade::bench
