// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration_fields.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <sstream>

#include "jade/core/edit_distance.h"
#include "jade/core/error.h"

namespace jade::import {

using config::DocumentNode;
using geometry::LensModel;

std::string Section::where(const std::string& key) const {
  return concat(path.string(), ":", node.line, ": ", name.empty() ? "" : name + ".", key);
}

const DocumentNode& require(const Section& section, const std::string& key,
                            const std::string& meaning) {
  if (const DocumentNode* node = section.node.find(key)) return *node;
  throw DataError(concat(section.where(key), ": expected ", meaning,
                         ", found nothing; add this key, or calibrate again"));
}

double number(const Section& section, const std::string& key, const DocumentNode& node) {
  std::istringstream text(node.text);
  double value = 0;
  if (node.kind == DocumentNode::Kind::kText && text >> value && (text >> std::ws).eof() &&
      std::isfinite(value)) {
    return value;
  }
  throw DataError(concat(section.where(key), ": expected a number, found '", node.text,
                         "'; correct it, or calibrate again"));
}

std::vector<double> numbers(const Section& section, const std::string& key,
                            const DocumentNode& node) {
  if (node.kind == DocumentNode::Kind::kMap) {
    const DocumentNode* data = node.find("data");
    if (data) return numbers(section, key, *data);
  }
  if (node.kind != DocumentNode::Kind::kList) {
    throw DataError(concat(section.where(key), ": expected a list of numbers, found '", node.text,
                           node.kind == DocumentNode::Kind::kMap ? "a map without data" : "",
                           "'; write it as [a, b, …]"));
  }
  std::vector<double> out;
  for (const DocumentNode& item : node.items) {
    if (item.kind == DocumentNode::Kind::kList) {
      const auto row = numbers(section, key, item);
      out.insert(out.end(), row.begin(), row.end());
    } else {
      out.push_back(number(section, key, item));
    }
  }
  return out;
}

std::vector<double> numbers(const Section& section, const std::string& key,
                            const std::string& meaning, size_t count) {
  auto out = numbers(section, key, require(section, key, meaning));
  if (out.size() == count) return out;
  throw DataError(concat(section.where(key), ": expected ", meaning, " (", count,
                         " numbers), found ", out.size(),
                         " numbers; correct it, or calibrate again"));
}

std::string word(const Section& section, const std::string& key) {
  const DocumentNode* node = section.node.find(key);
  return node && node->kind == DocumentNode::Kind::kText ? node->text : "";
}

std::string plain(const std::string& name) {
  std::string out;
  for (const unsigned char c : name) {
    if (std::isalnum(c)) out += char(std::tolower(c));
  }
  return out;
}

void refuse_misspelt(const Section& section, const std::vector<std::string>& known,
                     const std::function<bool(const DocumentNode&)>& matters) {
  for (const auto& [key, value] : section.node.entries) {
    const std::string close = misspelt(plain(key), known);
    if (close.empty() || !matters(value)) continue;
    // distortion_model0 is of one camera of several.
    const std::string mark =
        plain(key).rfind(close, 0) == 0 ? plain(key).substr(close.size()) : "?";
    if (std::all_of(mark.begin(), mark.end(), [](unsigned char c) { return std::isdigit(c); }))
      continue;
    const auto is_close = [&](const auto& entry) { return plain(entry.first) == close; };
    const auto& all = section.node.entries;
    if (std::any_of(all.begin(), all.end(), is_close)) continue;
    throw DataError(concat(section.where(key), ": looks like a misspelt ", close,
                           ", and would not be read; correct or remove it"));
  }
}

geometry::Lens radial_tangential(const std::vector<double>& k) {
  geometry::Lens lens;
  lens.model = k.size() > 5 ? LensModel::kRational : LensModel::kRadialTangential;
  lens.k1 = k[0], lens.k2 = k[1], lens.p1 = k[2], lens.p2 = k[3];
  if (k.size() > 4) lens.k3 = k[4];
  if (k.size() > 7) lens.k4 = k[5], lens.k5 = k[6], lens.k6 = k[7];
  return lens;
}

geometry::Lens fisheye(const std::vector<double>& k) {
  return {LensModel::kFisheye, k[0], k[1], 0, 0, k[2], k[3], 0, 0};
}

geometry::Lens checked(const geometry::Lens& lens, const std::vector<double>& k) {
  if (lens.model == LensModel::kFisheye) return lens;
  for (const double value : k) {
    if (value != 0) return lens;
  }
  return {};
}

}  // namespace jade::import
