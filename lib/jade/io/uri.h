// SPDX-License-Identifier: Apache-2.0
// Names of files as URIs write them.
#pragma once

#include <string>

namespace jade::io {

/// The path with URL escapes such as %20 decoded. Other percent signs stay.
std::string unescaped(const std::string& path);

}  // namespace jade::io
