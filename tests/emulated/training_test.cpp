// SPDX-License-Identifier: Apache-2.0
// The small CUDA kernels of a training step, run thread by thread on the CPU, against the CPU code
// of their rooms.
#include "support/catch.h"

#include <array>
#include <numeric>
#include <torch/types.h>
#include <vector>

#include "emulated/block.h"
#include "jade/response/camera_response.h"
#include "support/backend_agreement.h"

#define cuda emulated_cuda
#include "jade/events/count.h"
#include "jade/gaussians/adam.h"
#include "jade/gaussians/noise.h"
#include "jade/geometry/exposure_path.h"
#include "jade/losses/event_loss_kernels.h"
#include "jade/losses/poses_kernels.h"
#include "jade/losses/route_kernels.h"
#include "jade/response/lookup.h"
#include "jade/response/table.h"
#include "jade/train/batch_copy.h"
#include "jade/train/pose_update.h"
#undef cuda

using namespace jade;
using emulated::ForcedOrder;
using emulated::Order;
using torch::Tensor;

namespace {

constexpr Order kOrders[] = {Order::kAscending, Order::kDescending};

Tensor random_rotations(int64_t count) { return torch::randn({count, 4}); }

}  // namespace

TEST_CASE("emulated cuda: the loss of the events and its gradient", "[emulated]") {
  torch::manual_seed(3);
  losses::EventPair pair;
  pair.renders = torch::rand({2, 3, 17, 43});
  pair.counts = (torch::rand({17, 43}) * 8 - 4).round();
  pair.threshold_negative = 0.3;
  for (const int64_t count : {0, 1, 255, 700}) {
    pair.pixels = torch::randperm(17 * 43, torch::kInt64).narrow(0, 0, count).contiguous();
    for (const bool color : {false, true}) {
      INFO(count << " pixels, in colour: " << color);
      pair.color_filter = color ? torch::rand({17, 43, 3}) > 0.5 : Tensor();
      pair.weighted_colors = color;
      const auto outputs = [&](const auto& forward, const auto& backward) {
        std::vector<Tensor> out{torch::empty({}), torch::empty({count}, torch::kFloat64),
                                torch::empty({1}, torch::kFloat64), torch::zeros({2, 3, 17, 43})};
        forward(pair, out[0], out[1], out[2]);
        backward(pair, out[1], out[2], torch::full({}, 0.7f), out[3]);
        return out;
      };
      const auto expected = outputs(losses::cpu::event_loss, losses::cpu::event_loss_gradient);
      for (const Order order : kOrders) {
        const ForcedOrder forced(order);
        const auto found =
            outputs(losses::emulated_cuda::event_loss, losses::emulated_cuda::event_loss_gradient);
        CHECK(torch::allclose(found[0], expected[0]));
        CHECK(found[1].equal(expected[1]));
        CHECK(torch::allclose(found[2], expected[2]));
        CHECK(torch::allclose(found[3], expected[3]));
      }
      if (count == 700) CHECK(expected[3].count_nonzero().item<int64_t>() > 700);
    }
  }
}

TEST_CASE("emulated cuda: the loss of the routing step and its gradient", "[emulated]") {
  torch::manual_seed(4);
  // More pixels than the first kernel has threads, and fewer than a block has.
  for (const auto& [height, width] : {std::pair{290, 241}, {3, 5}}) {
    const auto image = [&, h = height, w = width](int64_t channels) {
      return torch::rand({channels, h, w});
    };
    losses::RouteTensors all{image(1),        image(3), image(3), image(3),
                             image(1) + 0.5f, image(3), 0.3};
    all.edi[0] = all.efnet[0];     // where α does not matter
    all.render[0] = all.efnet[0];  // and the derivative of |x| is undefined
    losses::RouteTensors render = all, reblur = all;
    render.kernel = render.blurry = Tensor();
    reblur.render = Tensor();
    for (const losses::RouteTensors& images : {all, render, reblur}) {
      const auto outputs = [&](const auto& forward, const auto& backward) {
        std::vector<Tensor> out{torch::empty({losses::kRouteValues}), torch::empty_like(all.alpha)};
        forward(images, out[0]);
        backward(images, torch::full({}, 0.7f), out[1]);
        return out;
      };
      const auto expected = outputs(losses::cpu::route_loss, losses::cpu::route_gradient);
      CHECK(expected[1].count_nonzero().item<int64_t>() > 0);
      for (const Order order : kOrders) {
        const ForcedOrder forced(order);
        const auto found =
            outputs(losses::emulated_cuda::route_loss, losses::emulated_cuda::route_gradient);
        CHECK(torch::allclose(found[0], expected[0]));
        CHECK(torch::allclose(found[1], expected[1], 1e-5, 0));
      }
    }
  }
}

