// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/rng.h"

#include <opencv2/core.hpp>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

// Synthetic number plates, flat and in scenes, with exact ground truth.
namespace tarsier::synth {

// The outlines of the plate symbols in several typefaces, rendered once. Const; threads may share
// it.
class GlyphSet;

// Loads all installed typefaces that resemble plate lettering (OSP-DIN, Nimbus Sans Narrow Bold,
// FreeSans Bold, Roadgeek, DejaVu Sans Condensed Bold ..). Throws InputError, which names the
// Debian packages, if fewer than two are installed.
[[nodiscard]] std::shared_ptr<const GlyphSet> load_glyphs();

// Typefaces for training a reader of any plate: those above, other installed ones, and `drawn`
// random typefaces made from `seed` (stroke_typeface.h). Three of ten plates use the typefaces of
// load_glyphs(), five of ten the random ones. Another seed gives typefaces that were not used for
// training. Throws the same exceptions as load_glyphs().
[[nodiscard]] std::shared_ptr<const GlyphSet> load_many_glyphs(std::uint64_t seed, int drawn = 200);
// Only `drawn` random typefaces; needs no installed typeface.
[[nodiscard]] std::shared_ptr<const GlyphSet> draw_glyphs(std::uint64_t seed, int drawn);

enum class PlateKind {
  kSpain,        // 520 x 110 mm, DDDD LLL
  kSpainOld,     // province, L DDDD LL / L DDDDDD
  kSpainSquare,  // 340 x 220 mm, two rows
  kSpainMoto,    // 220 x 160 mm, two or three rows
  kEurope,       // 520 x 110 mm, bands, seals, dashes, colours of many countries
  kUs,           // 305 x 152 mm, state, slogan, graphics, bolts
  kBrazil,       // 400 x 130 mm, LLL DDDD and Mercosur LLLDLDD
};

struct PlateFaceOptions {
  PlateKind kind = PlateKind::kSpain;
  float px_per_mm = 1.0F;
  std::string text;  // empty: random, of the kind's layouts
  // Random texts are often groups of arbitrary symbols, so that a reader does not learn a grammar.
  bool any_text = false;
  // Varies typeface, stroke, colours, spacing, seals, rivets and dirt. False: the kind's standard
  // look.
  bool random_style = true;
  // Adds what real plates show: slogans and towns above and below, stacked letters, frames over the
  // edge, relief, worn paint.
  bool wild = false;
  bool infrared = false;  // grey: bright plate, dark characters; seals and band fade

  [[nodiscard]] OptionFields fields() { return {{"px_per_mm", px_per_mm, range(0.2, 4)}}; }
  void check() const { check_fields(*this); }
};

struct PlateSymbol {
  char symbol;
  cv::Rect2f box;  // of the ink, px of the face
  int row;         // 0 is the upper row
};

// A frontal view of a plate.
struct PlateFace {
  cv::Mat image;  // CV_8UC3, filled by the plate
  std::string text;
  std::vector<PlateSymbol> symbols;  // in reading order
  int rows = 1;
};

[[nodiscard]] PlateFace render_plate_face(const GlyphSet& glyphs, const PlateFaceOptions& options,
                                          Rng& rng);

}  // namespace tarsier::synth
