// SPDX-License-Identifier: Apache-2.0
// Metavision's compression of event records in HDF5 files (ECF, HDF5 filter 36559).
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace jade::io {

inline constexpr int kEcfFilter = 36559;
/// Maximum number of events per chunk.
inline constexpr int64_t kEcfChunk = 65535;

/// A record as stored: 16 bytes.
struct EcfEvent {
  uint16_t x = 0, y = 0;
  int16_t p = 0;  ///< 1: brighter, 0: darker
  int64_t t = 0;  ///< µs
};

/// Decodes one chunk, whose numbers are little-endian:
///   4 bytes   the number of events · 4 + 2 · (all packed) + (columns and polarities packed)
///   times     8 bytes for the first, then bytes (step, number of events): 4 bits each. 15 events:
///             their number follows in 2 bytes. Step 15: the other 4 bits are a part of a larger
///             step, lowest first, and the byte after the last part begins the next entry. If all
///             are packed, 4 events follow in 3 numbers of 4 bytes: row, column and polarity in 12,
///             11 and 1 bits. Otherwise:
///   rows      2 bytes (row, number of events): 11 and 5 bits; 31 events: their number follows If
///   columns and polarities are packed, 4 events follow in 3 numbers of 2 bytes: 11 and 1 bits.
///   Otherwise:
///   columns      2 bytes (column, mask): 11 and 5 bits; each bit of the mask, from its top, is an
///                event 1 to 5 columns further
///   polarities   bytes (polarity, number of events): 1 and 7 bits; 127: their number follows
/// @return false if the bytes end early or count more events than there are
bool decode_ecf(const uint8_t* bytes, size_t size, std::vector<EcfEvent>& out);

/// Registers the decoder with the HDF5 library. Decoded chunks are at least kEcfChunk events long,
/// so chunks of a data set must not be longer.
void register_ecf();

}  // namespace jade::io
