// SPDX-License-Identifier: Apache-2.0
// Events in NumPy's arrays: x, y, t and p by name, records, or a table of four columns.
#include "jade/events/raw_events.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <torch/types.h>
#include <vector>

#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/events/columns.h"
#include "jade/events/time_faults.h"
#include "jade/io/npy.h"
#include "jade/io/stand_in.h"

namespace jade::events {
namespace {

constexpr const char* kNameArrays = "store x, y, t and p as arrays of these names";
/// Number of table rows sampled at its start, middle and end to recognise its columns.
constexpr int64_t kTellingTableRows = 4096;

/// Whether the name is that of text, which gzip may have compressed.
bool is_list_of_text(std::filesystem::path name) {
  if (name.extension() == ".gz") name.replace_extension();
  const std::string ending = in_small_letters(name.extension().string());
  return ending == ".txt" || ending == ".csv" || ending == ".tsv";
}

/// Converts one column of numbers to the library's type; times with fractions stay floating point.
RawEvents from_columns(const std::filesystem::path& path, const torch::Tensor& x,
                       const torch::Tensor& y, const torch::Tensor& t, const torch::Tensor& p) {
  check_lengths(path, {x.numel(), y.numel(), t.numel(), p.numel()});
  RawEvents out;
  out.x = x.flatten().to(torch::kFloat32).contiguous();
  out.y = y.flatten().to(torch::kFloat32).contiguous();
  out.polarity = whole_polarity(path, p.flatten());
  out.time = t.flatten().to(t.is_floating_point() ? torch::kFloat64 : torch::kInt64).contiguous();
  out.time_bits = significant_bits(t.is_floating_point(), t.element_size());
  return out;
}

std::vector<Row> telling_rows_of(const torch::Tensor& table) {
  const int64_t length = table.size(0);
  std::vector<Row> rows;
  int64_t behind = 0;
  for (const int64_t start : {int64_t(0), length / 2, length - kTellingTableRows}) {
    const int64_t begin = std::max(start, behind);
    const int64_t count = std::min(kTellingTableRows, length - begin);
    if (count <= 0) continue;
    const torch::Tensor part = table.narrow(0, begin, count).to(torch::kFloat64).contiguous();
    const double* value = part.const_data_ptr<double>();
    for (int64_t i = 0; i < count; ++i, value += 4)
      rows.push_back({value[0], value[1], value[2], value[3]});
    behind = begin + count;
  }
  return rows;
}

RawEvents from_table(const std::filesystem::path& path, const torch::Tensor& given,
                     const std::optional<Columns>& known) {
  const bool lying = given.dim() == 2 && given.size(0) == 4 && given.size(1) != 4;
  const torch::Tensor table = lying ? given.t() : given;
  if (table.dim() != 2 || table.size(1) != 4) {
    throw DataError(concat(path.string(),
                           ": expected an array [N,4] of t x y p, in any order, or records with "
                           "these fields, found an array of shape ",
                           c10::IntArrayRef(given.sizes()), "; ", kNameArrays));
  }
  const Columns c = known ? *known
                          : likely_columns(telling_rows_of(table), Preference::kLarger,
                                           path.string(), kNameArrays);
  const auto column = [&](size_t i) { return table.select(1, int64_t(c[i])); };
  RawEvents out = from_columns(path, column(0), column(1), column(2), column(3));
  out.columns = c;
  return out;
}

RawEvents from_records(const std::filesystem::path& path, const io::NamedTensors& fields,
                       const std::optional<Columns>& known) {
  if (fields.size() == 1 && fields[0].first.empty())
    return from_table(path, fields[0].second, known);
  std::vector<std::string> names;
  for (const auto& [name, values] : fields) names.push_back(name);
  const auto c = named_columns(names);
  if (!c) {
    throw DataError(concat(path.string(),
                           ": expected records with the fields x, y, t and p, found ",
                           listing(names), "; ", kNameArrays));
  }
  const auto field = [&](size_t i) { return fields[(*c)[i]].second; };
  RawEvents out = from_columns(path, field(0), field(1), field(2), field(3));
  out.unit = unit_in_name(names[(*c)[2]]);
  return out;
}

/// The array of an archive that contains whole events: the only one, or the one with a matching
/// name.
std::string event_array(const io::Npz& archive) {
  if (archive.names().size() == 1) return archive.names()[0];
  std::string found;
  for (const std::string& name : archive.names()) {
    if (name.find("event") == std::string::npos) continue;
    if (!found.empty()) return "";
    found = name;
  }
  return found;
}

}  // namespace

EventFileKind file_kind(const std::filesystem::path& path) {
  const std::string ending = in_small_letters(path.extension().string());
  std::ifstream file(path, std::ios::binary);
  char head[6] = {};
  file.read(head, sizeof head);
  const std::string begin(head, size_t(file.gcount()));
  const auto starts = [&](const char* with) { return begin.rfind(with, 0) == 0; };
  if (ending == ".h5" || ending == ".hdf5" || starts("\x89HDF")) return EventFileKind::kHdf5;
  if (ending == ".npz" || starts("PK\x03\x04")) return EventFileKind::kNpz;
  if (ending == ".npy" || starts("\x93NUMPY")) return EventFileKind::kNpy;
  if (is_list_of_text(path)) return EventFileKind::kText;
  if (const std::string other = io::stand_in(path); !other.empty())
    throw DataError(concat(path.string(), ": expected a list of events, found ", other));
  throw DataError(concat(path.string(),
                         ": expected a list of events named .h5, .hdf5, .npz, .npy, .txt or .csv, "
                         "found '",
                         path.filename().string(),
                         "'; give a list in text the ending .txt, and a "
                         "camera's own file to jade_import"));
}

RawEvents read_raw(const std::filesystem::path& path, EventFileKind kind, const std::string& group,
                   const std::optional<Columns>& known) {
  if (!group.empty()) {
    throw DataError(concat(path.string(), ": expected an HDF5 file, of which a group is chosen (",
                           group, "), found another format; leave the group out"));
  }
  switch (kind) {
    case EventFileKind::kNpz:
      return read_npz_events(path, known);
    case EventFileKind::kNpy:
      return read_npy_events(path, known);
    default:
      return read_text_events(path, known);
  }
}

torch::Tensor whole_polarity(const std::filesystem::path& path, const torch::Tensor& polarity) {
  if (!polarity.to(torch::kInt8).eq(polarity).all().item<bool>()) {
    throw DataError(concat(path.string(), ": expected polarities 0/1 or -1/+1, found numbers from ",
                           polarity.min().to(torch::kFloat64).item<double>(), " to ",
                           polarity.max().to(torch::kFloat64).item<double>(),
                           "; store 1 for brighter and 0 for darker"));
  }
  return polarity.to(torch::kInt8).contiguous();
}

void check_lengths(const std::filesystem::path& path, const std::array<int64_t, 4>& lengths) {
  if (std::all_of(lengths.begin(), lengths.end(), [&](int64_t n) { return n == lengths[0]; }))
    return;
  throw DataError(concat(path.string(), ": expected x, y, t and p of one length, found ",
                         lengths[0], ", ", lengths[1], ", ", lengths[2], " and ", lengths[3],
                         "; the recording is damaged or was cut short"));
}

RawEvents read_npz_events(const std::filesystem::path& path, const std::optional<Columns>& known) {
  const io::Npz archive(path);
  std::array<std::string, 4> names;
  for (const auto& name : archive.names()) {
    // A one-letter name has priority over longer names.
    const int field = event_field(name);
    if (field >= 0 && names[size_t(field)] != kFieldNames[field]) names[size_t(field)] = name;
  }
  const auto lacking = std::find(names.begin(), names.end(), "");
  if (lacking != names.end()) {
    if (const std::string whole = event_array(archive); !whole.empty())
      return from_records(path, io::read_npz_fields(path, whole), known);
    throw DataError(concat(path.string(), ": expected an array named ",
                           kFieldNames[lacking - names.begin()], "; ", kNameArrays));
  }
  RawEvents out = from_columns(path, archive.read(names[0]), archive.read(names[1]),
                               archive.read(names[2]), archive.read(names[3]));
  out.unit = unit_in_name(names[2]);
  return out;
}

RawEvents read_npy_events(const std::filesystem::path& path, const std::optional<Columns>& known) {
  return from_records(path, io::read_npy_fields(path), known);
}

}  // namespace jade::events
