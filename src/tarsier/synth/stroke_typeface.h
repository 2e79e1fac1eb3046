// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/glyphs.h"

#include <string>

namespace tarsier::synth {

// A typeface that no foundry has: the symbols of kPlateSymbols as strokes along skeletons, after
// the rules of plate alphabets (straight stems, one width of stroke, bowls whose corners are
// circles, ellipses, boxes with rounded corners or cut corners). Drawn from `rng`: width and
// contrast of the strokes, form and radius of the corners, proportions, apertures and waists, the
// usual forms of 1, 2, 3, 4, 6, 7, 9, A, G, I, J, K, M, Q, R and W, slabs, ends, stencil bridges,
// and how much paint rounds the outlines. In some O and 0 are one form, in some they differ.
// All weights are the same masks.
[[nodiscard]] GlyphSet::Typeface stroke_typeface(const std::string& name, Rng& rng);

}  // namespace tarsier::synth
