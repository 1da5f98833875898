// SPDX-License-Identifier: Apache-2.0
// The front end, embedded from front/ by embed.cmake.
#pragma once

namespace jade::page {

extern const char* const kHtml;         ///< with @STYLE@, @DATA@, @SCENE@ and @SCRIPT@
extern const char* const kStyle;        ///< CSS
extern const char* const kScript;       ///< every module, joined
extern const char* const kSweepHtml;    ///< with @STYLE@, @DATA@ and @SCRIPT@
extern const char* const kSweepStyle;   ///< the report's CSS and the sweep page's additions
extern const char* const kSweepScript;  ///< the modules of sweep_modules.txt, joined

}  // namespace jade::page
