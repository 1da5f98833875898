// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace jade::io {

/// The bytes as a gzip file (RFC 1952), at zlib's usual level. @throws DataError if zlib fails.
std::string gzip(const std::string& content);

}  // namespace jade::io