TEST_CASE("emulated cuda: the mean of the renders, its picks and their gradient", "[emulated]") {
  torch::manual_seed(1);
  const int64_t samples = 5;
  const Tensor renders = torch::rand({samples, 3, 7, 43});
  for (const bool weighted : {false, true}) {
    losses::PosePicks picks;
    picks.indices = torch::tensor({1, 4, 1}, torch::kInt64);
    picks.first = 2;
    if (weighted) picks.weights = torch::rand({samples});
    const Tensor weights = weighted ? picks.weights : torch::full({samples}, 0.2f);
    Tensor mean = torch::empty({3, 7, 43});
    std::vector<Tensor> picked(4);
    for (Tensor& each : picked) each = torch::empty_like(mean);
    losses::emulated_cuda::pose_views(picks, renders, mean, picked);
    CHECK(torch::allclose(mean, (renders * weights.view({samples, 1, 1, 1})).sum(0)));
    for (size_t m = 0; m < 4; ++m) {
      CHECK(picked[m].equal(renders[std::array{2, 1, 4, 1}[m]]));
    }
    losses::PoseGradients of;
    of.mean = torch::rand_like(mean);
    for (int m = 0; m < 4; ++m) of.picks.push_back(m == 2 ? Tensor() : torch::rand_like(mean));
    if (weighted) of.all = torch::rand_like(renders);
    Tensor found = torch::empty_like(renders), expected = torch::empty_like(renders);
    losses::emulated_cuda::pose_gradient(picks, of, found);
    losses::cpu::pose_gradient(picks, of, expected);
    CHECK(torch::allclose(found, expected));
  }
}

TEST_CASE("emulated cuda: the camera response's lookups of a call and their gradients",
          "[emulated]") {
  torch::manual_seed(2);
  const auto image = [](at::IntArrayRef shape) { return 2.4 * torch::rand(shape) - 0.2; };
  // Weights as kernel arguments, weights in memory, and none.
  const response::Lookups args{{{image({4, 3, 11, 13}), torch::rand({4})},
                                {image({3, 3, 40, 50}), {}},
                                {image({43, 3, 5, 7}), torch::rand({43})},
                                {image({2, 7}), torch::rand({2})},
                                {image({5}), {}}},
                               torch::rand({response::kKnots})};
  const std::vector<Tensor> out = response::cpu::lookup(args);
  std::vector<Tensor> cotangents;
  for (const Tensor& each : out) cotangents.push_back((torch::rand_like(each) - 0.5) / 1e4);
  cotangents[3] = Tensor();
  for (const bool table : {true, false}) {
    const response::LookupWanted wanted{{true, false, true, true, true}, table};
    const auto expected = response::cpu::lookup_backward(args, cotangents, wanted);
    for (const Order order : kOrders) {
      const ForcedOrder forced(order);
      const std::vector<Tensor> values = response::emulated_cuda::lookup(args);
      const auto found = response::emulated_cuda::lookup_backward(args, cotangents, wanted);
      for (size_t i = 0; i < out.size(); ++i) {
        INFO("image " << i);
        CHECK(torch::allclose(values[i], out[i], 1e-5, 1e-6));
        const bool there = wanted.images[i] && cotangents[i].defined();
        REQUIRE(found.images[i].defined() == there);
        REQUIRE(expected.images[i].defined() == there);
        if (there) CHECK(torch::allclose(found.images[i], expected.images[i], 1e-3, 1e-8));
      }
      REQUIRE(found.table.defined() == table);
      if (table) CHECK(torch::allclose(found.table, expected.table, 1e-4, 1e-9));
    }
  }
}

