// SPDX-License-Identifier: Apache-2.0
#include "jade/io/colmap.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <set>
#include <sstream>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"

namespace jade::io {
namespace {

struct CameraModel {
  const char* name;
  size_t parameters;
};
/// Indexed by COLMAP's model id.
constexpr CameraModel kModels[] = {{"SIMPLE_PINHOLE", 3},
                                   {"PINHOLE", 4},
                                   {"SIMPLE_RADIAL", 4},
                                   {"RADIAL", 5},
                                   {"OPENCV", 8},
                                   {"OPENCV_FISHEYE", 8},
                                   {"FULL_OPENCV", 12},
                                   {"FOV", 5},
                                   {"SIMPLE_RADIAL_FISHEYE", 4},
                                   {"RADIAL_FISHEYE", 5},
                                   {"THIN_PRISM_FISHEYE", 12},
                                   {"RAD_TAN_THIN_PRISM_FISHEYE", 16},
                                   {"SIMPLE_DIVISION", 4},
                                   {"DIVISION", 5},
                                   {"SIMPLE_FISHEYE", 3},
                                   {"FISHEYE", 4},
                                   {"EUCM", 6},
                                   {"EQUIRECTANGULAR", 2}};

/// Bytes of an image without name and observations.
constexpr uint64_t kSmallestImage = 4 + 7 * 8 + 4 + 1 + 8;

struct Points {
  std::vector<double> xyz;
  std::vector<uint8_t> rgb;
  std::vector<double> errors;
  std::vector<std::vector<int64_t>> images;
};

DataError damaged(const std::string& file, const std::string& what) {
  return DataError(concat(file, ": ", what,
                          "; the model is truncated or damaged, copy it again or "
                          "rerun COLMAP"));
}

DataError unknown_model(const std::string& file, int64_t camera, const std::string& model) {
  return DataError(concat(file, ": camera ", camera, ": expected a camera model of COLMAP 4 or ",
                          "earlier, found ", model,
                          "; undistort the images with colmap image_undistorter, which writes "
                          "PINHOLE cameras"));
}

/// Reads little-endian values from the front of a file's content.
class Cursor {
 public:
  Cursor(const std::string& bytes, std::string file) : bytes_(bytes), file_(std::move(file)) {}

