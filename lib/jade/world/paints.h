// SPDX-License-Identifier: Apache-2.0
// The textures of scenes. All are sampled from their seed; repeating textures are seamless.
#pragma once

#include <string>

#include "jade/world/canvas.h"
#include "jade/world/noise.h"

namespace jade::world::paints {

Canvas wood(Rgb light, Rgb dark, float rings, uint32_t seed);
/// `rows` parallel boards, each with its own grain. Repeats.
Canvas planks(Rgb light, Rgb dark, int rows, uint32_t seed);
Canvas marble(Rgb base, Rgb vein, uint32_t seed);
/// `rows` rows of bricks. Repeats.
Canvas bricks(Rgb brick, Rgb mortar, int rows, uint32_t seed);
/// Stones of uneven size, dark joints. Repeats.
Canvas cobbles(Rgb stone, Rgb joint, int cells, uint32_t seed);
Canvas tiles(Rgb a, Rgb b, Rgb grout, int cells, uint32_t seed);
/// Nested checkerboards of three scales.
Canvas checker(Rgb a, Rgb b, int cells, uint32_t seed);
Canvas plaster(Rgb color, uint32_t seed);
Canvas concrete(uint32_t seed);
Canvas fabric(Rgb a, Rgb b, Rgb thread, int bands, uint32_t seed);
Canvas carpet(Rgb a, Rgb b, Rgb c, uint32_t seed);
Canvas stripes(Rgb a, Rgb b, int count, bool upright);
Canvas metal(Rgb color, uint32_t seed);
Canvas rust(uint32_t seed);
Canvas grass(uint32_t seed);
Canvas gravel(uint32_t seed);
Canvas foliage(Rgb light, Rgb dark, uint32_t seed);
Canvas basket(Rgb light, Rgb dark, int cells);
Canvas pegboard(Rgb color, int cells);
Canvas sky(uint32_t seed);

/// Printed textures.
Canvas page(uint32_t seed);                              ///< headline, columns, a picture
Canvas poster(const std::string& title, uint32_t seed);  ///< bold shapes and a title
Canvas painting(uint32_t seed);                          ///< an abstract in a frame
Canvas label(const std::string& title, Rgb ground, Rgb band, uint32_t seed);  ///< of a package
Canvas spine(const std::string& title, Rgb cover, Rgb ink, uint32_t seed);    ///< of a book
Canvas crate(const std::string& title, uint32_t seed);
Canvas screen(uint32_t seed);  ///< program text on a dark ground
Canvas keyboard();
Canvas clock_face(uint32_t seed);
Canvas calendar(uint32_t seed);
Canvas circuit(uint32_t seed);
Canvas ruler();
Canvas map_sheet(uint32_t seed);

/// Transparent between the wires.
Canvas wire_mesh(Rgb color, int cells, float thickness);
Canvas leaf(Rgb light, Rgb dark, uint32_t seed);
Canvas fern(Rgb light, Rgb dark, uint32_t seed);
Canvas flower(Rgb petal, Rgb heart, int petals);

/// A random word for a sign, and a random colour of the palette.
std::string word(Draw& draw);
Rgb color(Draw& draw);

}  // namespace jade::world::paints