TEST_CASE("emulated cuda: sums over the response's table are exact beyond 32 bits", "[emulated]") {
  // 2^50 in fixed point is 1, so that each of these overflows the low half, some only together.
  std::vector<float> values;
  for (const float size : {1e-7f, 1.5e-6f, 1.9e-6f, 2e-6f, 3e-5f, 0.7f}) {
    for (int k = 0; k < 9; ++k) {
      values.push_back(size);
      if (k % 3 == 0) values.push_back(-2.5f * size);
      if (k == 8) values.insert(values.end(), 5, -size);
    }
  }
  const auto count = static_cast<int64_t>(values.size());
  const Tensor gradient = torch::tensor(values);
  // All values at one knot.
  const response::Lookups args{{{torch::full({count}, 0.5), {}}}, torch::rand({response::kKnots})};
  for (const int64_t length : {count, count / 2, count / 3}) {
    const Tensor part = gradient.clone();
    part.slice(0, length).zero_();
    for (const Order order : kOrders) {
      const ForcedOrder forced(order);
      const auto found = response::emulated_cuda::lookup_backward(args, {part}, {{false}, true});
      const auto expected =
          part.to(torch::kFloat64).mul(1125899906842624.0).round().sum().div(1125899906842624.0);
      CHECK(found.table[1024].item<float>() == expected.to(torch::kFloat32).item<float>());
      CHECK(found.table.ne(0).sum().item<int64_t>() == 1);
    }
  }
}

TEST_CASE("emulated cuda: the camera response's table is that of torch's layers", "[emulated]") {
  response::CameraResponse layers;
  {
    // Away from the initial fit, so that each unit contributes.
    const torch::NoGradGuard no_grad;
    torch::manual_seed(3);
    for (Tensor& each : layers->parameters()) each.add_(0.3 * torch::randn(each.sizes()));
  }
  response::NetworkWeights weights;
  const std::vector<Tensor> parameters = layers->parameters();
  REQUIRE(parameters.size() == weights.size());
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = parameters[i].detach().contiguous();
  const Tensor expected =
      layers->exact(torch::linspace(0, response::kResponseRange, response::kKnots));
  const Tensor of_table = torch::randn({response::kKnots});
  expected.backward(of_table);
  for (const Order order : kOrders) {
    const ForcedOrder forced(order);
    const Tensor table = response::emulated_cuda::response_table(weights);
    CHECK(torch::allclose(table, expected, 1e-5, 1e-6));
    const Tensor found = response::emulated_cuda::response_table_gradient(weights, table, of_table);
    for (size_t i = 0; i < weights.size(); ++i) {
      INFO("parameter " << i);
      const Tensor gradient = parameters[i].grad();
      const Tensor part =
          found.narrow(0, response::kParameterOffsets[i], gradient.numel()).view_as(gradient);
      CHECK((part - gradient).abs().max().item<double>() <
            1e-4 * gradient.abs().max().item<double>());
    }
  }
}

TEST_CASE("emulated cuda: learned paths and the gradient of their twists", "[emulated]") {
  torch::manual_seed(4);
  for (const int64_t control : {2, 4, 7}) {
    for (const bool corrects : {true, false}) {
      if (control > 4 && !corrects) continue;
      const int64_t poses = 70;  // more than a warp has threads
      geometry::ExposurePath path;
      path.twists = 0.1 * torch::randn({control, 6}, torch::kFloat64);
      path.u = torch::linspace(0, 1, poses, torch::kFloat64);
      path.base = torch::eye(4, torch::kFloat64).repeat({corrects ? poses : control, 1, 1});
      path.base.select(2, 3).narrow(1, 0, 3).uniform_(-1, 1);
      path.corrects = corrects;
      const Tensor of_poses = torch::randn({poses, 4, 4}, torch::kFloat64);
      const Tensor expected = geometry::cpu::exposure_path(path);
      const Tensor expected_gradient = geometry::cpu::exposure_path_backward(path, of_poses);
      for (const Order order : kOrders) {
        const ForcedOrder forced(order);
        INFO(control << (corrects ? " corrections" : " control poses"));
        CHECK(torch::allclose(geometry::emulated_cuda::exposure_path(path), expected, 0, 1e-12));
        CHECK(torch::allclose(geometry::emulated_cuda::exposure_path_backward(path, of_poses),
                              expected_gradient, 1e-10, 1e-10));
      }
    }
  }
}

