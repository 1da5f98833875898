// SPDX-License-Identifier: Apache-2.0
#include "support/dense_reference.h"

#include <cmath>
#include <torch/types.h>

namespace jade::test {

using torch::Tensor;
using torch::indexing::Slice;

namespace {

Tensor rotation_matrices(const Tensor& quaternions) {
  const Tensor q = quaternions / quaternions.norm(2, {1}, true);
  const auto c = q.unbind(1);
  const Tensor &w = c[0], &x = c[1], &y = c[2], &z = c[3];
  const Tensor rows[3] = {
      torch::stack({w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)}, 1),
      torch::stack({2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)}, 1),
      torch::stack({2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z}, 1)};
  return torch::stack({rows[0], rows[1], rows[2]}, 1);
}

Tensor harmonics(int degree, const Tensor& d) {
  const auto c = d.unbind(1);
  const Tensor &x = c[0], &y = c[1], &z = c[2];
  const double pi = M_PI;
  std::vector<Tensor> b = {torch::full_like(x, 0.5 * std::sqrt(1 / pi))};
  if (degree >= 1) {
    const double k = std::sqrt(3 / (4 * pi));
    b.insert(b.end(), {-k * y, k * z, -k * x});
  }
  if (degree >= 2) {
    const double k = 0.5 * std::sqrt(15 / pi);
    b.insert(b.end(),
             {k * x * y, -k * y * z, 0.25 * std::sqrt(5 / pi) * (2 * z * z - x * x - y * y),
              -k * x * z, 0.5 * k * (x * x - y * y)});
  }
  if (degree >= 3) {
    const double a = 0.25 * std::sqrt(35 / (2 * pi)), e = 0.25 * std::sqrt(21 / (2 * pi));
    b.insert(b.end(),
             {-a * y * (3 * x * x - y * y), 0.5 * std::sqrt(105 / pi) * x * y * z,
              -e * y * (4 * z * z - x * x - y * y),
              0.25 * std::sqrt(7 / pi) * z * (2 * z * z - 3 * x * x - 3 * y * y),
              -e * x * (4 * z * z - x * x - y * y),
              0.25 * std::sqrt(105 / pi) * z * (x * x - y * y), -a * x * (x * x - 3 * y * y)});
  }
  return torch::stack(b, 1);
}

struct View {
  Tensor color, alpha, depth;
};

