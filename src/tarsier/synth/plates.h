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

// Drawn number plates, flat and in scenes, with exact truth.
namespace tarsier::synth {

// The outlines of the plate symbols in several typefaces, rendered once. Const and shared between
// threads.
class GlyphSet;

// Loads every typeface that is installed of those that come near plate lettering (OSP-DIN, Nimbus
// Sans Narrow Bold, FreeSans Bold, Roadgeek, DejaVu Sans Condensed Bold ..). Throws InputError that
// names the Debian packages when fewer than two are there.
[[nodiscard]] std::shared_ptr<const GlyphSet> load_glyphs();

// What a reader of any plate learns from: those typefaces, others that are installed, and as many
// as `drawn` that are made up from `seed` (stroke_typeface.h). Of the plates lettered with them
// three of ten have the typefaces of load_glyphs() and five made-up ones. Other seeds are typefaces
// that nobody has learnt. Throws as load_glyphs() does.
[[nodiscard]] std::shared_ptr<const GlyphSet> load_many_glyphs(std::uint64_t seed, int drawn = 200);
// `drawn` made-up typefaces alone: needs none that are installed.
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
  std::string text;          // empty: random, of the kind's layouts
  bool any_text = false;     // random texts are often groups of anything: a reader that learns from
                             // them learns no grammar
  bool random_style = true;  // typeface, stroke, colours, spacing, seals, rivets, dirt vary; false:
                             // the kind's standard look
  bool wild = false;         // .. and what is met in the wild: slogans and towns above and below,
                             // stacked letters, frames over the edge, relief, worn paint
  bool infrared = false;     // grey: bright plate, dark characters, seals and band fade

  [[nodiscard]] OptionFields fields() { return {{"px_per_mm", px_per_mm, range(0.2, 4)}}; }
  void check() const { check_fields(*this); }
};

struct PlateSymbol {
  char symbol;
  cv::Rect2f box;  // of the ink, px of the face
  int row;         // 0 is the upper
};

// A plate seen straight on.
struct PlateFace {
  cv::Mat image;  // CV_8UC3, the plate fills it
  std::string text;
  std::vector<PlateSymbol> symbols;  // in reading order
  int rows = 1;
};

[[nodiscard]] PlateFace render_plate_face(const GlyphSet& glyphs, const PlateFaceOptions& options,
                                          Rng& rng);

}  // namespace tarsier::synth
