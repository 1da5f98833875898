// SPDX-License-Identifier: Apache-2.0
// Formats field values as text, for the YAML and schema printers.
#pragma once

#include <string>

#include "jade/core/fields.h"

namespace jade::config {

/// The value as a YAML scalar or flow sequence, in the shortest form that parses to the same value.
std::string value_text(const FieldPointer& value);

/// Parses "6%" or "0.4 %" into a number of percent; false for other text.
bool read_percent(const std::string& text, double& percent);

/// "true or false", "a whole number", "a number", "a text", "a path", "a list of numbers", …
std::string type_text(const FieldPointer& value);

/// "a number from 0 to 1", "one of a, b": what a field expects.
std::string expectation(const Field& field);

/// "a, b": the words of an enum.
std::string joined_words(const std::vector<EnumPointer::Entry>& entries,
                         const std::string& separator);

/// "0 to 1", "0 or more", or empty.
std::string range_text(const Field& field);

/// The shortest decimal that parses to the same double.
std::string number_text(double value);

}  // namespace jade::config