View render_view(const splat::Gaussians& g, const Tensor& camera, const Tensor& intrinsics,
                 int64_t width, int64_t height, const splat::RenderOptions& options,
                 const Tensor& background) {
  const Tensor w = camera.index({Slice(0, 3), Slice(0, 3)}), t = camera.index({Slice(0, 3), 3});
  const double fx = intrinsics[0].item<double>(), fy = intrinsics[1].item<double>();
  const double cx = intrinsics[2].item<double>(), cy = intrinsics[3].item<double>();
  const Tensor points = torch::matmul(g.means, w.t()) + t;
  const auto xyz = points.unbind(1);
  const Tensor &px = xyz[0], &py = xyz[1], &pz = xyz[2];
  const double tx = 0.5 * width / fx, ty = 0.5 * height / fy;
  const Tensor rx = (px / pz).clamp(-(cx / fx + 0.3 * tx), (width - cx) / fx + 0.3 * tx);
  const Tensor ry = (py / pz).clamp(-(cy / fy + 0.3 * ty), (height - cy) / fy + 0.3 * ty);
  const Tensor zero = torch::zeros_like(pz);
  const Tensor j = torch::stack({torch::stack({fx / pz, zero, -fx * rx / pz}, 1),
                                 torch::stack({zero, fy / pz, -fy * ry / pz}, 1)},
                                1);
  const Tensor r = rotation_matrices(g.rotations);
  const Tensor s2 = torch::diag_embed((2 * g.log_scales).exp());
  const Tensor cov3 = torch::matmul(torch::matmul(r, s2), r.transpose(1, 2));
  const Tensor jw = torch::matmul(j, w);
  const Tensor bare = torch::matmul(torch::matmul(jw, cov3), jw.transpose(1, 2));
  const Tensor cov = bare + 0.3 * torch::eye(2, bare.options());
  const Tensor conic = torch::linalg_inv(cov);

  Tensor opacity = torch::sigmoid(g.logit_opacities);
  if (options.antialiased) {
    opacity = opacity * (torch::linalg_det(bare) / torch::linalg_det(cov)).clamp_min(0).sqrt();
  }
  const Tensor center = -torch::matmul(w.t(), t);
  const Tensor offset = g.means - center;
  const int degree = options.sh_degree;
  const Tensor basis = harmonics(degree, offset / offset.norm(2, {1}, true));
  const Tensor sh = g.sh.index({Slice(), Slice(0, (degree + 1) * (degree + 1))});
  const Tensor color = ((basis.unsqueeze(2) * sh).sum(1) + 0.5).clamp_min(0);

  const Tensor keep = (pz.detach() >= options.near_plane).nonzero().squeeze(1);
  const Tensor depth_kept = pz.index_select(0, keep);
  const Tensor order =
      keep.index_select(0, std::get<1>(torch::sort(depth_kept.detach(), true, 0, false)));
  const auto sorted = [&](const Tensor& x) { return x.index_select(0, order); };

  const auto f64 = torch::TensorOptions().dtype(torch::kFloat64);
  const Tensor u = (torch::arange(width, f64) + 0.5).repeat({height});
  const Tensor v = (torch::arange(height, f64) + 0.5).repeat_interleave(width);
  const Tensor dx = u - sorted(fx * px / pz + cx).unsqueeze(1);
  const Tensor dy = v - sorted(fy * py / pz + cy).unsqueeze(1);
  const Tensor m = sorted(conic).unsqueeze(3);
  const Tensor q = m.select(1, 0).select(1, 0) * dx * dx +
                   2 * m.select(1, 0).select(1, 1) * dx * dy +
                   m.select(1, 1).select(1, 1) * dy * dy;
  const Tensor raw = sorted(opacity).unsqueeze(1) * (-0.5 * q).exp();
  Tensor faded = raw * (raw.detach() >= 1.0 / 255).to(torch::kFloat64);
  if (options.smooth_cutoff) {
    const Tensor s = (255 * raw - 1).clamp(0, 1);
    faded = raw * s * s * (3 - 2 * s);
  }
  Tensor alpha = faded.clamp_max(0.99);
  if (!options.smooth_cutoff) {
    const Tensor after = torch::cumprod(1 - alpha.detach(), 0);
    alpha = alpha * (after > 1e-4).to(torch::kFloat64);
  }
  const Tensor after = torch::cumprod(1 - alpha, 0);
  const Tensor ones = torch::ones({1, width * height}, f64);
  const Tensor before = torch::cat({ones, after.slice(0, 0, -1)}, 0).slice(0, 0, order.size(0));
  const Tensor weight = alpha * before;
  const Tensor end = order.size(0) > 0 ? after[-1] : ones[0];
  View view;
  view.color = (torch::matmul(sorted(color).t(), weight) + background.unsqueeze(1) * end)
                   .view({3, height, width});
  view.alpha = (1 - end).view({1, height, width});
  view.depth = (torch::matmul(sorted(pz).unsqueeze(0), weight)).view({1, height, width}) /
               view.alpha.clamp_min(1e-10);
  return view;
}

}  // namespace

splat::RenderOutput dense_render(const splat::Gaussians& gaussians,
                                 const splat::CameraBatch& cameras,
                                 const splat::RenderOptions& options) {
  const auto f64 = [](const Tensor& t) { return t.to(torch::kCPU, torch::kFloat64); };
  const splat::Gaussians g = {f64(gaussians.means), f64(gaussians.rotations),
                              f64(gaussians.log_scales), f64(gaussians.logit_opacities),
                              f64(gaussians.sh)};
  const Tensor background =
      options.background.defined() ? f64(options.background) : torch::zeros({3}, torch::kFloat64);
  const Tensor poses = f64(cameras.camera_from_world), intrinsics = f64(cameras.intrinsics);
  std::vector<Tensor> color, alpha, depth;
  for (int64_t view = 0; view < poses.size(0); ++view) {
    const View v = render_view(g, poses[view], intrinsics[view], cameras.width, cameras.height,
                               options, background);
    color.push_back(v.color);
    alpha.push_back(v.alpha);
    depth.push_back(v.depth);
  }
  splat::RenderOutput output;
  output.color = torch::stack(color);
  output.alpha = torch::stack(alpha);
  if (options.depth) output.depth = torch::stack(depth);
  return output;
}

}  // namespace jade::test
