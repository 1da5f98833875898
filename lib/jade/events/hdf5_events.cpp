// SPDX-License-Identifier: Apache-2.0
// Events in HDF5: arrays x, y, t, p in a group (DSEC, M3ED, EDS, TUM-VIE), records (tonic,
// expelliarmus), or a table of four columns (v2e, MVSEC).
#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <optional>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/text.h"
#include "jade/events/columns.h"
#include "jade/events/raw_events.h"
#include "jade/events/time_faults.h"
#include "jade/io/hdf5.h"

namespace jade::events {

enum class Hdf5Form { kArrays, kRecords, kTable };

/// Location of one stream of events.
struct Hdf5Stream {
  std::string name;  ///< name of the group, the records or the table; empty: the file itself
  Hdf5Form form = Hdf5Form::kArrays;
  std::array<std::string, 4> names{};  ///< of x, y, t, p: arrays, or fields of the records
  size_t axis = 1;                     ///< of the four columns of a table
};

namespace {

constexpr int64_t kReadLength = int64_t(1) << 22;
/// Number of table rows sampled at its start, middle and end to recognise its columns.
constexpr int64_t kTellingRows = 4096;

/// Without its group.
std::string leaf_of(const std::string& name) { return name.substr(name.rfind('/') + 1); }
std::string group_of(const std::string& name) {
  const auto slash = name.rfind('/');
  return slash == std::string::npos ? "" : name.substr(0, slash);
}
int64_t depth_of(const std::string& name) {
  return name.empty() ? 0 : 1 + std::count(name.begin(), name.end(), '/');
}

/// Stores the array of a field. A one-letter name has priority over longer names, which may be
/// something else, such as the times of frames.
void take_name(int field, const std::string& name, std::string& taken) {
  if (leaf_of(taken) != kFieldNames[field]) taken = name;
}

bool is_complete(const std::array<std::string, 4>& names) {
  return std::none_of(names.begin(), names.end(), [](const auto& name) { return name.empty(); });
}

/// A table of numbers with four columns whose name, or the name of its group, contains "event", or
/// that is the only one in its file.
bool is_event_table(const io::Hdf5Dataset& dataset, bool alone) {
  if (dataset.shape.size() != 2 || !(dataset.integer || dataset.floating)) return false;
  if (dataset.shape[0] != 4 && dataset.shape[1] != 4) return false;
  return alone || in_small_letters(dataset.name).find("event") != std::string::npos;
}

/// All streams of a file: those nearest to the root first, then by name.
std::vector<Hdf5Stream> find_streams(const io::Hdf5File& file) {
  std::map<std::pair<int64_t, std::string>, Hdf5Stream> found;
  for (const auto& dataset : file.datasets()) {
    Hdf5Stream whole;
    whole.name = dataset.name;
    for (const std::string& field : dataset.fields) {
      if (const int which = event_field(field); which >= 0)
        take_name(which, field, whole.names[size_t(which)]);
    }
    if (is_complete(whole.names)) {
      whole.form = Hdf5Form::kRecords;
      found[{depth_of(dataset.name), dataset.name}] = whole;
    } else if (is_event_table(dataset, file.datasets().size() == 1)) {
      whole.form = Hdf5Form::kTable;
      whole.axis = dataset.shape[1] == 4 ? 1 : 0;
      found[{depth_of(dataset.name), dataset.name}] = whole;
    } else if (const int field = event_field(leaf_of(dataset.name));
               field >= 0 && (dataset.integer || dataset.floating)) {
      const std::string group = group_of(dataset.name);
      Hdf5Stream& stream = found[{depth_of(group), group}];
      stream.name = group;
      take_name(field, dataset.name, stream.names[size_t(field)]);
    }
  }
  std::vector<Hdf5Stream> out;
  for (const auto& [place, stream] : found) {
    if (stream.form == Hdf5Form::kTable || is_complete(stream.names)) out.push_back(stream);
  }
  return out;
}

std::string listed_names(const std::vector<Hdf5Stream>& streams) {
  std::string out;
  for (const Hdf5Stream& stream : streams)
    out += (out.empty() ? "" : ", ") + (stream.name.empty() ? "/" : stream.name);
  return out;
}

[[noreturn]] void fail_without_events(const io::Hdf5File& file) {
  std::vector<std::string> found;
  for (const io::Hdf5Dataset& dataset : file.datasets()) found.push_back(dataset.name);
  throw DataError(concat(file.path().string(),
                         ": expected event arrays x, y, t and p in one group, records of these, or "
                         "a table of events [N,4], found ",
                         found.empty() ? "no data set" : listing(found, 12)));
}

/// The requested stream, by its name or that of a group that contains only one.
const Hdf5Stream& chosen_stream(const io::Hdf5File& file, const std::vector<Hdf5Stream>& streams,
                                std::string group) {
  if (streams.empty()) fail_without_events(file);
  const size_t begin = group.find_first_not_of('/');
  if (group.empty()) return streams.front();
  group = begin == std::string::npos ? ""
                                     : group.substr(begin, group.find_last_not_of('/') + 1 - begin);
  std::vector<const Hdf5Stream*> inside;
  for (const Hdf5Stream& stream : streams) {
    if (stream.name == group) return stream;
    if (stream.name.rfind(group + "/", 0) == 0) inside.push_back(&stream);
  }
  if (inside.size() == 1) return *inside.front();
  throw DataError(concat(file.path().string(), ": expected a stream of events called ", group,
                         ", found ", listed_names(streams), "; choose one of these"));
}

/// A data set of one number, with or without axes.
template <class T>
T read_number(const io::Hdf5File& file, const std::string& name) {
  if (file.length(name) != 1) {
    throw DataError(concat(file.path().string(), ": expected one number in '", name, "', found ",
                           file.length(name)));
  }
  T number{};
  file.read<T>(name, 0, 1, &number);
  return number;
}

}  // namespace

struct Hdf5Events::Source {
  Source(const std::filesystem::path& path, const std::string& group,
         const std::optional<Columns>& known, std::vector<std::string>& notes)
      : file(path) {
    const std::vector<Hdf5Stream> streams = find_streams(file);
    stream = chosen_stream(file, streams, group);
    if (streams.size() > 1 && group.empty()) {
      notes.push_back(concat(path.string(), ": holds ", streams.size(), " streams of events (",
                             listed_names(streams), "); ", stream.name.empty() ? "/" : stream.name,
                             " is read, choose another with --events-group"));
    }
    measure(known);
    for (const std::string& name : {stream.name + "/t_offset", std::string("t_offset")}) {
      if (offset_name.empty() && file.has(name)) offset_name = name;
    }
    find_size();
    find_unit(notes);
    note_unused(notes);
  }

