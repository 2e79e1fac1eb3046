// SPDX-License-Identifier: MIT
#include "tarsier/synth/stroke_typeface.h"

#include "tarsier/synth/stroke_pen.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::synth {
namespace {

Hand random_hand(Rng& rng) {
  Hand hand;
  const auto chance = [&](double p) { return rng.uniform() < p; };
  hand.width = rng.uniform(0.42, 0.64);
  hand.letter = rng.uniform(0.94, 1.18);
  hand.even = rng.uniform();
  hand.upright = std::min(rng.uniform(0.085, 0.2), 0.34 * hand.width);
  hand.level = hand.upright * (chance(0.5) ? 1 : rng.uniform(0.75, 1.1));
  const double family = rng.uniform();
  if (family < 0.28) {
    hand.round = 0.5;
    hand.tall = rng.uniform(0.95, 1.25);
  } else if (family < 0.45) {
    hand.round = 0.5;
    hand.tall = rng.uniform(1.25, 2);
  } else if (family < 0.85) {
    hand.round = rng.uniform(0.16, 0.42);
    hand.tall = rng.uniform(0.85, 1.3);
  } else {
    hand.round = rng.uniform(0.14, 0.34);
    hand.tall = rng.uniform(0.8, 1.3);
    hand.power = 1;
  }
  if (family < 0.85) hand.power = chance(0.6) ? 2 : rng.uniform(1.6, 3);
  hand.round_ends = chance(0.25);
  hand.round_joins = hand.round_ends || chance(0.3);
  hand.soft = chance(0.6) ? rng.uniform(1, 6) : 0.7;
  hand.aperture = rng.uniform(0.14, 0.34);
  hand.waist = rng.uniform(0.43, 0.53);
  hand.slab = chance(0.4) ? rng.uniform(0.1, 0.24) : 0;
  hand.stencil = chance(0.05) ? rng.uniform(0.35, 0.6) : -1;
  hand.one = chance(0.15) ? 3 : rng.integer(0, 2);
  hand.two = chance(0.25) ? 1 : 0;
  hand.three = chance(0.2) ? rng.integer(1, 2) : 0;
  hand.four = chance(0.2) ? rng.integer(1, 2) : 0;
  hand.six = chance(0.35) ? 1 : 0;
  hand.seven = rng.integer(0, 2);
  hand.apex = chance(0.4) ? rng.integer(1, 2) : 0;
  hand.gee = rng.integer(0, 2);
  hand.eye = chance(0.35) ? 1 : 0;
  hand.jay = chance(0.3) ? 1 : 0;
  hand.kay = chance(0.35) ? 1 : 0;
  hand.em = rng.integer(0, 2);
  hand.queue = rng.integer(0, 2);
  hand.are = chance(0.3) ? 1 : 0;
  hand.double_u = rng.integer(0, 2);
  hand.zero = chance(0.5) ? 0 : rng.integer(1, 4);
  if (hand.zero >= 3 && chance(0.7)) hand.zero -= 2;  // slashed and slit ones are rare
  hand.lean = rng.uniform(0.15, 0.5);
  hand.inset = rng.uniform(0, 0.12);
  hand.sharp = chance(0.3) ? rng.uniform(0.1, 0.5) : 0;
  return hand;
}

double width_of(char symbol, const Hand& hand) {
  const double digit = hand.width;
  const double letter = hand.width * hand.letter;
  const auto uneven = [&](double factor) { return 1 + (factor - 1) * (1 - hand.even); };
  switch (symbol) {
    case '1':
      return hand.one == 3 ? std::max(hand.upright + 0.02, digit * 0.3)
                           : std::max(hand.upright * 1.7, digit * (0.5 + 0.25 * hand.even));
    case 'I':
      return hand.eye == 1 ? std::max(hand.upright * 2.2, digit * 0.62) : hand.upright + 0.01;
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

void draw_digit(char symbol, const Hand& h, StrokePen& pen) {
  const double w = h.waist;
  const double a = h.aperture;
  const double low = 1 - a;
  switch (symbol) {
    case '0':
      pen.closed({{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}});
      if (h.zero == 3) pen.open({{0.1, 0.85}, {0.9, 0.15}});
      if (h.zero == 4) pen.slit({0.7, 0.25}, {1.2, -0.1});
      break;
    case '1': {
      if (h.one == 3) {
        pen.open({{0.5, 0}, {0.5, 1}});
        break;
      }
      const double stem = h.slab > 0 && h.one == 2 ? 0.6 : 1;
      pen.open({{0, 0.14 + 0.3 * h.aperture}, {stem, 0}, {stem, 1}});
      if (stem < 1) pen.open({{0.1, 1}, {1, 1}});
      break;
    }
    case '2':
      if (h.two == 1)
        pen.open({{0, a}, {0, 0, 1}, {1, 0, 1}, {1, w, 1}, {0, w, 1}, {0, 1}, {1, 1}});
      else
        pen.open({{0, a}, {0, 0, 1}, {1, 0, 1}, {1, w, 0.7}, {0, 1}, {1, 1}});
      break;
    case '3':
      if (h.three == 1) {
        pen.open({{0, 0}, {1, 0}, {0.42, 0.42}, {1, 0.42, 1}, {1, 1, 1}, {0, 1, 1}, {0, low}});
        break;
      }
      pen.open({{0, a}, {0, 0, 1}, {1 - h.inset, 0, 1}, {1 - h.inset, w, 1}, {0.35, w}});
      pen.open({{0.35, w}, {1, w, 1}, {1, 1, 1}, {0, 1, 1}, {0, low}});
      break;
    case '4':
      if (h.four == 1) {
        pen.open({{0, 0}, {0, 0.68}, {1, 0.68}});
        pen.open({{0.72, 0.35}, {0.72, 1}});
      } else if (h.four == 2) {
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
      if (h.six == 1)
        pen.open({v(0, 0.5 + top / 2), v(0, 0.42, 0.6), v(0.8, 0)});
      else
        pen.open({v(0, 0.5 + top / 2), v(0, 0, 1), v(1, 0, 1), v(1, a * 0.9)});
      break;
    }
    case '7':
      if (h.seven == 1)
        pen.open({{0, 0}, {1, 0}, {0.9, 0.3, 1}, {h.lean, 0.6, 1}, {h.lean, 1}});
      else
        pen.open({{0, h.seven == 2 ? 0.14 : 0}, {0, 0}, {1, 0}, {h.lean, 1}});
      break;
    case '8':
      pen.closed({{h.inset, 0, 1}, {1 - h.inset, 0, 1}, {1 - h.inset, w, 1}, {h.inset, w, 1}});
      pen.closed({{0, w, 1}, {1, w, 1}, {1, 1, 1}, {0, 1, 1}});
      break;
    default:
      break;
  }
}

void draw_a_to_k(char symbol, const Hand& h, StrokePen& pen) {
  const double w = h.waist;
  const double a = h.aperture;
  const double low = 1 - a;
  switch (symbol) {
    case 'A':
      if (h.apex == 2 && h.round < 0.45) {
        pen.open({{0, 1}, {0, 0, 1}, {1, 0, 1}, {1, 1}});
        pen.open({{0, 0.58}, {1, 0.58}});
        break;
      }
      if (h.apex == 1)
        pen.open({{0, 1}, {0.4, 0}, {0.6, 0}, {1, 1}});
      else
        pen.open({{0, 1}, {0.5, 0}, {1, 1}});
      pen.open({{0.22, 0.7}, {0.78, 0.7}});
      break;
    case 'B':
      pen.closed({{0, 0, h.sharp}, {1 - h.inset, 0, 1}, {1 - h.inset, w, 1}, {0, w}});
      pen.closed({{0, w}, {1, w, 1}, {1, 1, 1}, {0, 1, h.sharp}});
      break;
    case 'C':
      pen.open({{1, a}, {1, 0, 1}, {0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, low}});
      break;
    case 'D':
      pen.closed({{0, 0, h.sharp}, {1, 0, 1}, {1, 1, 1}, {0, 1, h.sharp}});
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
      if (h.gee == 0) {
        pen.open({{1, a}, {1, 0, 1}, {0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0.55}, {0.5, 0.55}});
      } else {
        pen.open({{1, a}, {1, 0, 1}, {0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0.6}});
        pen.open({{0.55, 0.58}, {1, 0.58}});
        if (h.gee == 2) pen.open({{1, 0.58}, {1, 1}});
      }
      break;
    case 'H':
      pen.open({{0, 0}, {0, 1}});
      pen.open({{1, 0}, {1, 1}});
      pen.open({{0, w}, {1, w}});
      break;
    case 'I':
      pen.open({{0.5, 0}, {0.5, 1}});
      if (h.eye == 1) {
        pen.open({{0, 0}, {1, 0}});
        pen.open({{0, 1}, {1, 1}});
      }
      break;
    case 'J':
      pen.open({{1, 0}, {1, 1, 1}, {0, 1, 1}, {0, low - 0.05}});
      if (h.jay == 1) pen.open({{0.3, 0}, {1, 0}});
      break;
    case 'K':
      pen.open({{0, 0}, {0, 1}});
      if (h.kay == 1) {
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

void draw_l_to_z(char symbol, const Hand& h, StrokePen& pen) {
  const double w = h.waist;
  const double a = h.aperture;
  const double low = 1 - a;
  switch (symbol) {
    case 'L':
      pen.open({{0, 0}, {0, 1}, {1, 1}});
      break;
    case 'M': {
      const double splay = h.em == 2 ? 0.1 : 0;
      pen.open({{0, 1}, {splay, 0}, {0.5, h.em == 1 ? 1 : 0.45 + h.lean}, {1 - splay, 0}, {1, 1}});
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
      if (h.queue == 2)
        pen.open({{0.6, 0.72}, {0.85, 1.2}});
      else
        pen.open({{h.queue == 1 ? 0.45 : 0.65, 0.68}, {1.08, 1.06}});
      break;
    case 'R':
      pen.open({{0, 1}, {0, 0}, {1, 0, 1}, {1, w + 0.03, 1}, {0, w + 0.03}});
      if (h.are == 1)
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
      if (h.apex == 1)
        pen.open({{0, 0}, {0.4, 1}, {0.6, 1}, {1, 0}});
      else
        pen.open({{0, 0}, {0.5, 1}, {1, 0}});
      break;
    case 'W':
      if (h.double_u == 1)
        pen.open({{0, 0}, {0, 1}, {0.5, 0.2 + h.lean / 2}, {1, 1}, {1, 0}});
      else
        pen.open({{0, 0}, {0.25, 1}, {0.5, h.double_u == 2 ? 0 : 0.3}, {0.75, 1}, {1, 0}});
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

cv::Mat draw_symbol(char symbol, const Hand& hand) {
  double width = width_of(symbol, hand);
  // A 0 that differs from the O: narrower or rounder.
  Hand own = hand;
  if (symbol == '0' && hand.zero == 1) width *= 0.88;
  if (symbol == '0' && hand.zero == 2) own.tall = hand.tall * 1.5;
  // Symbols with four strokes in one width have thinner strokes.
  if (symbol == 'M' || symbol == 'W')
    own.upright = std::min(own.upright, 0.17 * width) * (hand.even > 0.5 ? 0.9 : 1);
  StrokePen pen(own, width);
  if (symbol <= '9')
    draw_digit(symbol, own, pen);
  else if (symbol <= 'K')
    draw_a_to_k(symbol, own, pen);
  else
    draw_l_to_z(symbol, own, pen);
  if (hand.stencil > 0 && symbol != 'I' && symbol != '1') pen.bridge(hand.stencil);
  return pen.finished();
}

}  // namespace

GlyphSet::Typeface stroke_typeface(const std::string& name, Rng& rng) {
  const Hand hand = random_hand(rng);
  GlyphSet::Typeface typeface;
  typeface.name = name;
  typeface.has_weights = false;
  int widest = 1;
  for (std::size_t i = 0; i < kPlateSymbols.size(); ++i) {
    // In a real die, every symbol differs slightly from the others.
    Hand own = hand;
    own.waist += rng.normal(0, 0.012);
    own.aperture += rng.normal(0, 0.015);
    own.upright *= std::exp(rng.normal(0, 0.02));
    own.level *= std::exp(rng.normal(0, 0.02));
    const cv::Mat mask = draw_symbol(kPlateSymbols[i], own);
    typeface.masks[i] = mask;
    if (i < 10) widest = std::max(widest, mask.cols);
  }
  typeface.digit_aspect = static_cast<double>(widest) / GlyphSet::kCapHeight;
  return typeface;
}

}  // namespace tarsier::synth
