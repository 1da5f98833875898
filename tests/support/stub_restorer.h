// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade::test {

/// jade_efnet.json of a restorer without weights: kind efnet, SCER, padded to multiples of 4.
extern const char* const kStubMetadata;

/// Saves a TorchScript restorer and returns its path.
/// @param body  of its forward, in TorchScript, indented by two blanks
std::filesystem::path save_restorer(const std::filesystem::path& path, const std::string& body,
                                    const std::string& metadata = kStubMetadata,
                                    const std::string& inputs = "image, events, mask");

/// jade_efnet.json of a restorer of version 2 without weights, for four windows.
extern const char* const kAnyTimeMetadata;

/// Saves a restorer of any moment, forward(image, counts, time); otherwise as save_restorer.
std::filesystem::path save_any_time_restorer(const std::filesystem::path& path,
                                             const std::string& body,
                                             const std::string& metadata = kAnyTimeMetadata);

}  // namespace jade::test
