// SPDX-License-Identifier: Apache-2.0
#include "jade/io/ecf.h"

#include <algorithm>
#include <cstring>
#include <hdf5.h>

namespace jade::io {
namespace {

/// Reads consecutive little-endian numbers. Beyond the end they are 0 and `good` is false.
class Bytes {
 public:
  Bytes(const uint8_t* begin, size_t size) : at_(begin), end_(begin + size) {}
  bool good() const { return good_; }
  uint64_t next(int bytes) {
    if (end_ - at_ < bytes) {
      good_ = false;
      return 0;
    }
    uint64_t value = 0;
    for (int i = 0; i < bytes; ++i) value |= uint64_t(at_[i]) << (8 * i);
    at_ += bytes;
    return value;
  }
  uint8_t peek() const { return at_ < end_ ? *at_ : 0; }

 private:
  const uint8_t* at_;
  const uint8_t* end_;
  bool good_ = true;
};

/// Assigns a value to the next `count` events. @return false if there are fewer
template <class Set>
bool repeat(std::vector<EcfEvent>& out, size_t* i, size_t count, Set set) {
  if (count > out.size() - *i) return false;
  for (const size_t end = *i + count; *i < end; ++*i) set(out[*i]);
  return true;
}

bool decode_times(Bytes& in, std::vector<EcfEvent>& out) {
  uint64_t t = in.next(8);
  for (size_t i = 0; i < out.size() && in.good();) {
    const uint64_t entry = in.next(1);
    uint64_t count = entry & 15;
    if (entry >> 4 == 15) {
      uint64_t step = count;
      for (int part = 1; in.peek() >> 4 == 15 && part < 16; ++part)
        step |= (in.next(1) & 15) << (4 * part);
      t += step;
      continue;
    }
    t += entry >> 4;
    if (count == 15) count = in.next(2);
    if (!repeat(out, &i, count, [t](EcfEvent& e) { e.t = int64_t(t); })) return false;
  }
  return in.good();
}

bool decode_rows(Bytes& in, std::vector<EcfEvent>& out) {
  for (size_t i = 0; i < out.size() && in.good();) {
    const uint64_t entry = in.next(2);
    const uint64_t count = (entry & 31) == 31 ? in.next(2) : entry & 31;
    if (!repeat(out, &i, count, [entry](EcfEvent& e) { e.y = uint16_t(entry >> 5); })) return false;
  }
  return in.good();
}

bool decode_columns(Bytes& in, std::vector<EcfEvent>& out) {
  for (size_t i = 0; i < out.size() && in.good();) {
    const uint64_t entry = in.next(2);
    out[i++].x = uint16_t(entry >> 5);
    // Mask bits beyond the last event are left over from the encoder's buffer.
    for (uint64_t further = 1; further <= 5 && i < out.size(); ++further) {
      if ((entry >> (5 - further)) & 1) out[i++].x = uint16_t((entry >> 5) + further);
    }
  }
  return in.good();
}

bool decode_polarities(Bytes& in, std::vector<EcfEvent>& out) {
  for (size_t i = 0; i < out.size() && in.good();) {
    const uint64_t entry = in.next(1);
    const uint64_t count = (entry & 127) == 127 ? in.next(2) : entry & 127;
    if (!repeat(out, &i, count, [entry](EcfEvent& e) { e.p = int16_t(entry >> 7); })) return false;
  }
  return in.good();
}

/// Unpacks four numbers of 6·`unit` bits from three of 8·`unit`, with a unit of 2 or 4 bytes: the
/// second is in the ends of the first two, the third in those of the last two.
template <class Set>
bool decode_packed(Bytes& in, std::vector<EcfEvent>& out, int unit, Set set) {
  const int part = 2 * unit;  // bits
  const uint64_t low = (uint64_t(1) << part) - 1, low2 = (uint64_t(1) << (2 * part)) - 1,
                 low3 = (uint64_t(1) << (3 * part)) - 1;
  for (size_t i = 0; i < out.size() && in.good(); i += 4) {
    const uint64_t a = in.next(unit), b = in.next(unit), c = in.next(unit);
    const uint64_t values[] = {a >> part, (a & low) | (b >> (2 * part)) << part,
                               (b & low2) | (c >> (3 * part)) << (2 * part), c & low3};
    for (size_t j = 0; j < 4 && i + j < out.size(); ++j) set(values[j], out[i + j]);
  }
  return in.good();
}

/// HDF5 filter callback. @return bytes, 0 on failure
size_t filter(unsigned flags, size_t, const unsigned*, size_t size, size_t* buffer_size,
              void** buffer) {
  if ((flags & H5Z_FLAG_REVERSE) == 0) return 0;
  std::vector<EcfEvent> events;
  if (!decode_ecf(static_cast<const uint8_t*>(*buffer), size, events)) return 0;
  // HDF5 reads a whole chunk, however many events there are.
  const size_t bytes = size_t(kEcfChunk) * sizeof(EcfEvent);
  void* out = H5allocate_memory(bytes, true);
  if (out == nullptr) return 0;
  std::memcpy(out, events.data(), events.size() * sizeof(EcfEvent));
  H5free_memory(*buffer);
  *buffer = out;
  *buffer_size = bytes;
  return bytes;
}

}  // namespace

bool decode_ecf(const uint8_t* bytes, size_t size, std::vector<EcfEvent>& out) {
  Bytes in(bytes, size);
  const uint64_t header = in.next(4);
  if (!in.good() || header >> 2 > uint64_t(kEcfChunk)) return false;
  out.assign(header >> 2, {});
  if (out.empty()) return true;
  if (!decode_times(in, out)) return false;
  if (header & 2) {
    return decode_packed(in, out, 4, [](uint64_t value, EcfEvent& e) {
      e.y = uint16_t(value >> 12 & 2047);
      e.x = uint16_t(value >> 1 & 2047);
      e.p = int16_t(value & 1);
    });
  }
  if (!decode_rows(in, out)) return false;
  if (header & 1) {
    return decode_packed(in, out, 2, [](uint64_t value, EcfEvent& e) {
      e.x = uint16_t(value >> 1);
      e.p = int16_t(value & 1);
    });
  }
  return decode_columns(in, out) && decode_polarities(in, out);
}

void register_ecf() {
  static_assert(sizeof(EcfEvent) == 16);
  static const H5Z_class2_t description{H5Z_CLASS_T_VERS,    kEcfFilter, 0,       1,
                                        "ECF of Metavision", nullptr,    nullptr, filter};
  if (H5Zfilter_avail(kEcfFilter) <= 0) H5Zregister(&description);
}

}  // namespace jade::io
