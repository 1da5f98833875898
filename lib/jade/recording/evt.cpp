// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/evt.h"

#include <algorithm>
#include <cstring>
#include <sstream>

#include "jade/core/error.h"

namespace jade::recording {
namespace {

namespace fs = std::filesystem;

constexpr size_t kBufferBytes = size_t(1) << 20;
constexpr int64_t kLongestHeader = 1 << 16;
constexpr int64_t kLargestSensor = 2048;  // 11 bits per coordinate
constexpr int64_t kNear = 16;             // part of a time counter's range

/// Word types of EVT 2.0 and 2.1: the four highest bits.
enum class Evt2Type : uint32_t {
  kOff = 0x0,
  kOn = 0x1,
  kTimeHigh = 0x8,
  kTrigger = 0xA,
  kOthers = 0xE,
  kContinued = 0xF
};

/// Word types of EVT 3.0.
enum class Evt3Type : uint32_t {
  kRow = 0x0,
  kEvent = 0x2,
  kVectorBase = 0x3,
  kVector12 = 0x4,
  kVector8 = 0x5,
  kTimeLow = 0x6,
  kContinued4 = 0x7,
  kTimeHigh = 0x8,
  kTrigger = 0xA,
  kOthers = 0xE,
  kContinued12 = 0xF
};

template <class T>
T word_at(const uint8_t* bytes) {
  T word = 0;
  for (size_t i = 0; i < sizeof(T); ++i) word = T(word | T(T(bytes[i]) << (8 * i)));
  return word;
}

constexpr uint32_t bits(uint64_t word, int low, int count) {
  return uint32_t((word >> low) & ((uint64_t(1) << count) - 1));
}

size_t word_bytes(EvtVersion version) {
  return version == EvtVersion::kEvt2 ? 4 : version == EvtVersion::kEvt21 ? 8 : 2;
}

/// "1280x720", from "% geometry".
void parse_geometry(const std::string& text, EvtHeader& header) {
  char x = 0;
  int64_t width = 0, height = 0;
  std::istringstream in(text);
  if (in >> width >> x >> height && x == 'x') header.width = width, header.height = height;
}

/// "EVT3;height=720;width=1280", from "% format". Returns its first part.
std::string parse_format(const std::string& text, EvtHeader& header) {
  std::istringstream in(text);
  std::string first;
  std::getline(in, first, ';');
  for (std::string part; std::getline(in, part, ';');) {
    const auto equals = part.find('=');
    if (equals == std::string::npos) continue;
    const std::string key = part.substr(0, equals), value = part.substr(equals + 1);
    header.fields["format." + key] = value;
    std::istringstream number(value);
    if (key == "width") number >> header.width;
    if (key == "height") number >> header.height;
  }
  return first;
}

EvtVersion version_of(const fs::path& path, const std::string& evt, const std::string& format) {
  if (format == "EVT3" || (format.empty() && evt == "3.0")) return EvtVersion::kEvt3;
  if (format == "EVT21" || (format.empty() && evt == "2.1")) return EvtVersion::kEvt21;
  if (format == "EVT2" || (format.empty() && evt == "2.0")) return EvtVersion::kEvt2;
  throw DataError(concat(path.string(),
                         ": expected the encoding EVT2, EVT2.1 or EVT3 in its header, ", "found ",
                         format.empty() ? evt.empty() ? "none" : evt : format,
                         "; convert it to HDF5 with metavision_file_to_hdf5"));
}

/// Without an end line, the first word of the stream may begin with the byte of '%' too.
bool starts_header_line(std::ifstream& file) {
  const auto at = file.tellg();
  char two[2] = {};
  const bool whole = bool(file.read(two, 2));
  file.clear();
  file.seekg(at);
  return whole && two[0] == '%' && two[1] == ' ';
}

EvtHeader read_header(const fs::path& path, std::ifstream& file) {
  EvtHeader header;
  std::string format;
  while (header.bytes < kLongestHeader && starts_header_line(file)) {
    std::string line;
    std::getline(file, line);
    header.bytes += int64_t(line.size()) + 1;
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::istringstream words(line);
    std::string mark, key, value;
    words >> mark >> key;
    std::getline(words >> std::ws, value);
    if (key == "end") break;
    header.fields[key] = value;
    if (key == "format") format = parse_format(value, header);
    if (key == "geometry") parse_geometry(value, header);
  }
  if (header.bytes == 0) {
    throw DataError(concat(path.string(),
                           ": expected a Prophesee header of lines that begin with "
                           "'%', found none; record or export it again"));
  }
  header.version = version_of(path, header.fields["evt"], format);
  if (header.width < 0 || header.height < 0 || header.width > 65536 || header.height > 65536) {
    throw DataError(concat(path.string(), ": expected the size of a sensor in its header, found ",
                           header.width, "x", header.height, "; record or export it again"));
  }
  return header;
}

bool is_known_evt2(uint32_t word) {
  switch (Evt2Type(bits(word, 28, 4))) {
    case Evt2Type::kOff:
    case Evt2Type::kOn:
    case Evt2Type::kTimeHigh:
    case Evt2Type::kTrigger:
    case Evt2Type::kOthers:
    case Evt2Type::kContinued:
      return true;
  }
  return false;
}

bool is_known_evt3(uint32_t word) {
  const uint32_t type = bits(word, 12, 4);
  return type <= uint32_t(Evt3Type::kTimeHigh) ? type != 1 : is_known_evt2(word << 16) && type != 9;
}

/// A count of words, and of those that an encoding cannot have.
struct Misfit {
  int64_t words = 0, wrong = 0;
  bool is_none() const { return 200 * wrong <= words; }
  bool is_large() const { return wrong >= 20 && 100 * wrong > words; }
};

/// Words of one half of EVT 2.1, or of EVT 2.0, that cannot be: of unknown type, and times that
/// fall. In EVT 2.1 the other half of a time is empty, and if it is not, vectors that do not begin
/// at a multiple of 32 count too.
/// @param step  bytes from word to word
Misfit misfit_of_words(const uint8_t* data, size_t first, size_t step, size_t size) {
  Misfit out;
  int64_t times = 0, full = 0, odd = 0;
  uint32_t latest = 0;
  for (size_t i = first; i - first + step <= size; i += step, ++out.words) {
    const auto word = word_at<uint32_t>(data + i);
    const uint32_t type = bits(word, 28, 4), time = bits(word, 0, 28);
    out.wrong += !is_known_evt2(word);
    odd += type <= uint32_t(Evt2Type::kOn) && bits(word, 11, 5) != 0;
    if (type != uint32_t(Evt2Type::kTimeHigh)) continue;
    ++times;
    full += step == 8 && word_at<uint32_t>(data + (i ^ 4)) != 0;
    out.wrong += time < latest;
    latest = time;
  }
  if (times == 0) out.wrong = out.words;
  if (2 * full > times) out.wrong += full + odd;
  return out;
}

/// The words of a stream that this version cannot have.
Misfit misfit_of(EvtVersion version, const uint8_t* data, size_t size) {
  if (version == EvtVersion::kEvt2) return misfit_of_words(data, 0, 4, size);
  if (version == EvtVersion::kEvt21) {
    const Misfit first = misfit_of_words(data, 0, 8, size);
    const Misfit last = misfit_of_words(data, 4, 8, size);
    return first.wrong < last.wrong ? first : last;
  }
  Misfit out;
  for (size_t i = 0; i + 2 <= size; i += 2, ++out.words)
    out.wrong += !is_known_evt3(word_at<uint16_t>(data + i));
  return out;
}

}  // namespace

void EvtEvents::clear() { x.clear(), y.clear(), t_us.clear(), polarity.clear(); }

EvtDecoder::EvtDecoder(const fs::path& path) : path_(path), file_(path, std::ios::binary) {
  std::error_code error;
  file_bytes_ = int64_t(fs::file_size(path, error));
  if (error || !file_)
    throw DataError(concat(path.string(), ": no such file, or it cannot be read"));
  header_ = read_header(path, file_);
  file_.clear();
  file_.seekg(header_.bytes);
  read_bytes_ = header_.bytes;
  buffer_.resize(kBufferBytes);
  refill();
  choose_version();
  if (header_.version == EvtVersion::kEvt21) choose_order();
}

double EvtDecoder::progress() const {
  return file_bytes_ == 0 ? 1 : double(read_bytes_ - int64_t(end_ - at_)) / double(file_bytes_);
}

/// Moves the remaining bytes to the front and reads more. False if less than a word remains.
bool EvtDecoder::refill() {
  const size_t left = end_ - at_, word = word_bytes(header_.version);
  if (left >= word) return true;
  std::memmove(buffer_.data(), buffer_.data() + at_, left);
  file_.read(reinterpret_cast<char*>(buffer_.data() + left), std::streamsize(kBufferBytes - left));
  const auto count = std::max<std::streamsize>(file_.gcount(), 0);
  read_bytes_ += count;
  at_ = 0, end_ = left + size_t(count);
  if (end_ >= word) return true;
  counts_.cut_bytes = int64_t(end_);
  return false;
}

/// Headers that other programs write may name another version than that of the data.
void EvtDecoder::choose_version() {
  const auto misfit = [&](EvtVersion version) {
    return misfit_of(version, &buffer_[at_], end_ - at_);
  };
  header_.named_version = header_.version;
  if (!misfit(header_.version).is_large()) return;
  for (const EvtVersion other : {EvtVersion::kEvt3, EvtVersion::kEvt2, EvtVersion::kEvt21}) {
    if (!misfit(other).is_none()) continue;
    header_.version = other;
    return;
  }
}

/// GenX320 writes 64-bit words little-endian; IMX636 writes their upper half first. The type is in
/// the upper half: choose the order with more valid types.
void EvtDecoder::choose_order() {
  // In the wrong half, a vector's mask contains any type; times and empty bits contain few.
  int64_t upper_first = 0, upper_last = 0;
  for (size_t i = at_; i + 8 <= end_; i += 8) {
    const auto first = word_at<uint32_t>(&buffer_[i]), last = word_at<uint32_t>(&buffer_[i + 4]);
    upper_first += is_known_evt2(first), upper_last += is_known_evt2(last);
    // The other half of a time word is unused.
    if (bits(first, 28, 4) == uint32_t(Evt2Type::kTimeHigh) && last == 0) ++upper_first;
    if (bits(last, 28, 4) == uint32_t(Evt2Type::kTimeHigh) && first == 0) ++upper_last;
  }
  header_word_first_ = upper_first > upper_last;
}

/// Number of damaged values before this one, at most kMostDamaged: it lies shortly after a value
/// before these. 0 if no wrap depends on them. Several damaged values include no plausible wrap,
/// unless another step is too long. A stream with many long steps has pauses, not several damaged
/// values.
size_t EvtDecoder::damaged_before(int64_t high_us, int64_t range_us) const {
  const auto follows = [&](int64_t from, int64_t to) {
    return to >= from && to - from <= range_us / kNear;
  };
  const auto has_steady_time = [&] { return 4 * far_steps_ <= near_steps_; };
  const auto wraps = [&](int64_t from, int64_t to) {
    return from - to > range_us / 2 && follows(from, to + range_us);
  };
  int64_t next_us = high_us;
  bool has_wrap = false, has_leap = false;
  for (size_t i = 0; i < past_count_; next_us = past_[i++].high_us) {
    has_wrap |= wraps(past_[i].high_us, next_us);
    has_leap |= next_us - past_[i].high_us > range_us / 2;
    if (i > 1 && ((has_wrap && !has_leap) || !has_steady_time())) return 0;
    if (!follows(past_[i].high_us, high_us)) continue;
    const bool fell = high_us_ - high_us > range_us / 2;
    return fell || past_[i].wrap_us != wrap_us_ ? i : 0;
  }
  return 0;
}

/// The counter of `count` bits counts steps of 2^shift µs; a decrease by more than half of its
/// range is a wrap, unless values are damaged: then a later one is near that before them.
void EvtDecoder::set_time_high(int64_t value, int count, int shift) {
  const int64_t high = value << shift, range = int64_t(1) << (count + shift);
  if (has_time_ && high == high_us_) return;
  const size_t damaged = damaged_before(high, range);
  const bool fell = has_time_ && high_us_ - high > range / 2;
  const int64_t step = high - high_us_ + (fell ? range : 0);
  if (has_time_) ++(step >= 0 && step <= range / kNear ? near_steps_ : far_steps_);
  const int64_t wrap = damaged > 0 ? past_[damaged].wrap_us : wrap_us_ + (fell ? range : 0);
  counts_.astray += int64_t(damaged);
  high_us_ = high, wrap_us_ = wrap;
  time_us_ = wrap_us_ + high_us_;
  has_time_ = true;
  std::copy_backward(past_.begin(), past_.end() - 1, past_.end());
  past_[0] = {high_us_, wrap_us_};
  past_count_ = std::min(past_count_ + 1, past_.size());
}

void EvtDecoder::add_event(int64_t x, int64_t y, bool on, EvtEvents& out) {
  if (!has_time_) {
    ++counts_.before_time;
    return;
  }
  if (x >= (header_.width > 0 ? header_.width : kLargestSensor) ||
      y >= (header_.height > 0 ? header_.height : kLargestSensor)) {
    ++counts_.outside;
    return;
  }
  if (time_us_ < latest_us_) ++counts_.backwards;
  latest_us_ = time_us_;
  out.x.push_back(uint16_t(x));
  out.y.push_back(uint16_t(y));
  out.t_us.push_back(time_us_);
  out.polarity.push_back(on ? 1 : -1);
}

void EvtDecoder::add_trigger(int64_t channel, bool rising) {
  if (!has_time_) return;
  Triggers& edges = triggers_[channel];
  (rising ? edges.rising_us : edges.falling_us).push_back(time_us_);
}

bool EvtDecoder::next(int64_t max_events, EvtEvents& out) {
  out.clear();
  while (int64_t(out.size()) < max_events && refill()) {
    switch (header_.version) {
      case EvtVersion::kEvt2:
        decode_evt2(max_events, out);
        break;
      case EvtVersion::kEvt21:
        decode_evt21(max_events, out);
        break;
      case EvtVersion::kEvt3:
        decode_evt3(max_events, out);
        break;
    }
  }
  return out.size() > 0;
}

template <class Events>
void EvtDecoder::decode_word(uint32_t word, const Events& events) {
  const auto type = Evt2Type(bits(word, 28, 4));
  switch (type) {
    case Evt2Type::kOff:
    case Evt2Type::kOn:
      time_us_ = wrap_us_ + high_us_ + bits(word, 22, 6);
      events(int64_t(bits(word, 11, 11)), int64_t(bits(word, 0, 11)), type == Evt2Type::kOn);
      break;
    case Evt2Type::kTimeHigh:
      set_time_high(bits(word, 0, 28), 28, 6);
      break;
    case Evt2Type::kTrigger:
      time_us_ = wrap_us_ + high_us_ + bits(word, 22, 6);
      add_trigger(bits(word, 8, 5), bits(word, 0, 1) != 0);
      break;
    case Evt2Type::kOthers:
    case Evt2Type::kContinued:
      break;
    default:
      ++counts_.unknown;
  }
}

void EvtDecoder::decode_evt2(int64_t max_events, EvtEvents& out) {
  for (; at_ + 4 <= end_ && int64_t(out.size()) < max_events; at_ += 4) {
    decode_word(word_at<uint32_t>(&buffer_[at_]),
                [&](int64_t x, int64_t y, bool on) { add_event(x, y, on, out); });
  }
}

void EvtDecoder::decode_evt21(int64_t max_events, EvtEvents& out) {
  for (; at_ + 8 <= end_ && int64_t(out.size()) < max_events; at_ += 8) {
    const auto first = word_at<uint32_t>(&buffer_[at_]),
               last = word_at<uint32_t>(&buffer_[at_ + 4]);
    const uint32_t valid = header_word_first_ ? last : first;
    decode_word(header_word_first_ ? first : last, [&](int64_t x, int64_t y, bool on) {
      for (int i = 0; i < 32; ++i) {
        if (valid >> i & 1) add_event(x + i, y, on, out);
      }
    });
  }
}

void EvtDecoder::decode_evt3(int64_t max_events, EvtEvents& out) {
  const auto vector = [&](uint32_t valid, int length) {
    for (int i = 0; i < length; ++i) {
      if (valid >> i & 1) add_event(base_x_ + i, row_, base_on_, out);
    }
    base_x_ += length;
  };
  for (; at_ + 2 <= end_ && int64_t(out.size()) < max_events; at_ += 2) {
    const auto word = word_at<uint16_t>(&buffer_[at_]);
    switch (Evt3Type(bits(word, 12, 4))) {
      case Evt3Type::kRow:
        row_ = bits(word, 0, 11);
        break;
      case Evt3Type::kEvent:
        add_event(bits(word, 0, 11), row_, bits(word, 11, 1) != 0, out);
        break;
      case Evt3Type::kVectorBase:
        base_x_ = bits(word, 0, 11), base_on_ = bits(word, 11, 1) != 0;
        break;
      case Evt3Type::kVector12:
        vector(bits(word, 0, 12), 12);
        break;
      case Evt3Type::kVector8:
        vector(bits(word, 0, 8), 8);
        break;
      case Evt3Type::kTimeLow:
        time_us_ = wrap_us_ + high_us_ + bits(word, 0, 12);
        break;
      case Evt3Type::kTimeHigh:
        set_time_high(bits(word, 0, 12), 12, 12);
        break;
      case Evt3Type::kTrigger:
        add_trigger(bits(word, 8, 4), bits(word, 0, 1) != 0);
        break;
      case Evt3Type::kContinued4:
      case Evt3Type::kOthers:
      case Evt3Type::kContinued12:
        break;
      default:
        ++counts_.unknown;
    }
  }
}

}  // namespace jade::recording