  /// Reads the unit from an attribute of the times.
  void find_unit(std::vector<std::string>& notes) {
    const bool arrays = stream.form == Hdf5Form::kArrays;
    const std::string& name = arrays ? stream.names[2] : stream.name;
    for (const char* const key : {"unit", "units", "Unit", "Units", "time_unit", "time_units"}) {
      // Records and tables contain more than times.
      if (!arrays && std::string(key).rfind("time", 0) != 0) continue;
      const std::string said = file.attribute(name, key);
      if (said.empty()) continue;
      if (const auto unit = unit_of_word(said)) {
        unit_attribute = *unit;
        return;
      }
      notes.push_back(concat(file.path().string(), ": expected us, ns, ms or s in the attribute ",
                             key, " of ", name, ", found '", said.substr(0, 40),
                             "', which is not used; give --events-unit"));
    }
  }

  /// M3ED stores width and height beside a camera's events.
  void find_size() {
    const std::string name = stream.name + "/calib/resolution";
    if (stream.form != Hdf5Form::kArrays || !file.has(name) || file.length(name) != 2) return;
    int64_t sides[2] = {0, 0};
    file.read<int64_t>(name, 0, 2, sides);
    if (sides[0] > 0 && sides[1] > 0) size = ImageSize{sides[1], sides[0]};
  }

