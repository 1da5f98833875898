// SPDX-License-Identifier: Apache-2.0
#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <vector>

#include "jade/losses/route_kernels.h"

namespace jade::losses::cpu {
namespace {

constexpr int64_t kPartOfPlane = 16384;

template <class T>
RouteParts<double> sums_of(const RouteImages<T>& in, int64_t begin, int64_t end) {
  RouteParts<double> sums{0, 0};
  for (int64_t pixel = begin; pixel < end; ++pixel) {
    const RouteParts<T> residuals = route_residuals(in, pixel);
    sums.render += double(residuals.render);
    sums.reblur += double(residuals.reblur);
  }
  return sums;
}

}  // namespace

void route_loss(const RouteTensors& images, at::Tensor& values) {
  AT_DISPATCH_FLOATING_TYPES(images.alpha.scalar_type(), "route_loss", [&] {
    const RouteImages<scalar_t> in = pointers_of<scalar_t>(images);
    const int64_t parts = (in.plane + kPartOfPlane - 1) / kPartOfPlane;
    std::vector<RouteParts<double>> sums(static_cast<size_t>(parts));
    at::parallel_for(0, parts, 1, [&](int64_t begin, int64_t end) {
      for (int64_t part = begin; part < end; ++part) {
        sums[static_cast<size_t>(part)] =
            sums_of(in, part * kPartOfPlane, std::min(in.plane, (part + 1) * kPartOfPlane));
      }
    });
    RouteParts<double> all{0, 0};
    for (const RouteParts<double>& part : sums) {
      all.render += part.render;
      all.reblur += part.reblur;
    }
    const auto count = static_cast<double>(3 * in.plane);
    const double render = all.render / count, reblur = all.reblur / count * images.reblur_weight;
    auto* const out = values.mutable_data_ptr<scalar_t>();
    out[kRouteTotal] = static_cast<scalar_t>(render + reblur);
    out[kRouteRender] = static_cast<scalar_t>(render);
    out[kRouteReblur] = static_cast<scalar_t>(reblur);
  });
}

void route_gradient(const RouteTensors& images, const at::Tensor& of_total, at::Tensor& of_alpha) {
  AT_DISPATCH_FLOATING_TYPES(images.alpha.scalar_type(), "route_gradient", [&] {
    const RouteImages<scalar_t> in = pointers_of<scalar_t>(images);
    const double of_mean = static_cast<double>(*of_total.const_data_ptr<scalar_t>()) /
                           static_cast<double>(3 * in.plane);
    const RouteParts<scalar_t> of{static_cast<scalar_t>(of_mean),
                                  static_cast<scalar_t>(of_mean * images.reblur_weight)};
    auto* const out = of_alpha.mutable_data_ptr<scalar_t>();
    at::parallel_for(0, in.plane, kPartOfPlane, [&](int64_t begin, int64_t end) {
      for (int64_t pixel = begin; pixel < end; ++pixel) {
        out[pixel] = losses::route_gradient(in, of, pixel);
      }
    });
  });
}

}  // namespace jade::losses::cpu
