// SPDX-License-Identifier: MIT
#include "tarsier/synth/stroke_typeface.h"

#include "tarsier/synth/stroke_pen.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::synth {
namespace {

StrokeStyle random_style(Rng& rng) {
  StrokeStyle style;
  const auto with_probability = [&](double p) { return rng.uniform() < p; };
  style.width = rng.uniform(0.42, 0.64);
  style.letter_ratio = rng.uniform(0.94, 1.18);
  style.width_evenness = rng.uniform();
  style.stem_width = std::min(rng.uniform(0.085, 0.2), 0.34 * style.width);
  style.bar_width = style.stem_width * (with_probability(0.5) ? 1 : rng.uniform(0.75, 1.1));
  const double family = rng.uniform();
  if (family < 0.28) {
    style.round = 0.5;
    style.bowl_aspect = rng.uniform(0.95, 1.25);
  } else if (family < 0.45) {
    style.round = 0.5;
    style.bowl_aspect = rng.uniform(1.25, 2);
  } else if (family < 0.85) {
    style.round = rng.uniform(0.16, 0.42);
    style.bowl_aspect = rng.uniform(0.85, 1.3);
  } else {
    style.round = rng.uniform(0.14, 0.34);
    style.bowl_aspect = rng.uniform(0.8, 1.3);
    style.power = 1;
  }
  if (family < 0.85) style.power = with_probability(0.6) ? 2 : rng.uniform(1.6, 3);
  style.round_ends = with_probability(0.25);
  style.round_joins = style.round_ends || with_probability(0.3);
  style.blur_px = with_probability(0.6) ? rng.uniform(1, 6) : 0.7;
  style.aperture = rng.uniform(0.14, 0.34);
  style.waist = rng.uniform(0.43, 0.53);
  style.slab = with_probability(0.4) ? rng.uniform(0.1, 0.24) : 0;
  style.stencil = with_probability(0.05) ? rng.uniform(0.35, 0.6) : -1;
  style.form_1 = with_probability(0.15) ? 3 : rng.integer(0, 2);
  style.form_2 = with_probability(0.25) ? 1 : 0;
  style.form_3 = with_probability(0.2) ? rng.integer(1, 2) : 0;
  style.form_4 = with_probability(0.2) ? rng.integer(1, 2) : 0;
  style.form_6 = with_probability(0.35) ? 1 : 0;
  style.form_7 = rng.integer(0, 2);
  style.form_a = with_probability(0.4) ? rng.integer(1, 2) : 0;
  style.form_g = rng.integer(0, 2);
  style.form_i = with_probability(0.35) ? 1 : 0;
  style.form_j = with_probability(0.3) ? 1 : 0;
  style.form_k = with_probability(0.35) ? 1 : 0;
  style.form_m = rng.integer(0, 2);
  style.form_q = rng.integer(0, 2);
  style.form_r = with_probability(0.3) ? 1 : 0;
  style.form_w = rng.integer(0, 2);
  style.form_0 = with_probability(0.5) ? 0 : rng.integer(1, 4);
  if (style.form_0 >= 3 && with_probability(0.7))
    style.form_0 -= 2;  // slashed and slit ones are rare
  style.lean = rng.uniform(0.15, 0.5);
  style.inset = rng.uniform(0, 0.12);
  style.corner_radius = with_probability(0.3) ? rng.uniform(0.1, 0.5) : 0;
  return style;
}

double width_of(char symbol, const StrokeStyle& style) {
  const double digit = style.width;
  const double letter = style.width * style.letter_ratio;
  const auto uneven = [&](double factor) { return 1 + (factor - 1) * (1 - style.width_evenness); };
  switch (symbol) {
    case '1':
      return style.form_1 == 3
                 ? std::max(style.stem_width + 0.02, digit * 0.3)
                 : std::max(style.stem_width * 1.7, digit * (0.5 + 0.25 * style.width_evenness));
    case 'I':
      return style.form_i == 1 ? std::max(style.stem_width * 2.2, digit * 0.62)
                               : style.stem_width + 0.01;
    case 'J':
      return letter * uneven(0.85);
    case 'E':
    case 'F':
    case 'L':
      return letter * uneven(0.88);
    case 'M':
      return letter * (uneven(1.25) + 0.06);
    case 'W':
      return letter * (uneven(1.4) + 0.06);
    case 'A':
    case 'V':
    case 'X':
    case 'Y':
    case 'K':
      return letter * uneven(1.1);
    default:
      return symbol <= '9' ? digit : letter;
  }
}

void draw_digit(char symbol, const StrokeStyle& h, StrokePen& pen) {
  const double w = h.waist;
  const double a = h.aperture;
  const double low = 1 - a;
  switch (symbol) {
    case '0':
      pen.closed({{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}});
      if (h.form_0 == 3) pen.open({{0.1, 0.85}, {0.9, 0.15}});
      if (h.form_0 == 4) pen.slit({0.7, 0.25}, {1.2, -0.1});
      break;
    case '1': {
      if (h.form_1 == 3) {
        pen.open({{0.5, 0}, {0.5, 1}});
        break;
      }
      const double stem = h.slab > 0 && h.form_1 == 2 ? 0.6 : 1;
      pen.open({{0, 0.14 + 0.3 * h.aperture}, {stem, 0}, {stem, 1}});
      if (stem < 1) pen.open({{0.1, 1}, {1, 1}});
      break;
    }
    case '2':
      if (h.form_2 == 1)
        pen.open({{0, a}, {0, 0, 1}, {1, 0, 1}, {1, w, 1}, {0, w, 1}, {0, 1}, {1, 1}});
      else
        pen.open({{0, a}, {0, 0, 1}, {1, 0, 1}, {1, w, 0.7}, {0, 1}, {1, 1}});
      break;
    case '3':
      if (h.form_3 == 1) {
        pen.open({{0, 0}, {1, 0}, {0.42, 0.42}, {1, 0.42, 1}, {1, 1, 1}, {0, 1, 1}, {0, low}});
        break;
      }
      pen.open({{0, a}, {0, 0, 1}, {1 - h.inset, 0, 1}, {1 - h.inset, w, 1}, {0.35, w}});
      pen.open({{0.35, w}, {1, w, 1}, {1, 1, 1}, {0, 1, 1}, {0, low}});
      break;
    case '4':
      if (h.form_4 == 1) {
        pen.open({{0, 0}, {0, 0.68}, {1, 0.68}});
        pen.open({{0.72, 0.35}, {0.72, 1}});
      } else if (h.form_4 == 2) {
        pen.open({{0.45, 0}, {0, 0.72}, {1, 0.72}});
        pen.open({{0.74, 0.4}, {0.74, 1}});
      } else {
        pen.open({{1, 0.72}, {0, 0.72}, {0.74, 0}, {0.74, 1}});
      }
      break;
    case '5':
      pen.open({{1, 0}, {0.04, 0}, {0, w - 0.04}});
      pen.open({{0, w - 0.04}, {1, w - 0.06, 1}, {1, 1, 1}, {0, 1, 1}, {0, low}});
      break;
    case '6':
    case '9': {
      const bool nine = symbol == '9';
      const auto v = [&](double x, double y, double round = 0) {
        return nine ? Vertex{1 - x, 1 - y, round} : Vertex{x, y, round};
      };
      const double top = w - 0.06;
      pen.closed({v(0, top, 1), v(1, top, 1), v(1, 1, 1), v(0, 1, 1)});
      if (h.form_6 == 1)
        pen.open({v(0, 0.5 + top / 2), v(0, 0.42, 0.6), v(0.8, 0)});
      else
        pen.open({v(0, 0.5 + top / 2), v(0, 0, 1), v(1, 0, 1), v(1, a * 0.9)});
      break;
    }
    case '7':
      if (h.form_7 == 1)
        pen.open({{0, 0}, {1, 0}, {0.9, 0.3, 1}, {h.lean, 0.6, 1}, {h.lean, 1}});
      else
        pen.open({{0, h.form_7 == 2 ? 0.14 : 0}, {0, 0}, {1, 0}, {h.lean, 1}});
      break;
    case '8':
      pen.closed({{h.inset, 0, 1}, {1 - h.inset, 0, 1}, {1 - h.inset, w, 1}, {h.inset, w, 1}});
      pen.closed({{0, w, 1}, {1, w, 1}, {1, 1, 1}, {0, 1, 1}});
      break;
    default:
      break;
  }
}

void draw_a_to_k(char symbol, const StrokeStyle& h, StrokePen& pen) {
  const double w = h.waist;
  const double a = h.aperture;
  const double low = 1 - a;
  switch (symbol) {
    case 'A':
      if (h.form_a == 2 && h.round < 0.45) {
        pen.open({{0, 1}, {0, 0, 1}, {1, 0, 1}, {1, 1}});
        pen.open({{0, 0.58}, {1, 0.58}});
        break;
      }
      if (h.form_a == 1)
        pen.open({{0, 1}, {0.4, 0}, {0.6, 0}, {1, 1}});
      else
        pen.open({{0, 1}, {0.5, 0}, {1, 1}});
      pen.open({{0.22, 0.7}, {0.78, 0.7}});
      break;
    case 'B':
      pen.closed({{0, 0, h.corner_radius}, {1 - h.inset, 0, 1}, {1 - h.inset, w, 1}, {0, w}});
      pen.closed({{0, w}, {1, w, 1}, {1, 1, 1}, {0, 1, h.corner_radius}});
      break;
    case 'C':
      pen.open({{1, a}, {1, 0, 1}, {0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, low}});
      break;
    case 'D':
      pen.closed({{0, 0, h.corner_radius}, {1, 0, 1}, {1, 1, 1}, {0, 1, h.corner_radius}});
      break;
    case 'E':
      pen.open({{1, 0}, {0, 0}, {0, 1}, {1, 1}});
      pen.open({{0, w}, {0.7 + h.lean / 2, w}});
      break;
    case 'F':
      pen.open({{1, 0}, {0, 0}, {0, 1}});
      pen.open({{0, w}, {0.65 + h.lean / 2, w}});
      break;
    case 'G':
      if (h.form_g == 0) {
        pen.open({{1, a}, {1, 0, 1}, {0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0.55}, {0.5, 0.55}});
      } else {
        pen.open({{1, a}, {1, 0, 1}, {0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0.6}});
        pen.open({{0.55, 0.58}, {1, 0.58}});
        if (h.form_g == 2) pen.open({{1, 0.58}, {1, 1}});
      }
      break;
    case 'H':
      pen.open({{0, 0}, {0, 1}});
      pen.open({{1, 0}, {1, 1}});
      pen.open({{0, w}, {1, w}});
      break;
    case 'I':
      pen.open({{0.5, 0}, {0.5, 1}});
      if (h.form_i == 1) {
        pen.open({{0, 0}, {1, 0}});
        pen.open({{0, 1}, {1, 1}});
      }
      break;
    case 'J':
      pen.open({{1, 0}, {1, 1, 1}, {0, 1, 1}, {0, low - 0.05}});
      if (h.form_j == 1) pen.open({{0.3, 0}, {1, 0}});
      break;
    case 'K':
      pen.open({{0, 0}, {0, 1}});
      if (h.form_k == 1) {
        pen.open({{1, 0}, {0.12, 0.5}, {1, 1}});
      } else {
        pen.open({{1, 0}, {0, 0.64}});
        pen.open({{0.3, 0.42}, {1, 1}});
      }
      break;
    default:
      break;
  }
}

void draw_l_to_z(char symbol, const StrokeStyle& h, StrokePen& pen) {
  const double w = h.waist;
  const double a = h.aperture;
  const double low = 1 - a;
  switch (symbol) {
    case 'L':
      pen.open({{0, 0}, {0, 1}, {1, 1}});
      break;
    case 'M': {
      const double splay = h.form_m == 2 ? 0.1 : 0;
      pen.open(
          {{0, 1}, {splay, 0}, {0.5, h.form_m == 1 ? 1 : 0.45 + h.lean}, {1 - splay, 0}, {1, 1}});
      break;
    }
    case 'N':
      pen.open({{0, 1}, {0, 0}, {1, 1}, {1, 0}});
      break;
    case 'O':
      pen.closed({{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}});
      break;
    case 'P':
      pen.open({{0, 1}, {0, 0}, {1, 0, 1}, {1, w + 0.06, 1}, {0, w + 0.06}});
      break;
    case 'Q':
      pen.closed({{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}});
      if (h.form_q == 2)
        pen.open({{0.6, 0.72}, {0.85, 1.2}});
      else
        pen.open({{h.form_q == 1 ? 0.45 : 0.65, 0.68}, {1.08, 1.06}});
      break;
    case 'R':
      pen.open({{0, 1}, {0, 0}, {1, 0, 1}, {1, w + 0.03, 1}, {0, w + 0.03}});
      if (h.form_r == 1)
        pen.open({{0.4, w + 0.03}, {1, w + 0.03, 0.6}, {1, 1}});
      else
        pen.open({{0.45, w + 0.03}, {1, 1}});
      break;
    case 'S':
      pen.open({{1, a},
                {1, 0, 1},
                {0, 0, 1},
                {0, w - h.inset / 2, 1},
                {1, w + h.inset / 2, 1},
                {1, 1, 1},
                {0, 1, 1},
                {0, low}});
      break;
    case 'T':
      pen.open({{0, 0}, {1, 0}});
      pen.open({{0.5, 0}, {0.5, 1}});
      break;
    case 'U':
      pen.open({{0, 0}, {0, 1, 1}, {1, 1, 1}, {1, 0}});
      break;
    case 'V':
      if (h.form_a == 1)
        pen.open({{0, 0}, {0.4, 1}, {0.6, 1}, {1, 0}});
      else
        pen.open({{0, 0}, {0.5, 1}, {1, 0}});
      break;
    case 'W':
      if (h.form_w == 1)
        pen.open({{0, 0}, {0, 1}, {0.5, 0.2 + h.lean / 2}, {1, 1}, {1, 0}});
      else
        pen.open({{0, 0}, {0.25, 1}, {0.5, h.form_w == 2 ? 0 : 0.3}, {0.75, 1}, {1, 0}});
      break;
    case 'X':
      pen.open({{0, 0}, {1, 1}});
      pen.open({{1, 0}, {0, 1}});
      break;
    case 'Y':
      pen.open({{0, 0}, {0.5, 0.52}, {1, 0}});
      pen.open({{0.5, 0.5}, {0.5, 1}});
      break;
    case 'Z':
      pen.open({{0, 0}, {1, 0}, {0, 1}, {1, 1}});
      break;
    default:
      break;
  }
}

cv::Mat draw_symbol(char symbol, const StrokeStyle& style) {
  double width = width_of(symbol, style);
  // A 0 that differs from the O: narrower or rounder.
  StrokeStyle varied = style;
  if (symbol == '0' && style.form_0 == 1) width *= 0.88;
  if (symbol == '0' && style.form_0 == 2) varied.bowl_aspect = style.bowl_aspect * 1.5;
  // Symbols with four strokes in one width have thinner strokes.
  if (symbol == 'M' || symbol == 'W')
    varied.stem_width =
        std::min(varied.stem_width, 0.17 * width) * (style.width_evenness > 0.5 ? 0.9 : 1);
  StrokePen pen(varied, width);
  if (symbol <= '9')
    draw_digit(symbol, varied, pen);
  else if (symbol <= 'K')
    draw_a_to_k(symbol, varied, pen);
  else
    draw_l_to_z(symbol, varied, pen);
  if (style.stencil > 0 && symbol != 'I' && symbol != '1') pen.bridge(style.stencil);
  return pen.finished();
}

}  // namespace

GlyphSet::Typeface stroke_typeface(const std::string& name, Rng& rng) {
  const StrokeStyle style = random_style(rng);
  GlyphSet::Typeface typeface;
  typeface.name = name;
  typeface.has_weights = false;
  int widest = 1;
  for (std::size_t i = 0; i < kPlateSymbols.size(); ++i) {
    // In a real die, every symbol differs slightly from the others.
    StrokeStyle varied = style;
    varied.waist += rng.normal(0, 0.012);
    varied.aperture += rng.normal(0, 0.015);
    varied.stem_width *= std::exp(rng.normal(0, 0.02));
    varied.bar_width *= std::exp(rng.normal(0, 0.02));
    const cv::Mat mask = draw_symbol(kPlateSymbols[i], varied);
    typeface.masks[i] = mask;
    if (i < 10) widest = std::max(widest, mask.cols);
  }
  typeface.digit_aspect = static_cast<double>(widest) / GlyphSet::kCapHeight;
  return typeface;
}

}  // namespace tarsier::synth
