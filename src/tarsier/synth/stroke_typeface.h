// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/glyphs.h"

#include <string>

namespace tarsier::synth {

// Generates a random typeface: the symbols of kPlateSymbols as strokes along skeletons. It follows
// the rules of plate alphabets: straight stems, one stroke width, bowls whose corners are circles,
// ellipses, rounded boxes or cut corners. `rng` selects width and contrast of the strokes, form and
// radius of the corners, proportions, apertures and waists, the usual forms of 1, 2, 3, 4, 6, 7, 9,
// A, G, I, J, K, M, Q, R and W, slabs, ends, stencil bridges, and the rounding of outlines by
// paint. O and 0 are equal in some typefaces and different in others. All weights have the same
// masks.
[[nodiscard]] GlyphSet::Typeface stroke_typeface(const std::string& name, Rng& rng);

}  // namespace tarsier::synth
