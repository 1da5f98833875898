// SPDX-License-Identifier: Apache-2.0
// Words of Prophesee's encodings, by their public specification.
#pragma once

#include <cstdint>
#include <string>

namespace jade::test {

/// A value as bytes, the lowest first.
inline std::string bytes_of(uint64_t word, int count) {
  std::string out;
  for (int i = 0; i < count; ++i) out += char(word >> (8 * i) & 0xff);
  return out;
}

inline std::string evt_header(const std::string& version, const std::string& more = "") {
  return "% Date 2026-01-01 00:00:00\n% evt " + version + "\n" + more + "% end\n";
}

// EVT 2.0: 32 bits. Times are in µs.
inline uint32_t evt2_event(int64_t t, int x, int y, bool on) {
  return uint32_t(on ? 1U << 28 : 0U) | uint32_t(t & 63) << 22 | uint32_t(x) << 11 | uint32_t(y);
}
inline uint32_t evt2_time(int64_t t) { return 8U << 28 | uint32_t(t >> 6 & 0xfffffff); }
inline uint32_t evt2_trigger(int64_t t, bool rising) {
  return 10U << 28 | uint32_t(t & 63) << 22 | 3U << 8 | uint32_t(rising);
}

/// EVT 2.1: the 32 bits above, with x of the first pixel, and a mask of 32 pixels. IMX636 writes
/// the half with the type first.
inline std::string evt21_word(uint32_t upper, uint32_t lower, bool upper_first) {
  return upper_first ? bytes_of(upper, 4) + bytes_of(lower, 4)
                     : bytes_of(lower, 4) + bytes_of(upper, 4);
}

// EVT 3.0: 16 bits, a type and 12 bits of value.
inline std::string evt3_word(int type, int value) {
  return bytes_of(uint64_t(type << 12 | value), 2);
}
inline std::string evt3_time(int64_t t) {
  return evt3_word(8, int(t >> 12 & 0xfff)) + evt3_word(6, int(t & 0xfff));
}

}  // namespace jade::test
