// SPDX-License-Identifier: Apache-2.0
// Implements glTF 2.0 and KHR_gaussian_splatting (github.com/KhronosGroup/glTF).
#include "jade/gaussians/gltf_file.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/gaussians/axes.h"
#include "jade/gaussians/file_tensor.h"
#include "jade/gaussians/file_values.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/summary.h"
#include "jade/io/uri.h"

namespace jade::gaussians {
namespace {

using nlohmann::json;

const char* const kExtension = "KHR_gaussian_splatting";
const char* const kQuantization = "KHR_mesh_quantization";  ///< only permits more number types
const char* const kCopies = "EXT_mesh_gpu_instancing";
/// The only colour space that is read. Between two spaces colours convert, but not their SH.
const char* const kColorSpace = "srgb_rec709_display";
constexpr uint64_t kMark = 0x46546c67;         ///< "glTF"
constexpr uint64_t kJsonChunk = 0x4e4f534a;    ///< "JSON"
constexpr uint64_t kBinaryChunk = 0x004e4942;  ///< "BIN"
constexpr size_t kGlbHeader = 12, kChunkHeader = 8;
constexpr int kFloat = 5126;
constexpr int kVertexData = 34962;
constexpr int kMostDegree = 3;
constexpr int kMostNesting = 64;

std::string attribute(const std::string& name) { return concat(kExtension, ":", name); }
std::string sh_attribute(int degree, int index) {
  return attribute(concat("SH_DEGREE_", degree, "_COEF_", index));
}

// --- writing
// ---------------------------------------------------------------------------------------

/// The binary part, and its description.
struct Parts {
  std::string binary;
  json views = json::array(), accessors = json::array(), attributes = json::object();

  void add(const std::string& name, const torch::Tensor& values) {
    const torch::Tensor rows = file_tensor(values);
    const int64_t columns = rows.dim() == 1 ? 1 : rows.size(1);
    json accessor = {{"bufferView", views.size()},
                     {"componentType", kFloat},
                     {"count", rows.size(0)},
                     {"type", columns == 1 ? "SCALAR" : concat("VEC", columns)}};
    if (name == "POSITION") {
      for (const auto& [key, value] : {std::pair{"min", std::get<0>(rows.min(0))},
                                       std::pair{"max", std::get<0>(rows.max(0))}}) {
        const float* const v = value.data_ptr<float>();
        accessor[key] = {v[0], v[1], v[2]};
      }
    }
    views.push_back({{"buffer", 0},
                     {"byteOffset", binary.size()},
                     {"byteLength", rows.nbytes()},
                     {"target", kVertexData}});
    attributes[name] = accessors.size();
    accessors.push_back(accessor);
    binary += content_of(rows);
  }
};

void put_chunk(std::string& out, uint64_t kind, std::string content, char filler) {
  content.resize((content.size() + 3) / 4 * 4, filler);
  put_unsigned(out, content.size(), 4);
  put_unsigned(out, kind, 4);
  out += content;
}

// --- reading
// ---------------------------------------------------------------------------------------

struct ComponentType {
  size_t size;
  torch::ScalarType type;
  double full;  ///< the value that represents 1 in normalised numbers
};

/// A document and its buffers.
class Document {
 public:
  explicit Document(const std::filesystem::path& path) : path_(path), content_(read_file(path)) {
    std::string_view text = content_;
    is_binary_ = text.size() >= kGlbHeader && unsigned_at(text, 0, 4) == kMark;
    if (is_binary_) {
      text = chunk(kJsonChunk);
      if (text.empty()) throw damaged("no JSON in it");
    }
    try {
      json_ = json::parse(text);
    } catch (const json::exception&) {
      throw damaged("no JSON in it");
    }
  }

  DataError damaged(const std::string& found) const {
    return DataError(concat(path_.string(), ": expected glTF 2.0 with ", kExtension, ", found ",
                            found, "; write the scene again"));
  }
  const json& root() const { return json_; }
  std::string name() const { return path_.string(); }

