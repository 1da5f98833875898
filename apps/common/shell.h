// SPDX-License-Identifier: Apache-2.0
// Commands that a program prints for its user to run.
#pragma once

#include <filesystem>
#include <string>

namespace jade::apps {

/// `path` as one word of a command line, quoted if a shell would split it.
inline std::string shell_word(const std::filesystem::path& path) {
  const std::string text = path.string();
  constexpr char kPlain[] =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./+=:,@%";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) return text;
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

/// `output`, or another name if a command may not write there because it reads `input`.
inline std::filesystem::path folder_apart(const std::filesystem::path& output,
                                          const std::filesystem::path& input) {
  const bool is_input =
      std::filesystem::weakly_canonical(output) == std::filesystem::weakly_canonical(input);
  return is_input ? std::filesystem::path(output.string() + "-out") : output;
}

}  // namespace jade::apps
