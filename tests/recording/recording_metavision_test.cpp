// SPDX-License-Identifier: Apache-2.0
// HDF5 files as Metavision writes them, created here with the HDF5 library.
#include "support/catch.h"

#include <cstddef>
#include <hdf5.h>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/recording/recording.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;
using jade::test::TempDir;

namespace {

struct EventRecord {
  uint16_t x, y;
  int16_t p;
  int64_t t;
};
struct TriggerRecord {
  int16_t p;
  int64_t t;
  int16_t id;
};

constexpr H5Z_filter_t kEcf = 36559;

hid_t event_type() {
  const hid_t type = H5Tcreate(H5T_COMPOUND, sizeof(EventRecord));
  H5Tinsert(type, "x", offsetof(EventRecord, x), H5T_NATIVE_UINT16);
  H5Tinsert(type, "y", offsetof(EventRecord, y), H5T_NATIVE_UINT16);
  H5Tinsert(type, "p", offsetof(EventRecord, p), H5T_NATIVE_INT16);
  H5Tinsert(type, "t", offsetof(EventRecord, t), H5T_NATIVE_INT64);
  return type;
}

hid_t trigger_type() {
  const hid_t type = H5Tcreate(H5T_COMPOUND, sizeof(TriggerRecord));
  H5Tinsert(type, "p", offsetof(TriggerRecord, p), H5T_NATIVE_INT16);
  H5Tinsert(type, "t", offsetof(TriggerRecord, t), H5T_NATIVE_INT64);
  H5Tinsert(type, "id", offsetof(TriggerRecord, id), H5T_NATIVE_INT16);
  return type;
}

/// A list of records in a group; `ecf`: bytes that are not a valid chunk of that compression.
void write_records(hid_t file, const char* group, hid_t type, const void* records, hsize_t count,
                   bool ecf = false) {
  const hid_t folder = H5Gcreate2(file, group, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
  const hid_t space = H5Screate_simple(1, &count, nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_chunk(properties, 1, &count);
  if (ecf) {
    // HDF5 creates no data set for a filter that can only read.
    if (H5Zfilter_avail(kEcf) > 0) H5Zunregister(kEcf);
    H5Pset_filter(properties, kEcf, H5Z_FLAG_OPTIONAL, 0, nullptr);
  }
  const hid_t data =
      H5Dcreate2(folder, "events", type, space, H5P_DEFAULT, properties, H5P_DEFAULT);
  const hsize_t origin = 0;
  if (ecf) {
    H5Dwrite_chunk(data, H5P_DEFAULT, 0, &origin, 5, "bytes");
  } else {
    H5Dwrite(data, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, records);
  }
  H5Dclose(data);
  H5Pclose(properties);
  H5Sclose(space);
  H5Gclose(folder);
}

void write_geometry(hid_t file, const char* text) {
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  const hid_t space = H5Screate(H5S_SCALAR);
  const hid_t attribute = H5Acreate2(file, "geometry", type, space, H5P_DEFAULT, H5P_DEFAULT);
  H5Awrite(attribute, type, &text);
  H5Aclose(attribute);
  H5Sclose(space);
  H5Tclose(type);
}

const std::vector<EventRecord> kRecords{
    {1, 2, 1, 100}, {1279, 719, 0, 300}, {5, 6, 0, 200}, {1280, 3, 1, 400}};

}  // namespace

TEST_CASE("recording: Metavision's records with triggers and the sensor's size", "[recording]") {
  const TempDir dir;
  const hid_t file = H5Fcreate((dir / "a.hdf5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  write_geometry(file, "1280x720");
  write_records(file, "CD", event_type(), kRecords.data(), kRecords.size());
  const std::vector<TriggerRecord> triggers{{1, 110, 0}, {0, 150, 0}};
  write_records(file, "EXT_TRIGGER", trigger_type(), triggers.data(), triggers.size());
  H5Fclose(file);
  const Recording recording = read_recording(dir / "a.hdf5");
  CHECK(recording.format == "Metavision HDF5");
  CHECK(recording.width == 1280);
  CHECK(recording.height == 720);
  CHECK(recording.events.t_us().equal(torch::tensor({100, 200, 300}, torch::kInt64)));
  CHECK(recording.events.x().equal(torch::tensor({1.F, 5.F, 1279.F})));
  CHECK(recording.events.polarity().equal(torch::tensor({1, -1, -1}, torch::kInt8)));
  CHECK(recording.triggers.rising_us == std::vector<int64_t>{110});
  CHECK(recording.triggers.falling_us == std::vector<int64_t>{150});
  CHECK_THAT(recording.warnings.at(0), test::naming("sorted"));
  CHECK_THAT(recording.warnings.at(1), test::naming("1 of 4 events", "1280x720"));
  ReadOptions options;
  options.most_events = 2;
  const Recording first = read_recording(dir / "a.hdf5", options);
  CHECK(first.events.t_us().equal(torch::tensor({100, 300}, torch::kInt64)));
  CHECK(first.stored_events == 4);
  CHECK(first.stored_us.end_us == 401);
}

TEST_CASE("recording: Metavision's compression, damaged, is one line", "[recording]") {
  const TempDir dir;
  const hid_t file = H5Fcreate((dir / "a.hdf5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  write_records(file, "CD", event_type(), nullptr, 3, true);
  H5Fclose(file);
  CHECK_THROWS_NAMING(DataError, read_recording(dir / "a.hdf5"), "'CD/events'", "damaged");
}

TEST_CASE("recording: records of another kind are refused", "[recording]") {
  const TempDir dir;
  const hid_t file = H5Fcreate((dir / "a.hdf5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const std::vector<TriggerRecord> triggers{{1, 110, 0}};
  write_records(file, "CD", trigger_type(), triggers.data(), triggers.size());
  H5Fclose(file);
  CHECK_THROWS_NAMING(DataError, read_recording(dir / "a.hdf5"), "'CD/events'", "'x'");
}
