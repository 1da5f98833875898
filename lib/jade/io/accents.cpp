// SPDX-License-Identifier: Apache-2.0
#include "jade/io/accents.h"

#include <algorithm>
#include <vector>

namespace jade::io {
namespace {

namespace fs = std::filesystem;

bool is_ascii(const std::string& text) {
  return std::all_of(text.begin(), text.end(),
                     [](char letter) { return static_cast<unsigned char>(letter) < 0x80; });
}

/// Appends a syllable of Hangul as its parts, other letters as they are.
void append(uint32_t letter, std::vector<uint32_t>& out) {
  constexpr uint32_t kFirst = 0xAC00, kLast = 0xD7A3, kVowels = 21, kTails = 28;
  if (letter < kFirst || letter > kLast) return out.push_back(letter);
  const uint32_t index = letter - kFirst;
  out.push_back(0x1100 + index / (kVowels * kTails));
  out.push_back(0x1161 + index % (kVowels * kTails) / kTails);
  if (index % kTails != 0) out.push_back(0x11A7 + index % kTails);
}

/// Code points of a text in UTF-8; bytes that are none stay as they are.
std::vector<uint32_t> letters_of(const std::string& text) {
  std::vector<uint32_t> out;
  for (size_t i = 0; i < text.size();) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const size_t size = byte >= 0xF0 ? 4 : byte >= 0xE0 ? 3 : byte >= 0xC0 ? 2 : 1;
    uint32_t letter = size == 1 ? byte : byte & (0x7FU >> size);
    for (size_t k = 1; k < size && i + k < text.size(); ++k)
      letter = letter << 6 | (static_cast<unsigned char>(text[i + k]) & 0x3FU);
    append(letter, out);
    i += size;
  }
  return out;
}

bool is_mark(uint32_t letter) {
  return (letter >= 0x300 && letter <= 0x36F) || letter == 0x3099 || letter == 0x309A;
}

/// Number of marks of `letter` if it may be the letters at `text` and their marks, else 0.
size_t marks_of(uint32_t letter, const uint32_t* text, const uint32_t* end) {
  // Bases of the letters from U+00C0 to U+017F, and their marks: 'a' is U+0300.
  constexpr char kBases[] =
      "AAAAAA?CEEEEIIII?NOOOOO??UUUUY??aaaaaa?ceeeeiiii?nooooo??uuuuy?y"
      "AaAaAaCcCcCcCcDd??EeEeEeEeEeGgGgGgGgHh??IiIiIiIiI???JjKk?LlLlLl?"
      "???NnNnNn???OoOoOo??RrRrRrSsSsSsSsTtTt??UuUuUuUuUuUuWwYyYZzZzZz?";
  constexpr char kPlaces[] =
      "abcdik?yabciabci?dabcdi??abcib??abcdik?yabciabci?dabcdi??abcib?i"
      "eeggzzbbcchhmmmm??eegghhzzmmccgghhyycc??ddeeggzzh???ccyy?bbyymm?"
      "???bbyymm???eeggll??bbyymmbbccyymmyymm??ddeeggkkllzzccccibbhhmm?";
  constexpr uint32_t kFirst = 0xC0, kLast = 0x17F, kCedilla = 0x327, kOgonek = 0x328;
  const auto count = static_cast<size_t>(std::find_if_not(text + 1, end, is_mark) - (text + 1));
  if (letter < kFirst || is_mark(letter) || count == 0) return 0;
  if (letter > kLast) return count;
  const char place = kPlaces[letter - kFirst];
  const uint32_t mark = place == 'y'   ? kCedilla
                        : place == 'z' ? kOgonek
                                       : 0x300 + uint32_t(place - 'a');
  return uint32_t(kBases[letter - kFirst]) == text[0] && mark == text[1] ? 1 : 0;
}

}  // namespace

bool same_but_accents(const std::string& a, const std::string& b) {
  if (a == b) return true;
  const std::vector<uint32_t> left = letters_of(a), right = letters_of(b);
  size_t i = 0, j = 0;
  // Skips a base with its marks in `text` if they may be `letter`.
  const auto skips = [](const std::vector<uint32_t>& text, size_t& at, uint32_t letter) {
    const size_t marks = marks_of(letter, text.data() + at, text.data() + text.size());
    if (marks > 0) at += 1 + marks;
    return marks > 0;
  };
  while (i < left.size() && j < right.size()) {
    if (left[i] == right[j]) {
      ++i, ++j;
    } else if (skips(left, i, right[j])) {
      ++j;
    } else if (skips(right, j, left[i])) {
      ++i;
    } else {
      return false;
    }
  }
  return i == left.size() && j == right.size();
}

fs::path respelled(const fs::path& path) {
  if (is_ascii(path.string())) return {};
  fs::path place;
  for (const fs::path& part : path) {
    std::error_code error;
    if (is_ascii(part.string()) || fs::exists(place / part, error)) {
      place /= part;
      continue;
    }
    std::vector<fs::path> found;
    for (fs::directory_iterator entry(place.empty() ? "." : place, error), end;
         !error && entry != end; entry.increment(error)) {
      const std::string name = entry->path().filename().string();
      if (same_but_accents(name, part.string())) found.push_back(name);
    }
    if (found.size() != 1) return {};
    place /= found.front();
  }
  std::error_code error;
  return fs::exists(place, error) ? place : fs::path();
}

}  // namespace jade::io
