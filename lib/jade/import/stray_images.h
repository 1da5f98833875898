// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/import/structure_from_motion.h"

namespace jade::import {

/// Removes images that were registered to another part of a repeating texture: each, the worst
/// first, that is ten times as far from the line between its neighbours in time as is usual, three
/// times as far as they are apart, and sees other points than they do. An image at the turn of a
/// shake is as far off, but sees their points. Few poses do not determine what is usual.
void drop_strays(Reconstruction& reconstruction);

}  // namespace jade::import
