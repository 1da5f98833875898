// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/init.h"

#include "support/catch.h"

#include <cmath>

#include "jade/core/error.h"
#include "jade/gaussians/plane_sweep.h"
#include "random_gaussians.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::gaussians {
namespace {

using geometry::Intrinsics;
using geometry::Pose;

torch::Tensor brute_force(const torch::Tensor& points) {
  const torch::Tensor distances =
      (points.unsqueeze(0) - points.unsqueeze(1)).to(torch::kFloat64).square().sum(2);
  const torch::Tensor sorted = std::get<0>(distances.sort(1));
  return sorted.slice(1, 1, 4).mean(1).to(torch::kFloat32);
}

/// Two cameras that look along z, the second one step to the right.
InitSources two_views() {
  InitSources sources;
  for (const double x : {0.0, 1.0}) {
    InitView view;
    view.camera_from_world.translation = {-x, 0, 0};
    view.camera = Intrinsics::centred(20, 16, 12);
    view.image = torch::full({3, 12, 16}, 0.25);
    sources.views.push_back(view);
  }
  sources.views[1].image[0].fill_(0.75);
  sources.near = 2;
  sources.far = 10;
  return sources;
}

TEST_CASE("init: three-neighbour distances equal brute force, far outliers included",
          "[gaussians]") {
  at::Generator generator = make_generator(1, "points");
  torch::Tensor points = at::randn({700, 3}, generator, torch::kFloat32);
  points[5] = torch::tensor({1e4f, -1e4f, 3e3f});
  points[6] = points[7];
  CHECK(torch::allclose(mean_squared_neighbour_distance(points), brute_force(points), 1e-4, 1e-9));
  CHECK(mean_squared_neighbour_distance(points.slice(0, 0, 1)).item<float>() == 0);
  CHECK(mean_squared_neighbour_distance(points.slice(0, 0, 0)).size(0) == 0);
  CHECK(mean_squared_neighbour_distance(torch::tensor({{0.f, 0.f, 0.f}, {2.f, 0.f, 0.f}}))[0]
            .item<float>() == 4);
  CHECK(mean_squared_neighbour_distance(torch::zeros({300, 3})).max().item<float>() == 0);
}

TEST_CASE("init: Gaussians from points follow the inherited recipe", "[gaussians]") {
  PointCloud cloud;
  cloud.points =
      torch::tensor({{0.f, 0.f, 0.f}, {1.f, 0.f, 0.f}, {0.f, 1.f, 0.f}, {0.f, 0.f, 2.f}});
  cloud.colors = torch::tensor({{1.f, 0.5f, 0.f}}).repeat({4, 1});
  const splat::Gaussians g = gaussians_from_points(cloud);
  CHECK(g.log_scales[0][2].item<double>() == Approx(0.5 * std::log(2.0)));
  CHECK(g.logit_opacities.sigmoid()[0].item<double>() == Approx(0.1));
  CHECK(torch::equal(g.rotations[3], torch::tensor({1.f, 0.f, 0.f, 0.f})));
  CHECK(g.sh[0][0][0].item<double>() == Approx(0.5 / 0.28209479177387814));
  CHECK(g.sh[0][0][1].item<double>() == 0);
  CHECK(g.sh.slice(1, 1).abs().sum().item<double>() == 0);
}

TEST_CASE("init: random points lie in the frusta between near and far, with the views' colours",
          "[gaussians]") {
  const InitSources sources = two_views();
  at::Generator generator = make_generator(2, "start");
  const PointCloud cloud = random_frusta(sources, 500, generator);
  int64_t seen_by_both = 0;
  for (int64_t i = 0; i < 500; ++i) {
    const auto x = [&](int a) { return cloud.points[i][a].item<double>(); };
    CHECK(x(2) >= 2 - 1e-4);
    CHECK(x(2) <= 10 + 1e-4);
    int views = 0;
    for (const InitView& view : sources.views) {
      const auto uv = project(view.camera, transform(view.camera_from_world, {x(0), x(1), x(2)}));
      views += uv[0] > -1e-3 && uv[0] < 16.001 && uv[1] > -1e-3 && uv[1] < 12.001;
    }
    CHECK(views >= 1);
    const double red = cloud.colors[i][0].item<double>();
    if (views == 2 && std::abs(red - 0.5) < 1e-6) ++seen_by_both;
    CHECK(cloud.colors[i][1].item<double>() == Approx(0.25).margin(1e-6));
  }
  CHECK(seen_by_both > 50);
  at::Generator again = make_generator(2, "start");
  CHECK(torch::equal(random_frusta(sources, 500, again).points, cloud.points));
}

/// Five cameras 0.2 apart that look along z at a textured plane at depth 4.
InitSources views_of_a_plane() {
  at::Generator generator = make_generator(5, "texture");
  const torch::Tensor texture =
      at::avg_pool2d(at::rand({1, 3, 60, 140}, generator, torch::kFloat32), 5, 1, 2)[0];
  InitSources sources;
  for (int i = 0; i < 5; ++i) {
    InitView view;
    view.camera_from_world.translation = {-0.2 * i, 0, 0};
    view.camera = Intrinsics::centred(100, 80, 60);
    // One unit is 100 / 4 pixels.
    view.image = texture.slice(2, 5 * i, 5 * i + 80).contiguous();
    sources.views.push_back(view);
  }
  sources.near = 2;
  sources.far = 20;
  return sources;
}

TEST_CASE("init: a plane sweep finds the depth where the views agree", "[gaussians]") {
  InitSources sources = views_of_a_plane();
  const auto near_plane = [&](const PointCloud& cloud) {
    const torch::Tensor inverse = 1 / cloud.points.select(1, 2);
    return ((inverse - 0.25).abs() < 0.02).to(torch::kFloat32).mean().item<double>();
  };
  at::Generator generator = make_generator(2, "start");
  const PointCloud cloud = plane_sweep(sources, 1000, generator);
  CHECK(near_plane(cloud) > 0.5);
  CHECK(near_plane(random_frusta(sources, 1000, generator)) < 0.2);

  const int threads = torch::get_num_threads();
  torch::set_num_threads(1);
  at::Generator again = make_generator(2, "start");
  const PointCloud alone = plane_sweep(sources, 1000, again);
  torch::set_num_threads(threads);
  CHECK(alone.points.equal(cloud.points));
  CHECK(alone.colors.equal(cloud.colors));

  // Depths are random where fewer than three views see a point; colours are those of the views.
  sources = two_views();
  const PointCloud random = plane_sweep(sources, 500, generator);
  CHECK(random.points.select(1, 2).min().item<float>() < 2.3);
  CHECK(random.points.select(1, 2).max().item<float>() > 8);
  CHECK(torch::allclose(random.colors.select(1, 1), torch::full({500}, 0.25f)));
}

TEST_CASE("init: a plane sweep measures whether the views agree at any depth", "[gaussians]") {
  const auto disagreement = [](const InitSources& sources) {
    at::Generator generator = make_generator(2, "start");
    double found = -1;
    plane_sweep(sources, 1000, generator, &found);
    return found;
  };
  InitSources sources = views_of_a_plane();
  CHECK(disagreement(sources) < 0.15);
  InitSources exchanged = sources, flat = sources;
  std::reverse(exchanged.views.begin(), exchanged.views.end());
  for (size_t i = 0; i < sources.views.size(); ++i)
    exchanged.views[i].camera_from_world = sources.views[i].camera_from_world;
  CHECK(disagreement(exchanged) > 0.3);
  CHECK(pose_fault(sources).empty());
  CHECK_THAT(pose_fault(exchanged), test::naming("poses: expected frames that agree"));
  for (InitView& view : flat.views) view.image = torch::full_like(view.image, 0.5);
  CHECK(disagreement(flat) == 0);
}

TEST_CASE("init: random depths between guessed bounds are a fault", "[gaussians]") {
  InitSources sources = two_views();
  CHECK(depth_fault(sources).empty());
  sources.near = 0.01;
  sources.far = 100;  // the guess of loaders that know nothing
  CHECK_THAT(depth_fault(sources), test::naming("set init.kind to plane_sweep"));
}

TEST_CASE("init: masked pixels and gains do not change where the views agree", "[gaussians]") {
  const InitSources plain = views_of_a_plane();
  const auto swept = [](const InitSources& sources) {
    at::Generator generator = make_generator(2, "start");
    return plane_sweep(sources, 1000, generator);
  };
  const auto at_plane = [](const PointCloud& cloud) {
    const torch::Tensor off = (1 / cloud.points.select(1, 2) - 0.25).abs();
    return (off < 0.02).to(torch::kFloat32).mean().item<double>();
  };
  InitSources dirty = plain, bright = plain;
  for (size_t i = 0; i < plain.views.size(); ++i) {
    // Dirt on the sensor agrees best at the far end.
    InitView& view = dirty.views[i];
    view.image = view.image.clone();
    view.image.slice(2, 36, 46).fill_(4);
    bright.views[i].gain = 0.5 + 0.25 * double(i);
    bright.views[i].image = plain.views[i].image * bright.views[i].gain;
  }
  const PointCloud misled = swept(dirty);
  CHECK(misled.colors.max().item<float>() > 1);
  for (InitView& view : dirty.views) {
    view.mask = torch::ones({1, 60, 80}, torch::kBool);
    view.mask.slice(2, 36, 46).fill_(false);
  }
  const PointCloud masked = swept(dirty);
  CHECK(masked.colors.max().item<float>() < 1);
  CAPTURE(at_plane(swept(plain)), at_plane(misled));
  CHECK(at_plane(masked) > 0.9 * at_plane(swept(plain)));
  CHECK(at_plane(misled) < 0.8 * at_plane(swept(plain)));
  at::Generator generator = make_generator(2, "start");
  CHECK(random_frusta(dirty, 500, generator).colors.max().item<float>() < 1);

  const PointCloud first = swept(plain), second = swept(bright);
  const torch::Tensor same = (first.points - second.points).abs().amax(1) < 1e-4;
  CHECK(same.to(torch::kFloat32).mean().item<double>() > 0.99);
  CHECK(torch::allclose(first.colors.masked_select(same.unsqueeze(1)),
                        second.colors.masked_select(same.unsqueeze(1)), 0, 1e-4));
}

TEST_CASE("init: a point takes no colour from a view that it lies behind", "[gaussians]") {
  InitSources sources = two_views();
  sources.views[0].camera_from_world = {};
  sources.views[1].camera_from_world = {geometry::rotation_from_vector({0, std::acos(-1.0), 0}),
                                        {0, 0, 0}};
  at::Generator generator = make_generator(2, "start");
  const PointCloud cloud = random_frusta(sources, 100, generator);
  const torch::Tensor ahead = cloud.points.select(1, 2) > 0;
  CHECK(ahead.any().item<bool>());
  CHECK_FALSE(ahead.all().item<bool>());
  CHECK(cloud.colors.select(1, 0).equal(
      torch::where(ahead, torch::full({100}, 0.25f), torch::full({100}, 0.75f))));
}

TEST_CASE("init: the extent is 1.1 times the farthest camera's distance to the centre",
          "[gaussians]") {
  std::vector<Pose> poses(3);
  poses[0].translation = {-3, 0, 0};
  poses[1].translation = {3, 0, 0};
  CHECK(scene_extent(poses) == Approx(3.3));
  CHECK(scene_extent({poses[0]}) == 1);
}

TEST_CASE("init: kinds pick their source and say what is missing", "[gaussians]") {
  const test::TempDir folder;
  at::Generator generator = make_generator(2, "start");
  InitSources sources = two_views();
  InitOptions options;
  options.points = 50;
  CHECK(initial_gaussians(options, sources, generator).size() == 50);
  at::Generator points_generator = make_generator(3, "points");
  sources.points.points = at::randn({200, 3}, points_generator, torch::kFloat32);
  sources.points.points[3] = torch::tensor({1.f, 0.f, 0.f});  // on the second camera
  sources.points.points[4][0] = std::nan("");
  sources.points.colors = torch::full({200, 3}, 0.5);
  CHECK(initial_gaussians(options, sources, generator).size() == 198);
  const splat::Gaussians part = initial_gaussians(options, sources, generator, 60);
  CHECK(part.size() == 60);
  CHECK(std::get<0>(torch::unique_dim(part.means, 0)).size(0) == 60);  // none twice
  for (const auto kind : {InitKind::kAuto, InitKind::kSfmOrRandom}) {
    InitSources bare = sources;
    bare.points = {};
    options.kind = kind;
    at::Generator first = make_generator(2, "start"), second = make_generator(2, "start");
    const PointCloud cloud =
        kind == InitKind::kAuto ? plane_sweep(bare, 50, first) : random_frusta(bare, 50, first);
    CHECK(initial_gaussians(options, bare, second).means.equal(cloud.points));
    CHECK(initial_gaussians(options, sources, second).size() == 198);
  }
  options.kind = InitKind::kRandomFrusta;
  CHECK(initial_gaussians(options, sources, generator).size() == 50);
  CHECK(initial_gaussians(options, sources, generator, 20).size() == 20);
  sources.far = 0;
  CHECK_THROWS_AS(initial_gaussians(options, sources, generator), ConfigError);
  options.kind = InitKind::kPly;
  CHECK_THROWS_AS(initial_gaussians(options, sources, generator), ConfigError);
  write_ply(folder / "g.ply", {test::random_gaussians(7, 4), false});
  options.ply = folder / "g.ply";
  CHECK(initial_gaussians(options, sources, generator).size() == 7);
  // a complete scene is not reduced
  CHECK(initial_gaussians(options, sources, generator, 5).size() == 7);
  // A file about another origin than the views.
  const GaussianFile moved{test::random_gaussians(7, 4), false, {5000, 0, 0}};
  write_ply(options.ply, moved);
  sources.origin = {4998, 0, 1};
  const torch::Tensor shift = torch::tensor({2.F, 0.F, -1.F});
  CHECK((initial_gaussians(options, sources, generator).means - moved.gaussians.means - shift)
            .abs()
            .max()
            .item<float>() < 1e-6);
  options.kind = InitKind::kSfm;
  sources.points = {};
  CHECK_THROWS_AS(initial_gaussians(options, sources, generator), ConfigError);
}

}  // namespace
}  // namespace jade::gaussians