  /// [N,columns] float32.
  torch::Tensor read(const json& attributes, const std::string& name, int64_t columns) {
    const auto found = attributes.find(name);
    if (found == attributes.end()) throw damaged("no attribute " + name);
    const json& accessor = json_.at("accessors").at(found->get<size_t>());
    const std::string type = columns == 1 ? "SCALAR" : concat("VEC", columns);
    if (accessor.at("type") != type || accessor.contains("sparse")) {
      throw damaged(concat(name, " that is not a plain ", type));
    }
    const ComponentType item = item_of(accessor, name);
    const json& view = json_.at("bufferViews").at(accessor.at("bufferView").get<size_t>());
    const std::string_view buffer = buffer_of(view.at("buffer").get<size_t>());
    const auto count = accessor.at("count").get<uint64_t>();
    const auto row = item.size * static_cast<size_t>(columns);
    const auto stride = view.value("byteStride", uint64_t(row));
    const auto start =
        view.value("byteOffset", uint64_t(0)) + accessor.value("byteOffset", uint64_t(0));
    if (count > 0 &&
        (stride < row || stride > 252 || count > buffer.size() || start > buffer.size() ||
         (count - 1) * stride + row > buffer.size() - start)) {
      throw damaged(concat(name, " beyond the end of its buffer of ", buffer.size(), " bytes"));
    }
    std::string rows(count * row, '\0');
    for (uint64_t i = 0; i < count; ++i) {
      std::memcpy(rows.data() + i * row, buffer.data() + start + i * stride, row);
    }
    const torch::Tensor values =
        torch::from_blob(rows.data(), {static_cast<int64_t>(count), columns}, item.type)
            .to(torch::kFloat32);
    return item.full == 0 ? values.clone() : (values / item.full).clamp_min(-1);
  }

 private:
  /// The first chunk of that kind of a .glb; empty if there is none.
  std::string_view chunk(uint64_t kind) const {
    const std::string_view all = content_;
    for (uint64_t at = kGlbHeader; at + kChunkHeader <= all.size();) {
      const uint64_t size = unsigned_at(all, at, 4);
      if (size > all.size() - at - kChunkHeader) {
        throw damaged(concat("a part of ", size, " bytes beyond its end"));
      }
      if (unsigned_at(all, at + 4, 4) == kind) return all.substr(at + kChunkHeader, size);
      at += kChunkHeader + size;
    }
    return {};
  }

  ComponentType item_of(const json& accessor, const std::string& name) const {
    const bool normalized = accessor.value("normalized", false);
    switch (accessor.at("componentType").get<int>()) {
      case 5120:
        return {1, torch::kInt8, normalized ? 127.0 : 0};
      case 5121:
        return {1, torch::kUInt8, normalized ? 255.0 : 0};
      case 5122:
        return {2, torch::kInt16, normalized ? 32767.0 : 0};
      case 5123:
        return {2, torch::kUInt16, normalized ? 65535.0 : 0};
      case kFloat:
        return {4, torch::kFloat32, 0};
      default:
        throw damaged(concat(name, " of another type of numbers"));
    }
  }

  std::string_view buffer_of(size_t index) {
    const json& buffer = json_.at("buffers").at(index);
    const std::string uri = buffer.value("uri", std::string());
    if (uri.empty()) {
      // Only the first buffer of a .glb is its binary part.
      if (index > 0 || !is_binary_) throw damaged(concat("buffer ", index, " without data"));
      return chunk(kBinaryChunk);
    }
    if (uri.rfind("data:", 0) == 0) {
      throw damaged("a buffer written as text, which is not read; write a .glb");
    }
    auto [at, added] = files_.try_emplace(uri);
    if (added) at->second = read_file(file_of(uri));
    return at->second;
  }

  /// The file of a buffer. Some programs write its name without the escapes of a URI.
  std::filesystem::path file_of(const std::string& uri) const {
    for (const std::string& name : {io::unescaped(uri), uri}) {
      const std::filesystem::path file = path_.parent_path() / name;
      if (std::filesystem::is_regular_file(file)) return file;
    }
    throw DataError(concat(path_.string(), ": expected the file ", io::unescaped(uri),
                           " beside it, found none; copy that file too, or write a .glb"));
  }

