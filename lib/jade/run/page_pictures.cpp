// SPDX-License-Identifier: Apache-2.0
#include "jade/run/page_pictures.h"

#include <ATen/Parallel.h>
#include <cstdio>
#include <string_view>

#include "jade/core/digest.h"
#include "jade/eval/metrics.h"
#include "jade/imaging/image_io.h"

namespace jade::run {

using Json = nlohmann::ordered_json;

Json PagePictures::add(const std::string& camera, const std::string& name,
                       const torch::Tensor& image, const torch::Tensor& truth,
                       const torch::Tensor& mask) {
  constexpr size_t kMostBytes = size_t{256} << 20;  // that wait to be encoded
  const std::string key = camera + " " + name;
  Json entry{{"name", name}, {"src", key}};
  if (truth.defined()) {
    char note[24];
    std::snprintf(note, sizeof note, "%.2f dB", eval::psnr(image, truth.to(image.device()), mask));
    entry["note"] = note;
  }
  if (sources_.count(key) > 0) return entry;
  images_.emplace_back(key, image.detach().cpu());
  bytes_ += images_.back().second.nbytes();
  if (bytes_ > kMostBytes) encode();
  return entry;
}

void PagePictures::encode() {
  std::vector<std::string> sources(images_.size());
  at::parallel_for(0, static_cast<int64_t>(images_.size()), 1, [&](int64_t begin, int64_t end) {
    for (auto i = static_cast<size_t>(begin); i < static_cast<size_t>(end); ++i) {
      const std::vector<uint8_t> png = imaging::encode_png(images_[i].second);
      const std::string_view bytes(reinterpret_cast<const char*>(png.data()), png.size());
      sources[i] = "data:image/png;base64," + base64(bytes);
    }
  });
  for (size_t i = 0; i < sources.size(); ++i) {
    sources_[images_[i].first] = std::move(sources[i]);
  }
  images_.clear();
  bytes_ = 0;
}

void PagePictures::put_into(Json& views) {
  encode();
  for (Json& view : views) {
    for (Json& entry : view["pictures"]) entry["src"] = sources_[entry["src"].get<std::string>()];
  }
}

}  // namespace jade::run