  template <class T>
  T take() {
    T value;
    need(sizeof(T));
    std::memcpy(&value, bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  /// @param row  of the value, as "image 3 of 20", for the message
  template <class Row>
  double take_finite(const Row& row) {
    const auto value = take<double>();
    if (std::isfinite(value)) return value;
    throw damaged(file_, concat(row(), ": expected finite numbers, found ", value));
  }
  /// Reads a count of records of at least `record_size` bytes each, and checks it against the
  /// remaining bytes.
  uint64_t take_count(size_t record_size) {
    const auto count = take<uint64_t>();
    if (count > (bytes_.size() - at_) / record_size) {
      throw damaged(file_, concat("claims ", count, " entries of at least ", record_size,
                                  " bytes, but ", bytes_.size() - at_, " bytes follow"));
    }
    return count;
  }
  std::string take_name() {
    const size_t end = bytes_.find('\0', at_);
    if (end == std::string::npos) throw damaged(file_, "ends inside an image name");
    std::string name = bytes_.substr(at_, end - at_);
    at_ = end + 1;
    return name;
  }
  void skip(size_t count) {
    need(count);
    at_ += count;
  }

 private:
  void need(size_t count) const {
    if (count > bytes_.size() - at_) throw damaged(file_, concat("ends at byte ", bytes_.size()));
  }
  const std::string& bytes_;
  std::string file_;
  size_t at_ = 0;
};

std::vector<ColmapCamera> binary_cameras(const std::string& bytes, const std::string& file) {
  Cursor cursor(bytes, file);
  std::vector<ColmapCamera> cameras(cursor.take_count(4 + 4 + 8 + 8 + 2 * 8));
  for (ColmapCamera& camera : cameras) {
    camera.id = cursor.take<int32_t>();
    const auto row = [&] { return concat("camera ", camera.id); };
    const auto model = cursor.take<int32_t>();
    if (model < 0 || model >= int32_t(std::size(kModels))) {
      constexpr int32_t kFarFromAny = 1000;
      if (model >= 0 && model < kFarFromAny) {
        throw unknown_model(file, camera.id, concat("number ", model));
      }
      throw damaged(file, concat("camera ", camera.id, " has unknown model ", model));
    }
    camera.model = kModels[model].name;
    camera.width = cursor.take<int64_t>();
    camera.height = cursor.take<int64_t>();
    camera.parameters.resize(kModels[model].parameters);
    for (double& parameter : camera.parameters) parameter = cursor.take_finite(row);
  }
  return cameras;
}

std::vector<ColmapImage> binary_images(const std::string& bytes, const std::string& file) {
  Cursor cursor(bytes, file);
  std::vector<ColmapImage> images;
  const uint64_t count = cursor.take_count(kSmallestImage);
  images.reserve(count);
  for (uint64_t i = 0; i < count; ++i) {
    ColmapImage image;
    image.id = cursor.take<int32_t>();
    const auto row = [&] { return concat("image ", i + 1, " of ", count, " (id ", image.id, ")"); };
    for (double& value : image.rotation) value = cursor.take_finite(row);
    for (double& value : image.translation) value = cursor.take_finite(row);
    image.camera_id = cursor.take<int32_t>();
    image.name = cursor.take_name();
    constexpr size_t kObservation = 24;  // x, y, point id
    cursor.skip(cursor.take_count(kObservation) * kObservation);
    images.push_back(std::move(image));
  }
  return images;
}

Points binary_points(const std::string& bytes, const std::string& file) {
  Cursor cursor(bytes, file);
  Points points;
  const uint64_t count = cursor.take_count(8 + 3 * 8 + 3 + 8 + 8);
  points.xyz.reserve(3 * count);
  points.rgb.reserve(3 * count);
  for (uint64_t i = 0; i < count; ++i) {
    const auto id = cursor.take<uint64_t>();
    const auto row = [&] { return concat("point ", i + 1, " of ", count, " (id ", id, ")"); };
    for (int axis = 0; axis < 3; ++axis) points.xyz.push_back(cursor.take_finite(row));
    for (int channel = 0; channel < 3; ++channel) points.rgb.push_back(cursor.take<uint8_t>());
    points.errors.push_back(cursor.take<double>());
    constexpr size_t kTrackElement = 8;  // image id, observation index
    points.images.emplace_back(cursor.take_count(kTrackElement));
    for (int64_t& image : points.images.back()) {
      image = cursor.take<int32_t>();
      cursor.skip(4);
    }
  }
  return points;
}

/// The lines of a text file that are not comments, with their numbers. Empty lines are kept,
/// because an image without observations has one.
struct Lines {
  Lines(const std::string& text, std::string name)
      : stream(without_mark(text)), file(std::move(name)) {}
  bool next() {
    while (std::getline(stream, line)) {
      ++number;
      if (!line.empty() && line.back() == '\r') line.pop_back();
      if (line.empty() || line[0] != '#') return true;
    }
    return false;
  }
  bool blank() const { return line.find_first_not_of(" \t") == std::string::npos; }
  DataError error(const std::string& expected) const {
    const std::string beyond = not_finite();
    return damaged(file, concat("line ", number, ": expected ",
                                beyond.empty() ? expected : "finite numbers, found " + beyond));
  }
  /// The first word of the line that stands for NaN or infinity; empty if there is none.
  std::string not_finite() const {
    std::istringstream words(line);
    for (std::string word; words >> word;) {
      char* end = nullptr;
      const double value = std::strtod(word.c_str(), &end);
      if (end == word.c_str() + word.size() && !std::isfinite(value)) return word;
    }
    return "";
  }
  std::istringstream stream;
  std::string file;
  std::string line;
  int64_t number = 0;
};

std::vector<ColmapCamera> text_cameras(const std::string& text, const std::string& file) {
  std::vector<ColmapCamera> cameras;
  for (Lines lines(text, file); lines.next();) {
    if (lines.blank()) continue;
    std::istringstream row(lines.line);
    ColmapCamera camera;
    row >> camera.id >> camera.model >> camera.width >> camera.height;
    const CameraModel* known = nullptr;
    for (const CameraModel& model : kModels) {
      if (camera.model == model.name) known = &model;
    }
    if (!row) throw lines.error("CAMERA_ID MODEL WIDTH HEIGHT PARAMS");
    if (known == nullptr) throw unknown_model(file, camera.id, camera.model);
    camera.parameters.resize(known->parameters);
    for (double& parameter : camera.parameters) {
      if (!(row >> parameter) || !std::isfinite(parameter)) {
        throw lines.error(concat(known->parameters, " parameters of a ", camera.model));
      }
    }
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

/// Whether a line has x, y and a point's number for each observation; it may have none.
bool are_observations(const std::string& line) {
  size_t count = 0;
  for (const char *at = line.data(), *const end = at + line.size(); at != end;) {
    if (*at == ' ' || *at == '\t') {
      ++at;
      continue;
    }
    double value = 0;
    const auto [next, error] = std::from_chars(at, end, value);
    if (error == std::errc::invalid_argument || (next != end && *next != ' ' && *next != '\t')) {
      return false;
    }
    at = next;
    ++count;
  }
  return count % 3 == 0;
}

std::vector<ColmapImage> text_images(const std::string& text, const std::string& file) {
  std::vector<ColmapImage> images;
  for (Lines lines(text, file); lines.next();) {
    if (lines.blank()) continue;
    std::istringstream row(lines.line);
    ColmapImage image;
    row >> image.id;
    for (double& value : image.rotation) row >> value;
    for (double& value : image.translation) row >> value;
    row >> image.camera_id >> std::ws;
    if (!row || !std::getline(row, image.name)) {
      throw lines.error("IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME");
    }
    images.push_back(std::move(image));
    // Without this line every second image would be skipped.
    if (lines.next() && !are_observations(lines.line)) {
      throw lines.error("the observations of the image before, or an empty line");
    }
  }
  return images;
}

Points text_points(const std::string& text, const std::string& file) {
  Points points;
  for (Lines lines(text, file); lines.next();) {
    if (lines.blank()) continue;
    std::istringstream row(lines.line);
    int64_t id = 0;
    double xyz[3];
    int rgb[3];
    row >> id >> xyz[0] >> xyz[1] >> xyz[2] >> rgb[0] >> rgb[1] >> rgb[2];
    if (!row) throw lines.error("POINT3D_ID X Y Z R G B ERROR TRACK");
    for (const double value : xyz) points.xyz.push_back(value);
    for (const int value : rgb) points.rgb.push_back(static_cast<uint8_t>(value));
    double error = 0;
    points.errors.push_back(row >> error ? error : std::nan(""));
    points.images.emplace_back();
    for (int64_t image = 0, observation = 0; row >> image >> observation;) {
      points.images.back().push_back(image);
    }
  }
  return points;
}

void check_cameras(const ColmapModel& model, const std::string& file) {
  constexpr int64_t kLargestSide = 1 << 16;
  std::set<int64_t> ids;
  for (const ColmapCamera& camera : model.cameras) {
    if (!ids.insert(camera.id).second) throw damaged(file, concat("two cameras ", camera.id));
    const bool sized = camera.width > 0 && camera.height > 0 && camera.width <= kLargestSide &&
                       camera.height <= kLargestSide;
    if (!sized || !(camera.parameters[0] > 0)) {
      throw damaged(file, concat("camera ", camera.id, " has size ", camera.width, "x",
                                 camera.height, " and focal length ", camera.parameters[0]));
    }
  }
}

void check_images(const ColmapModel& model, const std::string& file) {
  std::set<int64_t> ids;
  for (const ColmapImage& image : model.images) {
    if (!ids.insert(image.id).second) throw damaged(file, concat("two images ", image.id));
    double norm = 0;
    bool finite = true;
    for (const double value : image.rotation) norm += value * value;
    for (const double value : image.translation) finite = finite && std::isfinite(value);
    if (!finite || !std::isfinite(norm) || norm < 0.25) {
      throw damaged(file, concat("image '", image.name, "' has no valid pose"));
    }
    model.camera(image.camera_id);
  }
}

/// Replaces the model's points by those of a points3D file's content.
void set_points(const std::string& content, bool binary, const std::string& folder,
                ColmapModel& model) {
  const std::string file = concat(folder, "/points3D", binary ? ".bin" : ".txt");
  Points points;
  if (!content.empty()) points = binary ? binary_points(content, file) : text_points(content, file);
  for (const double value : points.xyz) {
    if (!std::isfinite(value)) throw damaged(file, "found a point that is not finite");
  }
  model.points = torch::tensor(points.xyz, torch::kFloat64).reshape({-1, 3});
  model.point_colors = torch::tensor(points.rgb, torch::kUInt8).reshape({-1, 3});
  model.point_errors = torch::tensor(points.errors, torch::kFloat64);
  model.point_images = std::move(points.images);
}

bool has_pair(const std::filesystem::path& folder, const char* extension) {
  return std::filesystem::exists(folder / (std::string("cameras") + extension)) &&
         std::filesystem::exists(folder / (std::string("images") + extension));
}

}  // namespace

const ColmapCamera& ColmapModel::camera(int64_t id) const {
  for (const ColmapCamera& camera : cameras) {
    if (camera.id == id) return camera;
  }
  throw DataError(concat("COLMAP model: an image names camera ", id, ", which is not among the ",
                         cameras.size(), " cameras; cameras and images are of different models"));
}

bool is_colmap_model(const std::filesystem::path& folder) {
  return has_pair(folder, ".bin") || has_pair(folder, ".txt");
}

int64_t count_colmap_images(const std::filesystem::path& folder) {
  if (has_pair(folder, ".bin")) {
    std::ifstream file(folder / "images.bin", std::ios::binary);
    char bytes[sizeof(uint64_t)] = {};
    if (!file.read(bytes, sizeof bytes)) return 0;
    uint64_t count = 0;
    std::memcpy(&count, bytes, sizeof count);
    // A damaged file may claim any count.
    const uint64_t most = std::filesystem::file_size(folder / "images.bin") / kSmallestImage;
    return int64_t(std::min(count, most));
  }
  if (!has_pair(folder, ".txt")) return 0;
  const std::string text = read_file(folder / "images.txt");
  int64_t count = 0;
  for (Lines lines(text, folder.string()); lines.next();) ++count;
  return (count + 1) / 2;
}

ColmapModel parse_colmap(const ColmapFiles& files) {
  const std::string extension = files.binary ? ".bin" : ".txt";
  const std::string cameras = files.name + "/cameras" + extension;
  const std::string images = files.name + "/images" + extension;
  ColmapModel model;
  model.cameras =
      files.binary ? binary_cameras(files.cameras, cameras) : text_cameras(files.cameras, cameras);
  check_cameras(model, cameras);
  model.images =
      files.binary ? binary_images(files.images, images) : text_images(files.images, images);
  check_images(model, images);
  set_points(files.points, files.binary, files.name, model);
  return model;
}

ColmapModel read_colmap(const std::filesystem::path& folder) {
  if (!is_colmap_model(folder)) {
    throw DataError(concat(folder.string(),
                           ": expected a COLMAP model (cameras and images as .bin "
                           "or .txt), found neither; point to its sparse/0"));
  }
  ColmapFiles files;
  files.binary = has_pair(folder, ".bin");
  files.name = folder.string();
  const std::string extension = files.binary ? ".bin" : ".txt";
  files.cameras = read_file(folder / ("cameras" + extension));
  files.images = read_file(folder / ("images" + extension));
  ColmapModel model = parse_colmap(files);
  for (const bool binary : {files.binary, !files.binary}) {
    const std::filesystem::path points = folder / (binary ? "points3D.bin" : "points3D.txt");
    if (model.points.size(0) > 0 || !std::filesystem::exists(points)) continue;
    set_points(read_file(points), binary, files.name, model);
  }
  return model;
}

}  // namespace jade::io
