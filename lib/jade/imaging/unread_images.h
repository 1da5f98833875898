// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade::imaging {

/// For messages about a folder without images: "; found 24 files .heic, which are not read as
/// frames …" for the most frequent kind of file that is no text or array, with what is read; empty
/// if there are none.
std::string unread_images(const std::filesystem::path& folder);

}  // namespace jade::imaging