  std::filesystem::path path_;
  std::string content_;
  bool is_binary_ = false;  ///< a .glb
  json json_;
  std::map<std::string, std::string> files_;
};

/// The highest SH degree of which there is any coefficient. All of a lower degree are required.
int degree_of(const json& attributes) {
  for (int degree = kMostDegree; degree > 0; --degree) {
    for (int i = 0; i <= 2 * degree; ++i) {
      if (attributes.contains(sh_attribute(degree, i))) return degree;
    }
  }
  return 0;
}

/// The values that the extension permits for an attribute.
struct Permitted {
  const char* name;
  double least, most;
  const char* words;   ///< the range, for messages
  const char* others;  ///< what many values below it are
  const char* effect;  ///< on few values outside
};
constexpr double kUnlimited = std::numeric_limits<double>::infinity();
constexpr Permitted kScale{"SCALE", 0, kUnlimited, "of 0 or above", "logarithms", "not rendered"};
constexpr Permitted kOpacity{"OPACITY", 0, 1, "from 0 to 1", "logits", "clamped"};

/// Notes values outside of the permitted range.
/// @throws DataError if they are more than 1 % of the finite values, as if the writer had stored
///   the parameters of training.
void check_range(const Document& document, const torch::Tensor& values, const Permitted& permitted,
                 std::vector<std::string>& notes) {
  constexpr double kRounding = 1e-3, kFew = 0.01;
  const torch::Tensor finite = values.masked_select(values.isfinite());
  const int64_t outside = (finite < permitted.least - kRounding)
                              .logical_or(finite > permitted.most + kRounding)
                              .sum()
                              .item<int64_t>();
  if (outside == 0) return;
  const std::string found =
      concat(document.name(), ": expected ", attribute(permitted.name), " ", permitted.words,
             ", found ", outside, " of ", finite.numel(), " values outside, from ",
             finite.min().item<double>(), " to ", finite.max().item<double>());
  if (double(outside) > kFew * double(finite.numel())) {
    const bool below = finite.min().item<double>() < permitted.least;
    throw DataError(concat(found, ", as ", below ? permitted.others : "numbers of another scale",
                           " have; write the file again with a newer program, or use its .ply"));
  }
  notes.push_back(concat(found, "; they are ", permitted.effect));
}

/// Gaussians of one primitive, in its node's axes.
splat::Gaussians gaussians_of(Document& document, const json& primitive,
                              std::vector<std::string>& notes) {
  const json& extension = primitive.at("extensions").at(kExtension);
  if (const auto inner = extension.find("extensions");
      inner != extension.end() && !inner->empty()) {
    throw document.damaged(concat("the extension ", inner->begin().key(), ", which is not read"));
  }
  for (const auto& [key, read] :
       {std::pair{"kernel", "ellipse"}, std::pair{"projection", "perspective"},
        std::pair{"colorSpace", kColorSpace}}) {
    if (const auto found = extension.value(key, std::string(read)); found != read) {
      throw document.damaged(concat("the ", key, " ", found, "; only ", read, " is read"));
    }
  }
  const json& attributes = primitive.at("attributes");
  if (attributes.contains(sh_attribute(kMostDegree + 1, 0))) {
    throw document.damaged(
        concat("SH degree ", kMostDegree + 1, "; only 0 to ", kMostDegree, " are read"));
  }
  splat::Gaussians out;
  out.means = document.read(attributes, "POSITION", 3);
  out.rotations = document.read(attributes, attribute("ROTATION"), 4).roll(1, 1);
  const torch::Tensor scales = document.read(attributes, attribute(kScale.name), 3);
  check_range(document, scales, kScale, notes);
  out.log_scales = scales.log();
  const torch::Tensor opacities = document.read(attributes, attribute(kOpacity.name), 1).squeeze(1);
  check_range(document, opacities, kOpacity, notes);
  out.logit_opacities = torch::logit(opacities.clamp(0, 1));
  std::vector<torch::Tensor> sh;
  for (int degree = 0; degree <= degree_of(attributes); ++degree) {
    for (int i = 0; i <= 2 * degree; ++i) {
      sh.push_back(document.read(attributes, sh_attribute(degree, i), 3));
    }
  }
  out.sh = torch::stack(sh, 1);
  for (int i = 0; i < kParameterCount; ++i) {
    if (parameter(out, i).size(0) != out.size() || out.sh.size(0) != out.size()) {
      throw document.damaged("attributes of different lengths");
    }
  }
  return out;
}

/// Applies a node's matrix.
/// @throws DataError unless it only rotates, scales uniformly and translates.
splat::Gaussians placed(const Document& document, const splat::Gaussians& gaussians,
                        const torch::Tensor& matrix) {
  if (matrix.equal(torch::eye(4, torch::kFloat64))) return gaussians;
  const torch::Tensor linear = matrix.slice(0, 0, 3).slice(1, 0, 3);
  const double volume = torch::linalg_det(linear).item<double>();
  const double scale = std::cbrt(volume);
  const torch::Tensor rotation = (linear / scale).contiguous();
  const torch::Tensor error = rotation.mm(rotation.t()) - torch::eye(3, torch::kFloat64);
  if (!(volume > 0) || !(error.abs().max().item<double>() < 1e-4)) {
    throw document.damaged(
        "a node that mirrors, stretches or shears its Gaussians, which is not read");
  }
  return moved(gaussians, rotation, scale, matrix.slice(0, 0, 3).select(1, 3));
}

/// A node's matrix [4,4], float64.
torch::Tensor matrix_of(const Document& document, const json& node) {
  const auto list = [&](const char* name, std::vector<double> usual) {
    const size_t expected = usual.size();
    std::vector<double> found = node.value(name, std::move(usual));
    if (found.size() == expected) return found;
    throw document.damaged(
        concat("a node whose ", name, " has ", found.size(), " numbers, not ", expected));
  };
  if (node.contains("matrix")) {
    const auto columns = list("matrix", std::vector<double>(16));
    return torch::tensor(columns, torch::kFloat64).reshape({4, 4}).t().contiguous();
  }
  const auto shift = list("translation", {0, 0, 0}), scale = list("scale", {1, 1, 1});
  const auto q = list("rotation", {0, 0, 0, 1});
  const double norm2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  if (!(norm2 > 0) || !std::isfinite(norm2)) {
    throw document.damaged("a node whose rotation is the zero quaternion or without bounds");
  }
  const geometry::Matrix3 r = geometry::rotation_from_quaternion({q[3], q[0], q[1], q[2]});
  torch::Tensor out = torch::eye(4, torch::kFloat64);
  for (size_t i = 0; i < 3; ++i) {
    const auto row = static_cast<int64_t>(i);
    for (size_t j = 0; j < 3; ++j) out[row][static_cast<int64_t>(j)] = r[3 * i + j] * scale[j];
    out[row][3] = shift[i];
  }
  return out;
}

/// The Gaussians of a scene's nodes.
class Collector {
 public:
  Collector(Document& document, std::vector<std::string>& notes)
      : document_(document), notes_(notes) {}