  /// Finds the length, and the columns of a table.
  void measure(const std::optional<Columns>& known) {
    if (stream.form == Hdf5Form::kArrays) {
      std::array<int64_t, 4> lengths{};
      for (size_t i = 0; i < 4; ++i) lengths[i] = file.length(stream.names[i]);
      check_lengths(file.path(), lengths);
      length = lengths[0];
      return;
    }
    if (stream.form == Hdf5Form::kRecords) {
      length = file.length(stream.name);
      return;
    }
    length = file.dataset(stream.name).shape[1 - stream.axis];
    columns = known ? *known
                    : likely_columns(telling_rows(), Preference::kLarger,
                                     concat(file.path().string(), ": ", stream.name),
                                     "store x, y, t and p as arrays of these names");
  }

  std::vector<Row> telling_rows() const {
    std::vector<Row> rows;
    int64_t behind = 0;
    for (const int64_t start : {int64_t(0), length / 2, length - kTellingRows}) {
      const int64_t begin = std::max(start, behind);
      const int64_t count = std::min(kTellingRows, length - begin);
      if (count <= 0) continue;
      std::vector<double> column(static_cast<size_t>(count));
      const size_t before = rows.size();
      rows.resize(before + column.size());
      for (size_t c = 0; c < 4; ++c) {
        file.read_column<double>(stream.name, stream.axis, int64_t(c), begin, count, column.data());
        for (size_t i = 0; i < column.size(); ++i) rows[before + i][c] = column[i];
      }
      behind = begin + count;
    }
    return rows;
  }

  /// Notes data sets that affect places or times of events and are not used.
  void note_unused(std::vector<std::string>& notes) const {
    for (const auto& dataset : file.datasets()) {
      if (leaf_of(dataset.name).find("rectify_map") == std::string::npos) continue;
      notes.push_back(concat(file.path().string(), ": ", dataset.name,
                             " is not used: events keep the lens's distortion; give the "
                             "calibration, which undistorts frames and events alike"));
    }
  }

  const io::Hdf5Dataset& dataset_of(size_t field) const {
    return file.dataset(stream.form == Hdf5Form::kArrays ? stream.names[field] : stream.name);
  }
  bool is_floating(size_t field) const {
    const io::Hdf5Dataset& dataset = dataset_of(field);
    if (stream.form != Hdf5Form::kRecords) return dataset.floating;
    const auto at = std::find(dataset.fields.begin(), dataset.fields.end(), stream.names[field]);
    return dataset.floating_fields[size_t(at - dataset.fields.begin())];
  }

  int64_t item_size(size_t field) const {
    const io::Hdf5Dataset& dataset = dataset_of(field);
    if (stream.form != Hdf5Form::kRecords) return dataset.item_size;
    const auto at = std::find(dataset.fields.begin(), dataset.fields.end(), stream.names[field]);
    return dataset.field_sizes[size_t(at - dataset.fields.begin())];
  }

  template <class T>
  void read_values(size_t field, int64_t begin, int64_t count, T* out) const {
    if (stream.form == Hdf5Form::kArrays) {
      file.read<T>(stream.names[field], begin, count, out);
    } else if (stream.form == Hdf5Form::kRecords) {
      file.read_field<T>(stream.name, stream.names[field], begin, count, out);
    } else {
      file.read_column<T>(stream.name, stream.axis, int64_t(columns[field]), begin, count, out);
    }
  }

