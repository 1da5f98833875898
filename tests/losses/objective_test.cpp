// SPDX-License-Identifier: Apache-2.0
#include "jade/losses/objective.h"

#include <ATen/Parallel.h>
#include <map>
#include <set>
#include <torch/csrc/autograd/autograd.h>

#include "jade/core/error.h"
#include "jade/losses/poses.h"
#include "jade/losses/terms.h"
#include "loss_cases.h"

namespace jade::losses {
namespace {

using test::check_gradients;
using test::image;

constexpr int64_t kLate = 8000;

ObjectiveInputs inputs(const torch::Tensor& renders) {
  ObjectiveInputs in;
  in.renders = renders;
  in.blurry = imaging::ssim_target(image(20));
  in.edi_factors = EdiFactors::of(image(21, {3, 1, 7, 9}) + 0.5);
  in.pose_draws = torch::tensor({2, 4, 8}, torch::kInt64);
  in.target = Fixed(image(22));
  in.tone = [](const std::vector<ToneInput>& asked) {
    std::vector<torch::Tensor> toned;
    for (const ToneInput& each : asked) {
      const torch::Tensor squared = each.image.square();
      toned.push_back(each.weights.defined() ? weighted_mean(squared, each.weights) : squared);
    }
    return toned;
  };
  return in;
}

torch::Tensor renders() { return image(10, {9, 3, 7, 9}); }

/// Printed options, with every term at full weight from its first step to the end.
struct PrintedOptions : ObjectiveOptions {
  PrintedOptions() {
    target_until = 0;
    restored_poses = RestoredPoses::kMiddle;
    edi_weight_final = -1;
    trust.agreement = 0;
  }
};

Objective objective_at(const ObjectiveInputs& in, int64_t step,
                       const ObjectiveOptions& options = PrintedOptions()) {
  return objective(in, plan_objective(options, step), options);
}

std::set<std::string> names(const Objective& loss) {
  std::set<std::string> result;
  for (const NamedTerm& term : loss.terms) result.insert(term.name);
  return result;
}

TEST_CASE("pose_views: mean and picks are those of single selections, gradients too", "[losses]") {
  const torch::Tensor poses = torch::tensor({4, 2, 4}, torch::kInt64);
  const PoseViews views = pose_views(renders(), poses);
  CHECK(torch::allclose(views.mean, renders().mean(0)));
  CHECK(torch::equal(views.picks[1], renders()[2]));
  CHECK(torch::equal(views.all, renders()));
  check_gradients(
      [&](const std::vector<torch::Tensor>& in) {
        const PoseViews v = pose_views(in[0], poses);
        return torch::cat(
            {v.mean.flatten(), torch::stack(v.picks).square().flatten(), v.all.pow(3).flatten()});
      },
      {renders()}, {"renders"});
}

TEST_CASE("pose_views: weights of the mean reach its gradient, not that of the picks", "[losses]") {
  const torch::Tensor poses = torch::tensor({4, 2, 4}, torch::kInt64);
  const torch::Tensor weights = image(3, {9}) / 4;
  const PoseViews views = pose_views(renders(), poses, weights);
  CHECK(torch::allclose(views.mean, torch::einsum("k,kchw->chw", {weights, renders()})));
  CHECK_FALSE(torch::allclose(views.mean, renders().mean(0)));
  check_gradients(
      [&](const std::vector<torch::Tensor>& in) {
        const PoseViews v = pose_views(in[0], poses, weights);
        return torch::cat({v.mean.square().flatten(), torch::stack(v.picks).square().flatten()});
      },
      {renders()}, {"renders"});
}

TEST_CASE("pose_views: the weighted mean adds pose by pose, for any number of threads",
          "[losses]") {
  const torch::Tensor images = image(5, {9, 3, 110, 101}).to(torch::kFloat32);
  const torch::Tensor weights = image(6, {9}).to(torch::kFloat32);
  torch::Tensor expected = images[0] * weights[0];
  for (int64_t k = 1; k < 9; ++k) expected = expected + images[k] * weights[k];
  const int threads = at::get_num_threads();
  for (const int count : {1, 2, 3}) {
    at::set_num_threads(count);
    const PoseViews views = pose_views(images, torch::tensor({1}, torch::kInt64), weights);
    CHECK(views.mean.equal(expected));
  }
  at::set_num_threads(threads);
}

TEST_CASE("pose_views: a first pick comes before the others; what nobody reads has no gradient",
          "[losses]") {
  const torch::Tensor images = renders().set_requires_grad(true);
  const torch::Tensor poses = torch::tensor({2, 4}, torch::kInt64);
  const PoseViews views = pose_views(images, poses, {}, 4);
  REQUIRE(views.picks.size() == 3);
  CHECK(views.picks[0].equal(images[4]));
  CHECK(views.picks[2].equal(images[4]));
  (views.picks[0].sum() + 2 * views.picks[2].sum()).backward();
  for (int64_t k = 0; k < 9; ++k) {
    CHECK(images.grad()[k].eq(k == 4 ? 3 : 0).all().item<bool>());
  }
}

TEST_CASE("pose_views: a GPU agrees with the CPU, gradients too", "[losses][cuda]") {
  const auto run = [](torch::Device device, const torch::Tensor& weights) {
    const torch::Tensor images =
        renders().to(torch::kFloat32).to(device).detach().set_requires_grad(true);
    const PoseViews views = pose_views(images, torch::tensor({2, 4, 2}, torch::kInt64).to(device),
                                       weights.defined() ? weights.to(device) : weights, 4);
    // The second pick has no gradient.
    (views.mean.square().sum() + views.picks[0].square().sum() + views.picks[1].sum() +
     views.picks[3].pow(3).sum() + views.all.pow(4).sum())
        .backward();
    return std::vector<torch::Tensor>{views.mean.detach().cpu(), views.picks[2].detach().cpu(),
                                      images.grad().cpu()};
  };
  for (const torch::Tensor& weights : {torch::Tensor(), image(3, {9}).to(torch::kFloat32)}) {
    const auto cpu = run(torch::kCPU, weights), gpu = run(torch::kCUDA, weights);
    for (size_t i = 0; i < cpu.size(); ++i) CHECK(torch::allclose(gpu[i], cpu[i], 1e-5, 1e-6));
  }
}

TEST_CASE("objective plan: what acts follows the calendar", "[losses]") {
  PrintedOptions options;
  const auto plan = [&](int64_t step) { return plan_objective(options, step); };
  CHECK(plan(1) == plan(1500));
  CHECK(plan(1500) != plan(1501));
  CHECK(plan(1501) == plan(7000));
  CHECK(plan(7000) != plan(7001));
  CHECK_FALSE(plan(1500).response);
  CHECK(plan(1501).response);
  CHECK(plan(1).all_poses());
  options.target_until = 10;
  CHECK(plan(10).target);
  CHECK_FALSE(plan(11).target);
  options.blur = options.edi_supervision = options.intensity = options.simulation = false;
  CHECK_FALSE(plan(1501).response);  // nothing reads it
  CHECK_FALSE(plan(10).all_poses());
  CHECK(plan(10).any_term());
  CHECK_FALSE(plan(11).any_term());
  options.event_loss_weight = 0.1;
  CHECK(plan(11).any_term());
  CHECK(plan(1501).response);
}

TEST_CASE("objective: terms begin at the inherited steps", "[losses]") {
  const ObjectiveInputs in = inputs(renders());
  const std::set<std::string> early = {"target", "blur", "edi_gray", "edi_color"};
  CHECK(names(objective_at(in, 1)) == early);
  CHECK(names(objective_at(in, 1500)) == early);
  std::set<std::string> middle = early;
  middle.insert("intensity");
  CHECK(names(objective_at(in, 1501)) == middle);
  CHECK(names(objective_at(in, 7000)) == middle);
  std::set<std::string> late = middle;
  late.insert("simulation");
  CHECK(names(objective_at(in, 7001)) == late);
  PrintedOptions until;
  until.target_until = 7000;
  CHECK(names(objective_at(in, 7000, until)) == middle);
  late.erase("target");
  CHECK(names(objective_at(in, 7001, until)) == late);
}

TEST_CASE("objective: a disabled term is absent and its inputs are not needed", "[losses]") {
  ObjectiveInputs in = inputs(renders());
  PrintedOptions options;
  options.edi_supervision = options.simulation = options.intensity = false;
  in.edi_factors = {};
  in.target.reset();
  CHECK_THROWS_AS(objective_at(in, kLate, options), ContractError);
  options.target = Target::kNone;
  CHECK(names(objective_at(in, kLate, options)) == std::set<std::string>{"blur"});
  options.event_loss_weight = 1;
  CHECK_THROWS_AS(objective_at(in, kLate, options), ContractError);
  options.event_loss_weight = 0;
  options.blur = false;
  CHECK(objective_at(in, kLate, options).terms.empty());
  CHECK_FALSE(objective_at(in, kLate, options).total.defined());
}

TEST_CASE("objective: the total is the sum of its named terms and of the single functions",
          "[losses]") {
  ObjectiveInputs in = inputs(renders());
  PrintedOptions options;
  options.target_weight = 2;
  const Objective loss = objective_at(in, kLate, options);
  double sum = 0;
  for (const NamedTerm& term : loss.terms) sum += term.value.item<double>();
  CHECK(loss.total.item<double>() == Approx(sum));
  const torch::Tensor r = renders(), b = in.blurry.image, toned_b = b * b;
  const EdiFactors& gain = in.edi_factors;
  const auto rec = [](const imaging::L1SsimPair& pair) {
    return imaging::l1_ssim(pair.a, pair.c, 0.3);
  };
  const torch::Tensor expected =
      2 * target_loss(r[4], *in.target, 0.3) + rec(blur_pair(r.mean(0), {b, {}, {}})) +
      rec(edi_gray_pair(r[2].square(), toned_b, gain.gray)) +
      rec(edi_color_pair(r[4], b, gain.color)) +
      rec(simulation_pair(r[8].square(), r.mean(0).square(), gain.simulation)) +
      rec(intensity_pair(r.square().mean(0), toned_b));
  CHECK(loss.total.item<double>() == Approx(expected.item<double>()));
}

TEST_CASE("objective: the parts of a plan have the loss and the gradient of the whole",
          "[losses]") {
  PrintedOptions always, agreed;
  agreed.target_until = 10;
  agreed.trust.agreement = 100;
  for (const ObjectiveOptions& options : {ObjectiveOptions(always), ObjectiveOptions(agreed)}) {
    const ObjectivePlan plan = plan_objective(options, kLate);
    const torch::Tensor whole = renders().set_requires_grad(true);
    const Objective expected = objective(inputs(whole), plan, options);
    expected.total.backward();

    const torch::Tensor leaf = renders().set_requires_grad(true);
    const ObjectiveInputs in = inputs(leaf);
    const Views views = pick_views(in, plan);
    const Objective target = objective(views, in, plan.only_target(), options);
    const Objective rest = objective(views, in, plan.without_target(), options);
    CHECK(names(target).count("target") == 1);
    CHECK(names(rest).count("target") == 0);
    CHECK(target.terms.size() + rest.terms.size() == expected.terms.size());
    torch::autograd::backward({target.total, rest.total}, {});
    CHECK((target.total + rest.total).item<double>() == Approx(expected.total.item<double>()));
    CHECK(torch::allclose(leaf.grad(), whole.grad()));
  }
}

TEST_CASE("objective: the camera response is the identity during the warm-up", "[losses]") {
  ObjectiveInputs in = inputs(renders());
  const double toned = objective_at(in, 1000).total.item<double>();
  in.tone = {};
  CHECK(objective_at(in, 1000).total.item<double>() == toned);
  CHECK(objective_at(in, kLate).total.item<double>() !=
        objective_at(inputs(renders()), kLate).total.item<double>());
}

TEST_CASE("objective: the event term carries its weight", "[losses]") {
  ObjectiveInputs in = inputs(renders());
  EventPair pair;
  pair.renders = image(1, {2, 3, 7, 9});
  pair.counts = (image(5, {7, 9}) * 10 - 5).round();
  pair.pixels = torch::arange(63, torch::kInt64);
  in.events = pair;
  PrintedOptions options;
  options.event_loss_weight = 0.1;
  const Objective loss = objective_at(in, 1, options);
  CHECK(loss.terms.back().name == "event");
  CHECK(loss.terms.back().value.item<double>() == Approx(0.1 * event_loss(pair).item<double>()));
}

TEST_CASE("objective: where no term reads the mean, the poses that are read suffice", "[losses]") {
  PrintedOptions options;
  options.blur = options.simulation = options.intensity = false;
  const auto rows = [&](int64_t step = kLate) {
    const torch::Tensor read =
        poses_read(plan_objective(options, step), torch::tensor({2, 4, 8}, torch::kInt64));
    return read.defined() ? std::vector<int64_t>(read.data_ptr<int64_t>(),
                                                 read.data_ptr<int64_t>() + read.numel())
                          : std::vector<int64_t>{};
  };
  const auto check_same_loss = [&] {
    const ObjectiveInputs nine = inputs(renders());
    ObjectiveInputs few = inputs(renders());
    few.renders =
        few.renders.index_select(0, poses_read(plan_objective(options, kLate), few.pose_draws));
    CHECK(objective_at(few, kLate, options).total.item<double>() ==
          Approx(objective_at(nine, kLate, options).total.item<double>()));
    few.renders = few.renders.repeat({2, 1, 1, 1});
    CHECK_THROWS_AS(objective_at(few, kLate, options), ContractError);
  };
  CHECK(rows() == std::vector<int64_t>{4, 2, 4});
  check_same_loss();
  options.target_until = 10;
  CHECK(rows() == std::vector<int64_t>{2, 4});
  check_same_loss();
  options.target_until = 0;
  options.edi_supervision = false;
  CHECK(rows() == std::vector<int64_t>{4});
  check_same_loss();
  options.simulation = true;
  CHECK(rows(1) == std::vector<int64_t>{4});
  CHECK(rows().empty());  // L_sim has begun
  options.simulation = false;
  options.blur = true;
  CHECK(rows().empty());
}

TEST_CASE("objective: weights of the renders change the terms that read their mean, and only these",
          "[losses]") {
  const ObjectiveInputs plain = inputs(renders());
  ObjectiveInputs weighted = plain;
  weighted.weights = torch::full({9}, 1.0 / 8, torch::kFloat64);
  weighted.weights[0] = weighted.weights[8] = 1.0 / 16;
  const Objective a = objective_at(plain, kLate), b = objective_at(weighted, kLate);
  REQUIRE(a.terms.size() == b.terms.size());
  const std::set<std::string> of_mean = {"blur", "simulation", "intensity"};
  for (size_t i = 0; i < a.terms.size(); ++i) {
    INFO(a.terms[i].name);
    CHECK(a.terms[i].value.equal(b.terms[i].value) == (of_mean.count(a.terms[i].name) == 0));
  }
}

TEST_CASE("objective: seventeen renders have their middle at the ninth", "[losses]") {
  PrintedOptions options;
  options.edi_supervision = options.simulation = options.intensity = options.blur = false;
  ObjectiveInputs in = inputs(image(11, {17, 3, 7, 9}));
  in.samples = 17;
  CHECK(objective_at(in, 1, options).total.item<double>() ==
        Approx(target_loss(in.renders[8], *in.target, 0.3).item<double>()));
  const torch::Tensor read = poses_read(plan_objective(options, 1), in.pose_draws, 17);
  CHECK(read.equal(torch::tensor({8}, torch::kInt64)));
}

TEST_CASE("objective: a drawn target is compared with the render of its pose, all else stays",
          "[losses]") {
  PrintedOptions options;
  const ObjectivePlan middle = plan_objective(options, kLate);
  options.restored_poses = RestoredPoses::kNine;
  const ObjectivePlan plan = plan_objective(options, kLate);
  CHECK_FALSE(middle.drawn_target);
  CHECK(plan.drawn_target);
  CHECK(plan != middle);
  ObjectiveInputs in = inputs(renders());
  CHECK_THROWS_AS(objective(in, plan, options), ContractError);
  const Objective at_middle = objective(in, middle, options);
  in.pose_draws = torch::tensor({2, 4, 8, 7}, torch::kInt64);
  in.renders.set_requires_grad(true);
  const Objective drawn = objective(in, plan, options);
  REQUIRE(drawn.terms.size() == at_middle.terms.size());
  for (size_t i = 0; i < drawn.terms.size(); ++i) {
    INFO(drawn.terms[i].name);
    CHECK(drawn.terms[i].value.equal(at_middle.terms[i].value) ==
          (drawn.terms[i].name != "target"));
  }
  CHECK(drawn.terms[0].value.item<double>() ==
        Approx(target_loss(renders()[7], *in.target, 0.3).item<double>()));
  drawn.terms[0].value.backward();
  const torch::Tensor gradient = in.renders.grad();
  for (int64_t k = 0; k < 9; ++k) {
    INFO(k);
    CHECK((gradient[k].abs().sum().item<double>() > 0) == (k == 7));
  }
  // The fourth sampled pose has no effect if the target is off.
  CHECK(objective(in, middle, options).total.item<double>() ==
        Approx(at_middle.total.item<double>()));
}

TEST_CASE("objective: the poses read of a drawn target begin with its own", "[losses]") {
  ObjectiveOptions options;
  options.blur = options.intensity = options.simulation = false;
  options.restored_poses = RestoredPoses::kNine;
  const torch::Tensor draws = torch::tensor({2, 4, 8, 7}, torch::kInt64);
  const ObjectivePlan plan = plan_objective(options, kLate);
  CHECK(poses_read(plan, draws).equal(torch::tensor({7, 2, 4}, torch::kInt64)));
  ObjectiveInputs nine = inputs(renders());
  nine.pose_draws = draws;
  ObjectiveInputs few = nine;
  few.renders = nine.renders.index_select(0, poses_read(plan, draws));
  CHECK(objective(few, plan, options).total.item<double>() ==
        Approx(objective(nine, plan, options).total.item<double>()));
  options.target = Target::kNone;
  CHECK_FALSE(plan_objective(options, kLate).drawn_target);
}

TEST_CASE("objective: agreement is asked of the drawn pose", "[losses]") {
  ObjectiveOptions options;
  options.restored_poses = RestoredPoses::kNine;
  options.target_until = 10;
  options.trust.agreement = 1e-3;
  ObjectiveInputs in = inputs(renders());
  in.target = Fixed(renders()[7]);
  const auto target_at = [&](int64_t pose) {
    in.pose_draws = torch::tensor(std::vector<int64_t>{2, 4, 8, pose}, torch::kInt64);
    in.renders = renders() + 1e-4;
    in.renders.set_requires_grad(true);
    const Objective loss = objective_at(in, kLate, options);
    loss.terms[0].value.backward();
    return in.renders.grad().abs().sum().item<double>();
  };
  CHECK(target_at(7) > 0);
  CHECK(target_at(6) == 0);
}

TEST_CASE("objective: weights that fall are those of the step", "[losses]") {
  PrintedOptions options;
  CHECK_FALSE(weights_fall(options));
  CHECK(term_weights(options, 70, 100) == std::array<double, 2>{1, 1});
  options.target_weight = 2;
  options.edi_weight_final = 0.5;
  CHECK(weights_fall(options));
  CHECK(term_weights(options, 25, 100) == std::array<double, 2>{2, 0.875});
  CHECK(term_weights(options, 400, 100) == std::array<double, 2>{2, 0.5});
  ObjectiveInputs in = inputs(renders());
  const Objective full = objective_at(in, 1);
  in.term_weights = torch::tensor({0.5, 0.25});
  const Objective late = objective_at(in, 1, options);
  const std::map<std::string, double> share = {
      {"target", 0.5}, {"blur", 1}, {"edi_gray", 0.25}, {"edi_color", 0.25}};
  for (size_t i = 0; i < full.terms.size(); ++i) {
    INFO(full.terms[i].name);
    CHECK(late.terms[i].value.item<double>() ==
          Approx(full.terms[i].value.item<double>() * share.at(full.terms[i].name)));
  }
}

TEST_CASE("objective: after target_until the target stays where the scene agrees with it",
          "[losses]") {
  PrintedOptions options;
  options.target_until = 10;
  const torch::Tensor images = renders().set_requires_grad(true);
  const ObjectiveInputs in = inputs(images);
  const double all = objective_at(in, 10, options).terms.front().value.item<double>();
  const auto kept = [&](double bound) {
    options.trust.agreement = bound;
    const Objective loss = objective_at(in, 11, options);
    const NamedTerm &term = loss.terms[0], &distance = loss.terms[1];
    REQUIRE(term.name == "target");
    REQUIRE(distance.name == "target_distance");
    CHECK_FALSE(distance.in_total);
    CHECK(distance.value.item<double>() == all);
    double total = 0;
    for (const NamedTerm& each : loss.terms) total += each.in_total ? each.value.item<double>() : 0;
    CHECK(loss.total.item<double>() == Approx(total));
    images.mutable_grad() = torch::Tensor();
    term.value.backward();
    return std::pair(term.value.item<double>(), images.grad().abs().max().item<double>() > 0);
  };
  CHECK(kept(1.01 * all) == std::pair(all, true));
  CHECK(kept(0.99 * all) == std::pair(0.0, false));
}

TEST_CASE("objective: gradients to all nine renders equal central differences", "[losses]") {
  check_gradients(
      [&](const std::vector<torch::Tensor>& in) {
        return objective_at(inputs(in[0]), kLate).total;
      },
      {renders()}, {"renders"});
}

}  // namespace
}  // namespace jade::losses