  /// Adds the Gaussians of a node and of its descendants.
  void collect(size_t index, const torch::Tensor& parent, int depth) {
    if (depth > kMostNesting) throw document_.damaged("nodes nested without end");
    if (!visited_.insert(index).second) {
      throw document_.damaged(concat("node ", index, " in two places of its tree of nodes"));
    }
    const json& root = document_.root();
    const json& node = root.at("nodes").at(index);
    const torch::Tensor matrix = parent.mm(matrix_of(document_, node));
    if (const auto mesh = node.find("mesh"); mesh != node.end()) {
      const size_t before = parts_.size();
      for (const json& primitive : root.at("meshes").at(mesh->get<size_t>()).at("primitives")) {
        if (!primitive.value("extensions", json::object()).contains(kExtension)) continue;
        parts_.push_back(placed(document_, gaussians_of(document_, primitive, notes_), matrix));
      }
      if (parts_.size() > before && node.value("extensions", json::object()).contains(kCopies)) {
        notes_.push_back(concat(document_.name(), ": expected Gaussians in one place, found ",
                                kCopies, " at node ", index,
                                ", which is not read: one copy is shown; write the copies out"));
      }
    }
    for (const json& child : node.value("children", json::array())) {
      collect(child.get<size_t>(), matrix, depth + 1);
    }
  }
  const std::vector<splat::Gaussians>& parts() const { return parts_; }

