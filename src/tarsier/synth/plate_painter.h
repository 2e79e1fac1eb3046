// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/glyphs.h"

#include <opencv2/core.hpp>

#include <string>

// Shared code for drawing plates; used by the .cpp files of this module.
namespace tarsier::synth {

using Color = cv::Scalar;  // BGR

struct ColorRange {
  double low, high;
};
// A colour with each channel drawn from its range, in the order red, green, blue.
[[nodiscard]] Color random_color(Rng& rng, ColorRange blue, ColorRange green, ColorRange red);

// The appearance of a plate, in mm and colours, set by the style of the kind.
struct PlateStyle {
  double width = 520;
  double height = 110;
  double cap_height = 77;
  double digit_width = 43;
  double gap = 14;          // between characters
  double group_gap = 41;    // between groups
  double centre = 0.5;      // vertical position of the text, share of the height
  bool fixed_pitch = true;  // a 1 is as wide as an 8
  double w_width = 1.35;    // width of a W / width of a digit
  bool inverted_w = false;  // the W is an M upside down, as in many dies of one width
  double band_left = 0;     // width of the euro band
  double band_right = 0;
  double corner = 8;  // radius
  double border = 2;  // line along the edge
  Color ground{250, 250, 250};
  Color ground_below{250, 250, 250};
  Color ink{25, 20, 20};
  Color band{150, 50, 10};
  int typeface = 0;
  int weight = 2;
  double slant = 0;
  // For wild plates.
  bool slogan_above = false;
  bool slogan_below = false;
  bool has_stacked_letters = false;  // two small letters, one above the other, beside the text
  double relief = 0;              // mm, width of the lit and the dark edge of embossed characters
  double relief_direction = 0;    // direction of the light, rad
  double relief_strength = 0;     // 0..1
  double max_wear = 0;            // share of the paint that is missing where the wear is heaviest
  double emblem = 0;              // size of emblems between groups, share of the cap height
  bool has_crests = false;        // emblems have parts, like seals and coats of arms
  bool has_side_symbols = false;  // small symbols beside the text that do not belong to it
  double lattice = 0;             // grey levels of a background pattern
};

struct PlatePainter {
  cv::Mat& image;
  double s;  // px per mm
  const GlyphSet& glyphs;
  Rng& rng;

  [[nodiscard]] int px(double mm) const { return cvRound(mm * s); }
  [[nodiscard]] cv::Point at(double x, double y) const { return {px(x), px(y)}; }

  [[nodiscard]] Color any_color() const {
    return {rng.uniform(0, 255), rng.uniform(0, 255), rng.uniform(0, 255)};
  }
  [[nodiscard]] bool with_probability(double p) const { return rng.uniform() < p; }
};

// Blends `color` over the image with `mask` as coverage.
void blend(cv::Mat& image, const cv::Mat& mask, cv::Point corner, const Color& color);

// The 8-bit mask of a symbol in the style of this plate.
[[nodiscard]] cv::Mat letter_of(const GlyphSet& glyphs, const PlateStyle& style, char symbol);

// Draws a line of small text, centred at (x, y), mm; returns its width in mm.
double small_text(const PlatePainter& p, const std::string& text, double x, double y, double height,
                  const Color& color, double stretch = 1);

// A random word of letters.
[[nodiscard]] std::string random_word(Rng& rng, int least, int most);

// Ornaments. x, y: the centre, mm.
void euro_band(const PlatePainter& p, const PlateStyle& style, bool left);

// Ornament between groups of symbols.
enum class PlateSeparator { kNone, kDash, kDot, kSeal, kSeals, kEmblem, kDashAndSeal };
void separator(const PlatePainter& p, const PlateStyle& style, PlateSeparator kind, double x,
               double y, double room);

void rivets(const PlatePainter& p, const PlateStyle& style);
void dirt(const PlatePainter& p, const PlateStyle& style);
// A frame with the dealer's name that overlaps the plate's edge.
void dealer_frame(const PlatePainter& p, const PlateStyle& style);
void us_ornaments(const PlatePainter& p, const PlateStyle& style);

// plate_wear.cpp: the appearance of wild plates, and how it is drawn. `slogans`: allows lines of
// small text.
void make_wild(PlateStyle& style, bool slogans, Rng& rng);
void wear(cv::Mat& mask, double strength, Rng& rng);
void relief(const PlatePainter& p, const PlateStyle& style, const cv::Mat& mask, cv::Point corner);
void lattice(const PlatePainter& p, const PlateStyle& style);
void slogans(const PlatePainter& p, const PlateStyle& style);
// Two small letters centred at (x, y), mm; returns their width.
double stacked_letters(const PlatePainter& p, const PlateStyle& style, double x, double y);
// Draws one to three small symbols beside the text (the year, a class of vehicle), starting at x,
// or ending at x with `ends`; mm. Returns their width.
double side_symbols(const PlatePainter& p, const PlateStyle& style, double x, double y, bool ends);
// A coat of arms, a map, an animal, or a square with a sign: an outline with parts.
void crest(const PlatePainter& p, const PlateStyle& style, double x, double y, double radius);
// A faint image behind the text, as on plates of US states.
void ghost(const PlatePainter& p, const PlateStyle& style, double x, double y);

}  // namespace tarsier::synth
