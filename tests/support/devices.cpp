// SPDX-License-Identifier: Apache-2.0
#include "support/devices.h"

#include "jade/core/device.h"

namespace jade::test {

bool has_gpu() { return cuda_device_count() > 0; }

}  // namespace jade::test