TEST_CASE("emulated cuda: events are counted where the CPU counts them", "[emulated]") {
  torch::manual_seed(5);
  const int64_t count = 5000;
  const int32_t width = 31, height = 17;
  const Tensor x = (width + 4) * torch::rand({count}) - 2,
               y = (height + 4) * torch::rand({count}) - 2;
  const Tensor polarity = torch::randint(0, 2, {count}).mul(2).sub(1).to(torch::kInt8);
  std::vector<int64_t> bounds{3};
  while (bounds.size() < 80)
    bounds.push_back(bounds.back() + static_cast<int64_t>(bounds.size()) % 60);
  REQUIRE(bounds.back() <= count);
  const auto spans = static_cast<int64_t>(bounds.size()) - 1;
  const auto counted = [&](const auto& run) {
    Tensor out = torch::zeros({spans, 2, height, width}, torch::kInt64);
    events::CountArguments args;
    args.x = x.const_data_ptr<float>();
    args.y = y.const_data_ptr<float>();
    args.polarity = polarity.const_data_ptr<int8_t>();
    args.bounds = &bounds;
    args.width = width;
    args.height = height;
    args.out = out.mutable_data_ptr<int64_t>();
    run(args);
    return out;
  };
  const Tensor expected = counted([](const auto& args) { events::cpu::count(args); });
  CHECK(expected.sum().item<int64_t>() > 0);
  CHECK(counted([](const auto& args) { events::emulated_cuda::count(args, 0); }).equal(expected));
}

TEST_CASE("emulated cuda: an Adam step of every kind of group", "[emulated]") {
  torch::manual_seed(6);
  struct Kind {
    int64_t rows, row, head;
    bool scheduled, tied;
  };
  const Kind kinds[] = {{300, 3, 3, true, false},
                        {70, 4, 4, false, false},
                        {65, 48, 3, false, false},
                        {65, 48, 3, false, true},
                        {1, 1, 1, false, false}};
  std::vector<Tensor> start, gradients;
  for (const Kind& kind : kinds) {
    for (int k = 0; k < 3; ++k) start.push_back(torch::rand({kind.rows, kind.row}));
    gradients.push_back(torch::randn({kind.rows, kind.row}));
  }
  const auto stepped = [&](const auto& run) {
    int64_t steps = 6;
    std::array<double, 3> rates{};
    std::vector<Tensor> state;
    for (const Tensor& each : start) state.push_back(each.clone());
    gaussians::AdamStep step;
    step.step = &steps;
    step.rates = rates.data();
    step.schedule = {-4, -6, 100};
    for (const Kind& kind : kinds) {
      const auto i = static_cast<size_t>(step.group_count);
      gaussians::AdamGroup& group = step.groups[step.group_count++];
      group.value = state[3 * i].mutable_data_ptr<float>();
      group.first = state[3 * i + 1].mutable_data_ptr<float>();
      group.second = state[3 * i + 2].mutable_data_ptr<float>();
      group.gradient = gradients[i].const_data_ptr<float>();
      group.count = gradients[i].numel();
      group.row = kind.row;
      group.head = kind.head;
      group.head_lr = 1e-2;
      group.tail_lr = 5e-4;
      group.scheduled = kind.scheduled;
      group.tied = kind.tied;
    }
    run(step);
    CHECK(steps == 7);
    return state;
  };
  const auto expected = stepped([](const auto& step) { gaussians::cpu::adam_step(step); });
  const auto found = stepped([](const auto& step) { gaussians::emulated_cuda::adam_step(step); });
  for (size_t i = 0; i < expected.size(); ++i) {
    INFO("tensor " << i);
    CHECK_FALSE(expected[i].equal(start[i]));
    CHECK(torch::allclose(found[i], expected[i], 1e-5, 1e-7));
  }
}

