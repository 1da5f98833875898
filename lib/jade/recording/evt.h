// SPDX-License-Identifier: Apache-2.0
// Prophesee's raw streams EVT 2.0, 2.1 and 3.0 (docs.prophesee.ai, "Data Encoding Formats").
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "jade/core/words.h"
#include "jade/recording/exposures.h"

namespace jade::recording {

enum class EvtVersion { kEvt2, kEvt21, kEvt3 };

constexpr auto words_of(EvtVersion) {
  return std::array{Word{"EVT2", EvtVersion::kEvt2}, Word{"EVT2.1", EvtVersion::kEvt21},
                    Word{"EVT3", EvtVersion::kEvt3}};
}

/// The header lines of a file, which begin with '%'.
struct EvtHeader {
  EvtVersion version = EvtVersion::kEvt3;        ///< that of the data
  EvtVersion named_version = EvtVersion::kEvt3;  ///< that of the header
  int64_t width = 0, height = 0;                 ///< 0: unknown
  int64_t bytes = 0;                             ///< size of the header
  std::map<std::string, std::string> fields;
};

/// Events as decoded, in the order of the file, four lists of one length.
struct EvtEvents {
  std::vector<uint16_t> x, y;
  std::vector<int64_t> t_us;     ///< by the sensor's clock, unwrapped
  std::vector<int8_t> polarity;  ///< ±1

  size_t size() const { return t_us.size(); }
  void clear();
};

/// Counts of what a decoder has read.
struct EvtCounts {
  int64_t outside = 0;      ///< events outside the sensor, dropped
  int64_t before_time = 0;  ///< events before the first full time stamp, dropped
  int64_t backwards = 0;    ///< events earlier than their predecessor, kept
  int64_t unknown = 0;      ///< words of unknown type, skipped
  int64_t astray = 0;     ///< damaged times, up to four, after which the counter goes on as before
  int64_t cut_bytes = 0;  ///< bytes of an incomplete word at the end of the file
};

/// Decodes a file in pieces, with memory independent of its length: 1 MiB of the file and the
/// events that next() requests, plus at most 31.
class EvtDecoder {
 public:
  /// Reads the header.
  /// @throws DataError for a file that is missing, has no such header, or has another encoding
  ///   (EVT4, histograms).
  explicit EvtDecoder(const std::filesystem::path& path);

  const EvtHeader& header() const { return header_; }

  /// Decodes up to `max_events` events (a vector is not split) into `out`, replacing its content.
  /// False at the end of the file, if nothing was decoded.
  bool next(int64_t max_events, EvtEvents& out);

  /// Trigger edges so far, by channel (0: the connector, 6: loop-back, …).
  const std::map<int64_t, Triggers>& triggers() const { return triggers_; }
  const EvtCounts& counts() const { return counts_; }
  /// Decoded share of the file, 0 to 1.
  double progress() const;

 private:
  bool refill();
  void choose_version();
  void choose_order();
  /// Decodes a word of EVT2, or the half of an EVT2.1 word that contains its type.
  /// @param events  called with x, y and polarity of a word of events
  template <class Events>
  void decode_word(uint32_t word, const Events& events);
  void decode_evt2(int64_t max_events, EvtEvents& out);
  void decode_evt21(int64_t max_events, EvtEvents& out);
  void decode_evt3(int64_t max_events, EvtEvents& out);
  size_t damaged_before(int64_t high_us, int64_t range_us) const;
  void set_time_high(int64_t value, int bits, int shift);
  void add_event(int64_t x, int64_t y, bool on, EvtEvents& out);
  void add_trigger(int64_t channel, bool rising);

  std::filesystem::path path_;
  std::ifstream file_;
  int64_t file_bytes_ = 0, read_bytes_ = 0;
  EvtHeader header_;
  std::vector<uint8_t> buffer_;
  size_t at_ = 0, end_ = 0;
  bool header_word_first_ = false;  // EVT 2.1 of IMX636: upper half first
  std::map<int64_t, Triggers> triggers_;
  EvtCounts counts_;
  // State of the stream.
  bool has_time_ = false;
  static constexpr size_t kMostDamaged = 4;
  struct HighTime {
    int64_t high_us = 0, wrap_us = 0;
  };
  std::array<HighTime, kMostDamaged + 1> past_{};  // last values of the counter, the latest first
  size_t past_count_ = 0;
  int64_t near_steps_ = 0, far_steps_ = 0;  // of the counter
  int64_t high_us_ = 0, wrap_us_ = 0, time_us_ = 0, latest_us_ = INT64_MIN;
  int64_t row_ = 0, base_x_ = 0;
  bool base_on_ = false;
};

}  // namespace jade::recording
