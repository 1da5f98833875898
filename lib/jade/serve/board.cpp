// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/board.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "jade/serve/gate.h"

namespace jade::serve {

Board::Board() : id_(make_token()) {}

void Board::set(const Progress& progress) {
  const std::lock_guard<std::mutex> lock(mutex_);
  progress_ = progress;
}

void Board::set(const Scored& scored) {
  const std::lock_guard<std::mutex> lock(mutex_);
  scored_ = scored;
}

void Board::add(const std::string& line) {
  const std::lock_guard<std::mutex> lock(mutex_);
  lines_.push_back(line);
  if (lines_.size() < kMostLines) return;
  const size_t odd = lines_.size() % 2;
  for (size_t i = 0; i < lines_.size() / 2; ++i) lines_[i] = std::move(lines_[2 * i + 1]);
  if (odd == 1) lines_[lines_.size() / 2] = std::move(lines_.back());
  lines_.resize(lines_.size() / 2 + odd);
  ++generation_;
}

std::string Board::json(int64_t generation, int64_t from, int64_t viewers) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto count = static_cast<int64_t>(lines_.size());
  if (generation != generation_ || from < 0) from = 0;
  nlohmann::ordered_json head{{"id", id_},
                              {"step", progress_.step},
                              {"steps", progress_.steps},
                              {"gaussians", progress_.gaussians},
                              {"phase", progress_.phase},
                              {"scored", {{"step", scored_.step}, {"psnr", scored_.psnr}}},
                              {"viewers", viewers},
                              {"generation", generation_},
                              {"count", count}};
  std::string text = head.dump();
  text.pop_back();
  text += ",\"lines\":[";
  for (int64_t i = from; i < count; ++i) {
    text += (i == from ? "" : ",") + lines_[static_cast<size_t>(i)];
  }
  return text + "]}";
}

}  // namespace jade::serve