TEST_CASE("emulated cuda: the update of learned poses", "[emulated]") {
  torch::manual_seed(8);
  const int64_t rows = 5, row = 300;  // more than a block has threads
  const auto random = [](at::IntArrayRef shape) { return torch::randn(shape, torch::kFloat64); };
  std::vector<Tensor> start{random({rows, row}),
                            random({rows, row}),
                            random({rows, row}).square(),
                            random({rows, row}),
                            torch::tensor({3., 0., 7., 1., 0.}, torch::kFloat64),
                            torch::tensor({1, 0, 2, 0, 1}, torch::kInt64)};
  const auto updated = [&](const auto& run) {
    std::vector<Tensor> all;
    for (const Tensor& each : start) all.push_back(each.clone());
    const auto numbers = [&](size_t i) { return all[i].mutable_data_ptr<double>(); };
    run(train::RowStep{numbers(0), numbers(1), numbers(2), numbers(3), numbers(4),
                       all[5].mutable_data_ptr<int64_t>(), rows, row, 1e-2, 1e-8});
    return all;
  };
  const auto expected = updated([](const auto& step) { train::cpu::update_rows(step); });
  CHECK(expected[4].equal(torch::tensor({4., 0., 8., 1., 1.}, torch::kFloat64)));
  const int64_t third = 2;
  const Tensor of = random({rows, row});
  const auto waiting = [&](const auto& run) {
    std::vector<Tensor> all{start[3].clone(), start[5].clone()};
    run(train::RowGradient{of.const_data_ptr<double>(), all[0].mutable_data_ptr<double>(),
                           all[1].mutable_data_ptr<int64_t>(), &third, rows * row});
    return all;
  };
  const auto summed = waiting([](const auto& step) { train::emulated_cuda::accumulate(step); });
  test::check_equal(summed, waiting([](const auto& step) { train::cpu::accumulate(step); }));
  CHECK(summed[0].equal(start[3] + of));
  CHECK(summed[1].equal(torch::tensor({1, 0, 3, 0, 1}, torch::kInt64)));
  const int64_t ways = 7, size = rows * row;
  const Tensor read = random({ways, size}), write = random({ways, size}), twists = random({size});
  const auto held = [&](const auto& run) {
    Tensor left = twists.clone(), along = torch::empty({ways}, torch::kFloat64);
    run(train::GaugeStep{read.const_data_ptr<double>(), write.const_data_ptr<double>(),
                         left.mutable_data_ptr<double>(), along.mutable_data_ptr<double>(), ways,
                         size});
    return left;
  };
  const Tensor still = held([](const auto& step) { train::cpu::remove_gauge(step); });
  CHECK(torch::allclose(still, twists - read.matmul(twists).matmul(write), 1e-10, 1e-9));
  for (const Order order : kOrders) {
    const ForcedOrder forced(order);
    const auto found = updated([](const auto& step) { train::emulated_cuda::update_rows(step); });
    for (size_t i = 0; i < expected.size(); ++i) {
      INFO("tensor " << i);
      CHECK(torch::allclose(found[i], expected[i], 1e-12, 1e-14));
    }
    CHECK(torch::allclose(held([](const auto& step) { train::emulated_cuda::remove_gauge(step); }),
                          still, 1e-10, 1e-9));
  }
}

TEST_CASE("emulated cuda: the noise of MCMC is the CPU's", "[emulated]") {
  torch::manual_seed(7);
  const int64_t count = 500;
  const Tensor rotations = random_rotations(count), scales = torch::randn({count, 3}) - 3;
  const Tensor opacities = torch::randn({count}) - 5;
  const auto moved = [&](const auto& run) {
    Tensor means = torch::zeros({count, 3});
    run(gaussians::NoiseStep{means.mutable_data_ptr<float>(), rotations.const_data_ptr<float>(),
                             scales.const_data_ptr<float>(), opacities.const_data_ptr<float>(),
                             count, 10, 99});
    return means;
  };
  const Tensor expected = moved([](const auto& step) { gaussians::cpu::add_noise(step); });
  CHECK(expected.abs().max().item<double>() > 0);
  const Tensor found = moved([](const auto& step) { gaussians::emulated_cuda::add_noise(step); });
  CHECK(torch::allclose(found, expected, 1e-4, 1e-7));
}

TEST_CASE("emulated cuda: buffers of any length and alignment are copied", "[emulated]") {
  std::vector<uint8_t> from(200000), to(from.size(), 0);
  std::iota(from.begin(), from.end(), uint8_t{1});
  std::vector<train::BufferCopy> copies;
  std::vector<bool> expected(from.size(), false);
  size_t at = 0;
  for (int i = 0; i < 150; ++i) {
    const size_t bytes = i == 70 ? 70001 : static_cast<size_t>(i * 7 % 97);
    copies.push_back({from.data() + at, to.data() + at, static_cast<int64_t>(bytes)});
    std::fill_n(expected.begin() + static_cast<ptrdiff_t>(at), bytes, true);
    at += bytes + static_cast<size_t>(i % 19);
  }
  REQUIRE(at <= from.size());
  train::emulated_cuda::copy_all(copies);
  size_t wrong = 0;
  for (size_t i = 0; i < to.size(); ++i) wrong += to[i] != (expected[i] ? from[i] : 0);
  CHECK(wrong == 0);
}