  /// Reads whole chunks, so that none is decompressed twice.
  template <class T>
  void read_in_parts(size_t field, const Stretch& stretch, T* out) const {
    const int64_t chunk = std::max<int64_t>(dataset_of(field).chunk_length, 1);
    const int64_t step = std::max<int64_t>(chunk, kReadLength / chunk * chunk);
    for (int64_t begin = stretch.begin; begin < stretch.end;) {
      throw_if_interrupted();
      const int64_t count = std::min((begin / step + 1) * step, stretch.end) - begin;
      read_values<T>(field, begin, count, out + (begin - stretch.begin));
      begin += count;
    }
  }

  template <class T>
  torch::Tensor read_tensor(size_t field, const std::vector<Stretch>& stretches,
                            torch::ScalarType type) const {
    int64_t count = 0;
    for (const Stretch& stretch : stretches) count += stretch.size();
    torch::Tensor out = torch::empty({count}, type);
    T* data = out.mutable_data_ptr<T>();
    for (const Stretch& stretch : stretches) {
      read_in_parts<T>(field, stretch, data);
      data += stretch.size();
    }
    return out;
  }

  io::Hdf5File file;
  Hdf5Stream stream;
  Columns columns = kTimeFirst;  ///< for a table
  int64_t length = 0;
  std::string offset_name;  ///< name of a number that is added to all times; empty: none
  std::optional<ImageSize> size;
  TimeUnit unit_attribute = TimeUnit::kAuto;  ///< from an attribute of the times
};

Hdf5Events::Hdf5Events(const std::filesystem::path& path, const std::string& group,
                       const std::optional<Columns>& known)
    : source_(std::make_shared<Source>(path, group, known, notes_)) {}

Hdf5Events::~Hdf5Events() = default;

const std::string& Hdf5Events::name() const { return source_->stream.name; }

int Hdf5Events::time_bits() const {
  return significant_bits(source_->is_floating(2), source_->item_size(2));
}

int64_t Hdf5Events::length() const { return source_->length; }

TimeUnit Hdf5Events::unit() const {
  const Hdf5Stream& stream = source_->stream;
  const TimeUnit said =
      stream.form == Hdf5Form::kTable ? TimeUnit::kAuto : unit_in_name(leaf_of(stream.names[2]));
  return said != TimeUnit::kAuto ? said : source_->unit_attribute;
}

TimeSurvey Hdf5Events::survey() const {
  const auto source = source_;
  const double offset =
      source->offset_name.empty() ? 0 : read_number<double>(source->file, source->offset_name);
  return {source->length, [source, offset](int64_t begin, int64_t count, double* out) {
            source->read_in_parts<double>(2, {begin, begin + count}, out);
            for (int64_t i = 0; i < count; ++i) out[i] += offset;
          }};
}

RawEvents Hdf5Events::read(const std::optional<std::vector<Stretch>>& wanted) const {
  const Source& source = *source_;
  const auto stretches = wanted.value_or(std::vector<Stretch>{{0, source.length}});
  RawEvents out;
  out.x = source.read_tensor<float>(0, stretches, torch::kFloat32);
  out.y = source.read_tensor<float>(1, stretches, torch::kFloat32);
  out.polarity = source.is_floating(3)
                     ? whole_polarity(source.file.path(),
                                      source.read_tensor<float>(3, stretches, torch::kFloat32))
                     : source.read_tensor<int8_t>(3, stretches, torch::kInt8);
  const bool moved = !source.offset_name.empty();
  if (source.is_floating(2)) {
    out.time = source.read_tensor<double>(2, stretches, torch::kFloat64);
    if (moved) out.time += read_number<double>(source.file, source.offset_name);
  } else {
    out.time = source.read_tensor<int64_t>(2, stretches, torch::kInt64);
    if (moved) out.time += read_number<int64_t>(source.file, source.offset_name);
  }
  out.unit = unit();
  out.time_bits = time_bits();
  out.size = source.size;
  if (source.stream.form == Hdf5Form::kTable) out.columns = source.columns;
  return out;
}

}  // namespace jade::events