 private:
  Document& document_;
  std::vector<std::string>& notes_;
  std::set<size_t> visited_;
  std::vector<splat::Gaussians> parts_;
};

/// @throws DataError for an extension without which the document must not be read.
void check_required(const Document& document) {
  for (const json& name : document.root().value("extensionsRequired", json::array())) {
    if (name == kExtension || name == kQuantization) continue;
    throw document.damaged(concat("the required extension ", name.get<std::string>(),
                                  ", which is not read; write it without"));
  }
}

splat::Gaussians joined_parts(const std::vector<splat::Gaussians>& parts) {
  int64_t most = 1;
  for (const splat::Gaussians& part : parts) most = std::max(most, part.sh.size(1));
  splat::Gaussians out;
  for (int i = 0; i < kParameterCount; ++i) {
    std::vector<torch::Tensor> values;
    for (const splat::Gaussians& part : parts) {
      const torch::Tensor& value = parameter(part, i);
      const bool is_sh = value.dim() == 3;
      values.push_back(is_sh ? torch::constant_pad_nd(value, {0, 0, 0, most - value.size(1)})
                             : value);
    }
    parameter(out, i) = torch::cat(values);
  }
  return out;
}

}  // namespace

void write_glb(const std::filesystem::path& path, const GaussianFile& file) {
  const splat::Gaussians gaussians = half_turn(map_parameters(
      drawable(file.gaussians), [](const auto& value) { return file_tensor(value); }));
  if (gaussians.size() == 0) {
    throw DataError(concat(path.string(), ": not written: no Gaussian can be rendered"));
  }
  Parts parts;
  parts.add("POSITION", gaussians.means);
  const torch::Tensor norm = gaussians.rotations.norm(2, 1, true).clamp_min(1e-30);
  parts.add(attribute("ROTATION"), (gaussians.rotations / norm).roll(-1, 1));
  parts.add(attribute("SCALE"), gaussians.log_scales.exp());
  parts.add(attribute("OPACITY"), gaussians.logit_opacities.sigmoid());
  const int degrees = sh_degree_of(gaussians.sh.size(1));
  for (int degree = 0, at = 0; degree <= degrees; ++degree) {
    for (int i = 0; i <= 2 * degree; ++i) {
      parts.add(sh_attribute(degree, i), gaussians.sh.select(1, at++));
    }
  }
  const json primitive = {
      {"mode", 0},
      {"attributes", parts.attributes},
      {"extensions", {{kExtension, {{"kernel", "ellipse"}, {"colorSpace", kColorSpace}}}}}};
  const json document = {{"asset", {{"version", "2.0"}, {"generator", "JADE-GS"}}},
                         {"extensionsUsed", {kExtension}},
                         {"scene", 0},
                         {"scenes", {{{"nodes", {0}}}}},
                         {"nodes", {{{"mesh", 0}}}},
                         {"meshes", {{{"primitives", {primitive}}}}},
                         {"accessors", parts.accessors},
                         {"bufferViews", parts.views},
                         {"buffers", {{{"byteLength", parts.binary.size()}}}}};
  std::string chunks;
  put_chunk(chunks, kJsonChunk, document.dump(), ' ');
  put_chunk(chunks, kBinaryChunk, std::move(parts.binary), '\0');
  const uint64_t size = kGlbHeader + chunks.size();
  if (size > UINT32_MAX) {
    throw DataError(concat(path.string(), ": not written: ", size,
                           " bytes, more than the 4 GB that .glb can hold; write .ply or .spz"));
  }
  std::string out;
  put_unsigned(out, kMark, 4);
  put_unsigned(out, 2, 4);
  put_unsigned(out, size, 4);
  write_file(path, out + chunks);
}

GaussianFile read_gltf(const std::filesystem::path& path, std::vector<std::string>& notes) {
  Document document(path);
  Collector collector(document, notes);
  try {
    check_required(document);
    const json& root = document.root();
    const json& scene = root.at("scenes").at(root.value("scene", size_t(0)));
    for (const json& node : scene.value("nodes", json::array())) {
      collector.collect(node.get<size_t>(), torch::eye(4, torch::kFloat64), 0);
    }
  } catch (const json::exception&) {
    throw document.damaged("parts that are missing or of another type");
  }
  if (collector.parts().empty()) throw document.damaged("no Gaussians");
  if (!document.root().value("animations", json::array()).empty()) {
    notes.push_back(concat(document.name(), ": expected a scene at rest, found animations, which ",
                           "are not read: all nodes are where they are without them"));
  }
  GaussianFile file;
  file.gaussians = half_turn(joined_parts(collector.parts()));
  make_finite(file.gaussians);
  return file;
}

}  // namespace jade::gaussians
